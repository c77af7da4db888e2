// What is known of one keyframe beforehand, or from keyframes that were marginalised: r = r₀ + U (x ⊟ x_lin).
#pragma once

#include <ceres/sized_cost_function.h>

#include "nav_state.h"

namespace peer {

class PriorFactor final : public ceres::SizedCostFunction<15, kAmbient> {
 public:
  // ½δᵀΛδ + ηᵀδ with δ = x ⊟ `at`. `first_estimates`: the Jacobian stays U wherever x goes (FEJ).
  PriorFactor(const Matrix15& information, const Vector15& eta, const NavState& at, bool first_estimates);
  bool Evaluate(double const* const* x, double* residual, double** jacobians) const override;

 private:
  NavState at_;
  Matrix15 root_;  // U, Λ = UᵀU
  Vector15 offset_;
  bool first_estimates_;
};

}  // namespace peer
