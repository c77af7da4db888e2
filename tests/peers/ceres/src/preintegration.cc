#include "preintegration.h"

#include <cmath>

namespace peer {
namespace {

// White noise densities are so many times larger in a step over a hole.
constexpr double kGapInflation = 10;

}  // namespace

void Preintegration::Step(const ImuSample& from, const ImuSample& to, const Vehicle::Imu& noise) {
  using so3::Skew;
  const double h = Seconds(to.t - from.t);
  if (h == 0) return;
  const Vector3d theta = (0.5 * (from.gyro_body + to.gyro_body) - gyro_bias) * h;
  const Vector3d a0 = from.accel_body - accel_bias, a1 = to.accel_body - accel_bias;
  const Matrix3d turn = so3::Exp(theta), right = so3::RightJacobian(theta), next = gamma * turn;

  const Matrix3d f_phi = -0.5 * (gamma * Skew(a0) + next * Skew(a1) * turn.transpose());
  const Matrix3d f_gyro = 0.5 * h * next * Skew(a1) * right;
  const Matrix3d f_accel = -0.5 * (gamma + next);
  Eigen::Matrix<double, 9, 9> a = Eigen::Matrix<double, 9, 9>::Identity();
  a.block<3, 3>(0, 3).diagonal().setConstant(h);
  a.block<3, 3>(0, 6) = 0.5 * h * h * f_phi;
  a.block<3, 3>(3, 6) = h * f_phi;
  a.block<3, 3>(6, 6) = turn.transpose();
  Eigen::Matrix<double, 9, 6> b = Eigen::Matrix<double, 9, 6>::Zero();
  b.block<3, 3>(0, 0) = 0.5 * h * h * f_accel;
  b.block<3, 3>(0, 3) = 0.5 * h * h * f_gyro;
  b.block<3, 3>(3, 0) = h * f_accel;
  b.block<3, 3>(3, 3) = h * f_gyro;
  b.block<3, 3>(6, 3) = -h * right;

  bias_jacobian = (a * bias_jacobian).eval() + b;

  // By blocks: the walk of the biases stays diagonal.
  const double inflation = std::abs(h) > noise.gap ? kGapInflation : 1;
  const double wa = std::pow(inflation * noise.accel_noise, 2) / std::abs(h);
  const double wg = std::pow(inflation * noise.gyro_noise, 2) / std::abs(h);
  Eigen::Matrix<double, 9, 15> ab;
  ab << a, b;
  Eigen::Matrix<double, 15, 9> right_half = covariance * ab.transpose();
  Eigen::Matrix<double, 6, 1> white;
  white << wa, wa, wa, wg, wg, wg;
  covariance.topLeftCorner<9, 9>() = ab * right_half + b * white.asDiagonal() * b.transpose();
  covariance.bottomLeftCorner<6, 9>() = right_half.bottomRows<6>();
  covariance.topRightCorner<9, 6>() = right_half.bottomRows<6>().transpose();
  covariance.diagonal().segment<3>(9).array() += std::abs(h) * noise.accel_walk * noise.accel_walk;
  covariance.diagonal().segment<3>(12).array() += std::abs(h) * noise.gyro_walk * noise.gyro_walk;

  const Vector3d force = 0.5 * (gamma * a0 + next * a1);
  alpha += h * beta + 0.5 * h * h * force;
  beta += h * force;
  gamma = next;
  dt += h;
}

Preintegration::Corrected Preintegration::At(const Vector3d& ba, const Vector3d& bg) const {
  Eigen::Matrix<double, 6, 1> db;
  db << ba - accel_bias, bg - gyro_bias;
  const Eigen::Matrix<double, 9, 1> change = bias_jacobian * db;
  const Vector3d c = change.tail<3>();
  return {alpha + change.head<3>(), beta + change.segment<3>(3), c, gamma * so3::Exp(c)};
}

ImuSample Between(const ImuSample& a, const ImuSample& b, Time t) {
  const double share = Seconds(t - a.t) / Seconds(b.t - a.t);
  return {t, a.gyro_body + share * (b.gyro_body - a.gyro_body), a.accel_body + share * (b.accel_body - a.accel_body)};
}

}  // namespace peer
