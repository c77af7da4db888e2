// The IMU factor between two keyframes: 15 rows, covariance P15 (method §2.5).
//
//   r_p = R_kᵀ(E(p_e−p_k) − v_kT − G_α) − α(b_k)       r_v = R_kᵀ(E(v_e + ω×(p_e−p_k)) − v_k − G_β) − β(b_k)
//   r_θ = Log(γ(b_k)ᵀ R_kᵀ E R_e)                      r_b = b_e − b_k
#pragma once

#include <ceres/sized_cost_function.h>

#include "transport.h"

namespace peer {

class ImuFactor final : public ceres::SizedCostFunction<15, kAmbient, kAmbient> {
 public:
  ImuFactor(const Preintegration& whole, const NavState& at, const Linearisation* from, const Linearisation* to, const World* world);
  bool Evaluate(double const* const* x, double* residual, double** jacobians) const override;

 private:
  Preintegration whole_;
  EarthMotion earth_;
  const Linearisation* from_;
  const Linearisation* to_;
  const World* world_;
  Matrix15 whitener_;  // L⁻¹ of P15 = L Lᵀ
};

}  // namespace peer
