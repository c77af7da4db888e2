// What each sensor sees of the state at its own time (method §3.2 to §3.7): predicted minus measured, and the derivative
// by (p_j, v_j, θ_j). No model whitens, weighs or gates.
//
// What depends on the place so weakly that a keyframe's corrections do not change it (the vertical, the local axes: 1.6e-7
// rad per metre) is evaluated once, in `Place`.
#pragma once

#include "transport.h"

namespace peer {

template <int R>
struct Seen {
  Eigen::Matrix<double, R, 1> residual;
  Eigen::Matrix<double, R, 9> h;  // filled where asked for
};

// Slant range from the transducer to a buoy, m.
struct LblModel {
  static constexpr int kRows = 1;
  double range, sigma;
  Vector3d buoy_enu, lever;
  void Place(const Pose&, const World&) {}
  Seen<1> See(const Pose& at, const Vector3d& gyro_bias, const World& world, bool jacobian) const;
  Matrix3d GyroBias() const { return Matrix3d::Zero(); }
  Eigen::Matrix<double, 1, 1> Covariance(const Pose& at, const World& world) const;
};

// Antenna position, m.
struct GnssModel {
  static constexpr int kRows = 3;
  Vector3d antenna_enu, sigma_local, lever;
  void Place(const Pose&, const World&) {}
  Seen<3> See(const Pose& at, const Vector3d& gyro_bias, const World& world, bool jacobian) const;
  Matrix3d GyroBias() const { return Matrix3d::Zero(); }
  Matrix3d Covariance(const Pose& at, const World& world) const;
};

// Velocity of the transducer over ground in the instrument's axes, m/s. The one model that also sees the gyroscope.
struct DvlModel {
  static constexpr int kRows = 3;
  Vector3d velocity_dvl, gyro_body, lever;
  Matrix3d r_dvl_body;
  double sigma, gyro_sigma;  // of the gyroscope sample, rad/s
  void Place(const Pose&, const World&) {}
  Seen<3> See(const Pose& at, const Vector3d& gyro_bias, const World& world, bool jacobian) const;
  Matrix3d GyroBias() const { return r_dvl_body * so3::Skew(lever); }
  Matrix3d Covariance(const Pose& at, const World& world) const;
};

// Heading of the body x axis at the vehicle, clockwise from north, rad.
struct McpModel {
  static constexpr int kRows = 1;
  double heading, sigma;
  Eigen::RowVector3d local_east = {}, local_north = {};  // ENU axes of the origin
  void Place(const Pose& at, const World& world);
  Seen<1> See(const Pose& at, const Vector3d& gyro_bias, const World& world, bool jacobian) const;
  Matrix3d GyroBias() const { return Matrix3d::Zero(); }
  Eigen::Matrix<double, 1, 1> Covariance(const Pose& at, const World& world) const;
};

// Depth of the pressure port below the mean surface, m.
struct PsModel {
  static constexpr int kRows = 1;
  double depth, sigma;
  Vector3d lever;
  Vector3d port_enu = {}, up_enu = {};  // where the port was placed, and the vertical there
  double height = 0;                    // of that place; elsewhere height + up·(port − place), to 1e-7 m over a metre
  void Place(const Pose& at, const World& world);
  Seen<1> See(const Pose& at, const Vector3d& gyro_bias, const World& world, bool jacobian) const;
  Matrix3d GyroBias() const { return Matrix3d::Zero(); }
  Eigen::Matrix<double, 1, 1> Covariance(const Pose& at, const World& world) const;
};

}  // namespace peer
