#include "prior_factor.h"

namespace peer {

PriorFactor::PriorFactor(const Matrix15& information, const Vector15& eta, const NavState& at, bool first_estimates)
    : at_(at), first_estimates_(first_estimates) {
  // Positions and biases differ by twelve orders of magnitude in information: scaled to a unit diagonal first.
  const Vector15 scale = information.diagonal().cwiseSqrt();
  const Matrix15 scaled = scale.cwiseInverse().asDiagonal() * information * scale.cwiseInverse().asDiagonal();
  const Matrix15 upper = scaled.llt().matrixU();
  root_ = upper * scale.asDiagonal();
  offset_ = upper.transpose().triangularView<Eigen::Lower>().solve(Vector15(eta.cwiseQuotient(scale)));
}

bool PriorFactor::Evaluate(double const* const* x, double* residual, double** jacobians) const {
  const Vector15 delta = NavState::FromArray(x[0]).Local(at_);
  Eigen::Map<Vector15> rows(residual);
  rows = offset_ + root_ * delta;
  if (jacobians && jacobians[0]) {
    Eigen::Map<Eigen::Matrix<double, 15, kAmbient, Eigen::RowMajor>> out(jacobians[0]);
    out.leftCols<15>() = root_;
    if (!first_estimates_) {
      out.middleCols<3>(kAttitude) =
          root_.middleCols<3>(kAttitude) * so3::RightJacobianInverse(delta.segment<3>(kAttitude));
    }
    out.rightCols<1>().setZero();
  }
  return true;
}

}  // namespace peer
