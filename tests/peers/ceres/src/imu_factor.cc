#include "imu_factor.h"

namespace peer {
namespace {

struct Difference {
  Preintegration::Corrected moved;
  Matrix3d r_from_transposed, r_body_enu, relative;
  Vector3d position, velocity, attitude;

  Difference(const Preintegration& whole, const EarthMotion& earth, const NavState& from, const NavState& to,
             const World& world)
      : moved(whole.At(from.ba, from.bg)) {
    const double dt = whole.dt;
    const Vector3d step = to.p - from.p;
    r_from_transposed = from.q.toRotationMatrix().transpose();
    r_body_enu = r_from_transposed * earth.turn_back.transpose();
    relative = r_body_enu * to.q.toRotationMatrix();
    position = r_body_enu * step - r_from_transposed * (from.v * dt + earth.fall);
    velocity = r_body_enu * (to.v + world.frame.earth_rate_enu().cross(step)) -
               r_from_transposed * (from.v + earth.fall_velocity);
    attitude = so3::Log(Matrix3d(moved.gamma.transpose() * relative));
  }
};

using Out = Eigen::Map<Eigen::Matrix<double, 15, kAmbient, Eigen::RowMajor>>;

}  // namespace

ImuFactor::ImuFactor(const Preintegration& whole, const NavState& at, const Linearisation* from, const Linearisation* to,
                     const World* world)
    : whole_(whole), earth_(whole.dt, at, *world), from_(from), to_(to), world_(world) {
  const Matrix15 lower = whole_.covariance.llt().matrixL();
  whitener_ = lower.triangularView<Eigen::Lower>().solve(Matrix15::Identity());
}

bool ImuFactor::Evaluate(double const* const* x, double* residual, double** jacobians) const {
  using so3::Skew;
  const NavState from = NavState::FromArray(x[0]), to = NavState::FromArray(x[1]);
  Difference d(whole_, earth_, from, to, *world_);
  Vector15 r;
  r << d.position - d.moved.alpha, d.velocity - d.moved.beta, d.attitude, to.ba - from.ba, to.bg - from.bg;
  const auto lower = whitener_.triangularView<Eigen::Lower>();
  Eigen::Map<Vector15> rows(residual);
  rows = lower * r;
  if (!jacobians) return true;

  if (from_->held || to_->held) {
    d = Difference(whole_, earth_, from_->held ? from_->point : from, to_->held ? to_->point : to, *world_);
  }
  const Matrix3d earth_rate = d.r_body_enu * Skew(world_->frame.earth_rate_enu());
  const Matrix3d right_inverse = so3::RightJacobianInverse(d.attitude);
  const auto& by_bias = whole_.bias_jacobian;
  if (jacobians[0]) {
    Matrix15 j = Matrix15::Zero();
    j.block<3, 3>(0, kPosition) = -d.r_body_enu;
    j.block<3, 3>(0, kVelocity) = -whole_.dt * d.r_from_transposed;
    j.block<3, 3>(0, kAttitude) = Skew(d.position);
    j.block<3, 3>(3, kPosition) = -earth_rate;
    j.block<3, 3>(3, kVelocity) = -d.r_from_transposed;
    j.block<3, 3>(3, kAttitude) = Skew(d.velocity);
    j.block<6, 6>(0, kAccelBias) = -by_bias.topRows<6>();
    j.block<3, 3>(6, kAttitude) = -right_inverse * d.relative.transpose();
    // J_l⁻¹(r) = J_r⁻¹(r)ᵀ.
    j.block<3, 3>(6, kGyroBias) =
        -right_inverse.transpose() * so3::RightJacobian(d.moved.c) * by_bias.bottomRightCorner<3, 3>();
    j.block<6, 6>(9, kAccelBias) = -Eigen::Matrix<double, 6, 6>::Identity();
    Out out(jacobians[0]);
    out.leftCols<15>() = lower * j;
    out.rightCols<1>().setZero();
  }
  if (jacobians[1]) {
    Matrix15 j = Matrix15::Zero();
    j.block<3, 3>(0, kPosition) = d.r_body_enu;
    j.block<3, 3>(3, kPosition) = earth_rate;
    j.block<3, 3>(3, kVelocity) = d.r_body_enu;
    j.block<3, 3>(6, kAttitude) = right_inverse;
    j.block<6, 6>(9, kAccelBias) = Eigen::Matrix<double, 6, 6>::Identity();
    Out out(jacobians[1]);
    out.leftCols<15>() = lower * j;
    out.rightCols<1>().setZero();
  }
  return true;
}

}  // namespace peer
