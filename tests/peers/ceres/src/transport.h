// A state carried to another instant by an increment, on the rotating Earth (method §2.4, §2.6).
//
//   p_j = p_k + Eᵀ(v_k T + G_α + R_k α)       E = Exp(ωT),  G_β = T·J_l(ωT) g,  G_α = T²·Γ2(ωT) g
//   v_j = Eᵀ(v_k + G_β + R_k β) − ω×(p_j − p_k)        g = g(p_k + ½T v_k),  T signed
//   R_j = Eᵀ R_k γ
#pragma once

#include "preintegration.h"

namespace peer {

// What gravity and the turning Earth do over a signed time; made once per factor. Gravity is that of the place where the
// factor was made: it changes by 1.6e-6 m/s² per metre, and a keyframe's corrections are far below a metre.
struct EarthMotion {
  Matrix3d turn_back = Matrix3d::Identity();      // Eᵀ
  Vector3d fall = Vector3d::Zero();               // G_α
  Vector3d fall_velocity = Vector3d::Zero();      // G_β

  EarthMotion() = default;
  EarthMotion(double dt, const NavState& from, const World& world);
};

// Position, velocity and attitude at a reading.
struct Pose {
  Vector3d p, v;
  Matrix3d r;  // R_j
};

// A state on its way: what its new place and a sensor's rows there have in common.
class Carried {
 public:
  Carried(const NavState& from, const Preintegration& piece, const EarthMotion& earth, const World& world);
  const Pose& at() const { return at_; }

  // H·T_j and H·L for rows H = ∂h/∂(p_j, v_j, θ_j), from right to left.
  template <int R>
  void Rows(const Eigen::Matrix<double, R, 9>& h, Eigen::Matrix<double, R, 15>* by_state,
            Eigen::Matrix<double, R, 9>* by_increment) const {
    const auto& d = piece_->bias_jacobian;
    const Eigen::Matrix<double, R, 3> hp = h.template leftCols<3>(), hv = h.template middleCols<3>(3),
                                      ht = h.template rightCols<3>();
    // hv·(−[ω]×) joins the position's columns: the velocity loses ω×(p_j − p_k).
    const Eigen::Matrix<double, R, 3> by_step = hp - hv * earth_rate_skew_;
    const Eigen::Matrix<double, R, 3> turned_step = by_step * earth_->turn_back;
    const Eigen::Matrix<double, R, 3> turned_velocity = hv * earth_->turn_back;
    const Eigen::Matrix<double, R, 3> by_alpha = turned_step * r_from_, by_beta = turned_velocity * r_from_;
    by_increment->template leftCols<3>() = by_alpha;
    by_increment->template middleCols<3>(3) = by_beta;
    by_increment->template rightCols<3>() = ht;
    by_state->template leftCols<3>() = hp;
    by_state->template middleCols<3>(kVelocity) = piece_->dt * turned_step + turned_velocity;
    by_state->template middleCols<3>(kAttitude) = ht * moved_.gamma.transpose() - by_alpha * so3::Skew(moved_.alpha) -
                                                  by_beta * so3::Skew(moved_.beta);
    by_state->template middleCols<6>(kAccelBias) =
        by_alpha * d.topRows<3>() + by_beta * d.middleRows<3>(3);
    by_state->template middleCols<3>(kGyroBias) += ht * (so3::RightJacobian(moved_.c) * d.bottomRightCorner<3, 3>());
  }

 private:
  const Preintegration* piece_;
  const EarthMotion* earth_;
  Preintegration::Corrected moved_;
  Matrix3d r_from_, earth_rate_skew_;
  Pose at_;
};

NavState Transport(const NavState& from, const Preintegration& piece, const World& world);

// x = transport(from), P = F C Fᵀ + G P15 Gᵀ of all 15 error coordinates.
Matrix15 PredictCovariance(const Matrix15& covariance, const NavState& from, const Preintegration& piece,
                           const World& world);

}  // namespace peer
