// Preintegration of IMU samples over a signed time, with bias Jacobians and covariance (method §2.1, §2.2).
//
//   θ  = (½(ω̃_i+ω̃_{i+1}) − b̂_g)·dt       γ' = γ·Exp(θ)        f̄ = ½(γ a_i + γ' a_{i+1})
//   α' = α + β dt + ½ f̄ dt²              β' = β + f̄ dt
//
// With negative dt the same code is the backward preintegration and the exact inverse of the forward one.
#pragma once

#include "log.h"
#include "nav_state.h"

namespace peer {

struct Preintegration {
  double dt = 0;  // s, signed
  Vector3d alpha = Vector3d::Zero(), beta = Vector3d::Zero();
  Matrix3d gamma = Matrix3d::Identity();
  Eigen::Matrix<double, 9, 6> bias_jacobian = Eigen::Matrix<double, 9, 6>::Zero();  // ∂(α,β,φ)/∂(b_a,b_g)
  Matrix15 covariance = Matrix15::Zero();                                           // P15
  Vector3d accel_bias = Vector3d::Zero(), gyro_bias = Vector3d::Zero();             // b̂

  void Step(const ImuSample& from, const ImuSample& to, const Vehicle::Imu& noise);

  // At other biases, to first order. c turns γ̂: γ = γ̂·Exp(c).
  struct Corrected {
    Vector3d alpha, beta, c;
    Matrix3d gamma;
  };
  Corrected At(const Vector3d& accel_bias, const Vector3d& gyro_bias) const;
};

// The sample at `t` on the straight line between two.
ImuSample Between(const ImuSample& a, const ImuSample& b, Time t);

}  // namespace peer
