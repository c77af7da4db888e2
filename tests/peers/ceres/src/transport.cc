#include "transport.h"

namespace peer {

EarthMotion::EarthMotion(double dt, const NavState& from, const World& world) {
  const Vector3d angle = world.frame.earth_rate_enu() * dt;
  const Vector3d gravity = world.GravityAt(from.p + 0.5 * dt * from.v);
  turn_back = so3::Exp(-angle);
  fall = dt * dt * (so3::Gamma2(angle) * gravity);
  fall_velocity = dt * (so3::LeftJacobian(angle) * gravity);
}

Carried::Carried(const NavState& from, const Preintegration& piece, const EarthMotion& earth, const World& world)
    : piece_(&piece), earth_(&earth), moved_(piece.At(from.ba, from.bg)), r_from_(from.q.toRotationMatrix()) {
  const Vector3d& rate = world.frame.earth_rate_enu();
  earth_rate_skew_ = so3::Skew(rate);
  const double dt = piece.dt;
  const Matrix3d& back = earth.turn_back;
  const Vector3d step = back * (from.v * dt + earth.fall + r_from_ * moved_.alpha);
  at_.p = from.p + step;
  at_.v = back * (from.v + earth.fall_velocity + r_from_ * moved_.beta) - rate.cross(step);
  at_.r = back * r_from_ * moved_.gamma;
}

NavState Transport(const NavState& from, const Preintegration& piece, const World& world) {
  const EarthMotion earth(piece.dt, from, world);
  const Carried carried(from, piece, earth, world);
  NavState to = from;
  to.p = carried.at().p;
  to.v = carried.at().v;
  to.q = Quaterniond(carried.at().r).normalized();
  return to;
}

Matrix15 PredictCovariance(const Matrix15& covariance, const NavState& from, const Preintegration& piece,
                           const World& world) {
  const EarthMotion earth(piece.dt, from, world);
  const Carried carried(from, piece, earth, world);
  const Eigen::Matrix<double, 9, 9> all = Eigen::Matrix<double, 9, 9>::Identity();
  Eigen::Matrix<double, 9, 15> by_state;
  Eigen::Matrix<double, 9, 9> by_increment;
  carried.Rows<9>(all, &by_state, &by_increment);
  Matrix15 f = Matrix15::Identity(), g = Matrix15::Identity();
  f.topRows<9>() = by_state;
  g.topLeftCorner<9, 9>() = by_increment;
  return f * covariance * f.transpose() + g * piece.covariance * g.transpose();
}

}  // namespace peer
