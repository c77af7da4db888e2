// IMU samples between two instants, added up.
#pragma once

#include <vector>

#include "preintegration.h"

namespace peer {

class ImuHistory {
 public:
  ImuHistory(const std::vector<ImuSample>& samples, const Vehicle::Imu& noise) : samples_(samples), noise_(noise) {}
  Time first() const { return samples_.front().t; }
  Time last() const { return samples_.back().t; }
  // On the straight line between its neighbours.
  ImuSample At(Time t) const;
  // The increments from `from` to each stop, by one run; stops in order, all later than `from` or all earlier.
  std::vector<Preintegration> Prefixes(Time from, const std::vector<Time>& stops, const Vector3d& accel_bias,
                                       const Vector3d& gyro_bias) const;
  const std::vector<ImuSample>& samples() const { return samples_; }
  const Vehicle::Imu& noise() const { return noise_; }

 private:
  const std::vector<ImuSample>& samples_;
  const Vehicle::Imu& noise_;
};

}  // namespace peer
