#include "judge.h"

namespace peer {
namespace {

constexpr double kChi999[3] = {10.828, 13.816, 16.266};
constexpr double kChi95OfThree = 7.815;
// A range longer than predicted by so many sigmas is multipath; a shorter one may be a little further off.
constexpr double kTooLong = 4, kTooShort = 5;
constexpr int kRefusalsInARow = 5;
// The running share of improbable velocities above which their kernel narrows.
constexpr double kMemory = 0.98, kSuspicious = 0.12;

}  // namespace

Judge::Judge(Robustness robustness) : robustness_(robustness) {
  if (robustness == Robustness::kClean) return;
  const auto at = [this](Sensor s) -> auto& { return kernels_[static_cast<int>(s)]; };
  at(Sensor::kLbl) = std::make_unique<ceres::CauchyLoss>(2.0);
  at(Sensor::kDvl) = std::make_unique<ceres::CauchyLoss>(2.385);
  at(Sensor::kGnss) = std::make_unique<ceres::CauchyLoss>(2.385);
  at(Sensor::kMcp) = std::make_unique<ceres::CauchyLoss>(2.385);
  at(Sensor::kPs) = std::make_unique<ceres::HuberLoss>(1.345);
  narrow_ = std::make_unique<ceres::CauchyLoss>(1.0);
}

bool Judge::Admits(const Reading& reading, int rows, const Vector3d& residual,
                   const Eigen::Matrix<double, 3, 15>& jacobian, const Matrix15& covariance) {
  Counts& counts = counts_[static_cast<int>(reading.sensor)];
  const bool is_gated = reading.sensor == Sensor::kLbl || reading.sensor == Sensor::kDvl;
  if (robustness_ == Robustness::kClean || !is_gated) {
    ++counts.used;
    return true;
  }
  const auto j = jacobian.topRows(rows);
  const Eigen::MatrixXd s = Eigen::MatrixXd::Identity(rows, rows) + j * covariance * j.transpose();
  const Eigen::VectorXd whitened = s.llt().matrixL().solve(residual.head(rows));
  const double nis = whitened.squaredNorm();
  const bool passes = reading.sensor == Sensor::kLbl ? whitened[0] >= -kTooLong && whitened[0] <= kTooShort
                                                     : nis <= kChi999[rows - 1];
  if (reading.sensor == Sensor::kDvl) {
    improbable_dvl_ = kMemory * improbable_dvl_ + (1 - kMemory) * (nis > kChi95OfThree ? 1 : 0);
  }
  Refusals& refusals = refusals_[static_cast<int>(reading.sensor)];
  if (reading.t != refusals.t) {
    refusals.in_a_row = refusals.passed_any ? 0 : refusals.in_a_row + 1;
    refusals.t = reading.t;
    refusals.passed_any = false;
  }
  refusals.passed_any |= passes;
  // Refused for so long that the state may be what is wrong: by its kernel only, until one passes.
  const bool admitted = passes || refusals.in_a_row >= kRefusalsInARow;
  ++(admitted ? counts.used : counts.refused);
  return admitted;
}

ceres::LossFunction* Judge::Kernel(Sensor sensor) const {
  if (robustness_ == Robustness::kRobust && sensor == Sensor::kDvl && improbable_dvl_ > kSuspicious) {
    return narrow_.get();
  }
  return kernels_[static_cast<int>(sensor)].get();
}

}  // namespace peer
