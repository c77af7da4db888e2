// A log directory: CSV files by sensor and sensors.toml, read whole.
#pragma once

#include <cstdint>
#include <map>
#include <set>
#include <stdexcept>
#include <string>
#include <vector>

#include "earth.h"

namespace peer {

// Integer nanoseconds: a Unix epoch as a double loses a quarter of a microsecond.
using Time = std::int64_t;
inline double Seconds(Time t) { return 1e-9 * static_cast<double>(t); }

// A mistake in a log, in one line.
struct LogError : std::runtime_error {
  using std::runtime_error::runtime_error;
};

struct ImuSample {
  Time t;
  Vector3d gyro_body, accel_body;
};

enum class Sensor { kLbl, kGnss, kDvl, kMcp, kPs };
constexpr int kSensors = 5;
inline const char* Name(Sensor s) {
  static const char* const kNames[kSensors] = {"lbl", "gnss", "dvl", "mcp", "ps"};
  return kNames[static_cast<int>(s)];
}

// One reading of an aiding sensor, in SI units.
struct Reading {
  Time t;
  Sensor sensor;
  Vector3d value;      // lbl: range; gnss: antenna ENU; dvl: instrument axes; mcp: heading rad; ps: depth
  Vector3d sigma;      // gnss: along local east, north, up
  Vector3d buoy_enu;   // lbl
};

// The facts of sensors.toml, angles in radians.
struct Vehicle {
  struct Initial {
    Time t = 0;
    Vector3d position, velocity, sigma_attitude;
    Quaterniond q;
    double sigma_position, sigma_velocity;
  } initial;
  struct Imu {
    double gyro_noise, accel_noise, gyro_walk, accel_walk, gyro_bias_sigma, accel_bias_sigma;
    double gap = 0.02;  // s; a longer step between samples bridges a hole
  } imu;
  double lbl_sigma, dvl_sigma, mcp_sigma, mcp_declination, ps_sigma, buoy_sigma;
  Vector3d gnss_sigma;
  Vector3d lbl_lever, gnss_lever, dvl_lever, ps_lever;
  Matrix3d r_body_dvl;
};

struct Log {
  Vehicle vehicle;
  World world;
  std::vector<ImuSample> imu;
  std::vector<Reading> readings;  // in order of time
  double imu_period;              // s, median
};

// Reads a log directory, without the sensors named in `without`.
Log ReadLog(const std::string& dir, const std::set<std::string>& without);

}  // namespace peer
