// Is a reading probable, and with which kernel does it enter (method §3.3, §4.2)?
#pragma once

#include <array>
#include <memory>

#include <ceres/loss_function.h>

#include "sensor_factor.h"

namespace peer {

enum class Robustness { kClean, kRobust };

struct Counts {
  int used = 0, refused = 0;
};

class Judge {
 public:
  explicit Judge(Robustness robustness);
  // Whether the whitened rows of a reading pass the gate, given the covariance of their state. Ranges of one epoch
  // are one measurement for the count of refusals in a row.
  bool Admits(const Reading& reading, int rows, const Vector3d& residual, const Eigen::Matrix<double, 3, 15>& jacobian,
              const Matrix15& covariance);
  // The kernel in force; null for none. Owned by the judge.
  ceres::LossFunction* Kernel(Sensor sensor) const;
  const Counts& counts(Sensor sensor) const { return counts_[static_cast<int>(sensor)]; }

 private:
  // Of whole epochs of one gated sensor.
  struct Refusals {
    int in_a_row = 0;
    Time t = 0;
    bool passed_any = true;
  };
  Robustness robustness_;
  std::array<Counts, kSensors> counts_;
  std::array<Refusals, kSensors> refusals_;
  double improbable_dvl_ = 0.05;
  std::array<std::unique_ptr<ceres::LossFunction>, kSensors> kernels_;
  std::unique_ptr<ceres::LossFunction> narrow_;
};

}  // namespace peer
