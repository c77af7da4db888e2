#include "nav_state.h"

namespace peer {

void NavState::ToArray(double* x) const {
  Eigen::Map<Vector3d>(x + 0) = p;
  Eigen::Map<Vector3d>(x + 3) = v;
  x[6] = q.w();
  x[7] = q.x();
  x[8] = q.y();
  x[9] = q.z();
  Eigen::Map<Vector3d>(x + 10) = ba;
  Eigen::Map<Vector3d>(x + 13) = bg;
}

NavState NavState::Retract(const Vector15& d) const {
  NavState s;
  s.p = p + d.segment<3>(kPosition);
  s.v = v + d.segment<3>(kVelocity);
  s.q = (q * so3::ExpQuaternion(d.segment<3>(kAttitude))).normalized();
  s.ba = ba + d.segment<3>(kAccelBias);
  s.bg = bg + d.segment<3>(kGyroBias);
  return s;
}

Vector15 NavState::Local(const NavState& other) const {
  Vector15 d;
  d << p - other.p, v - other.v, so3::Log(Quaterniond(other.q.conjugate() * q)), ba - other.ba, bg - other.bg;
  return d;
}

bool StateManifold::Plus(const double* x, const double* delta, double* x_plus_delta) const {
  NavState::FromArray(x).Retract(Eigen::Map<const Vector15>(delta)).ToArray(x_plus_delta);
  return true;
}

bool StateManifold::PlusJacobian(const double*, double* jacobian) const {
  Eigen::Map<Eigen::Matrix<double, kAmbient, kTangent, Eigen::RowMajor>> j(jacobian);
  j.setZero();
  j.topRows<kTangent>().setIdentity();
  return true;
}

bool StateManifold::RightMultiplyByPlusJacobian(const double*, const int num_rows, const double* ambient_matrix,
                                                double* tangent_matrix) const {
  using Ambient = Eigen::Matrix<double, Eigen::Dynamic, kAmbient, Eigen::RowMajor>;
  using Tangent = Eigen::Matrix<double, Eigen::Dynamic, kTangent, Eigen::RowMajor>;
  Eigen::Map<Tangent>(tangent_matrix, num_rows, kTangent) =
      Eigen::Map<const Ambient>(ambient_matrix, num_rows, kAmbient).leftCols<kTangent>();
  return true;
}

bool StateManifold::Minus(const double* y, const double* x, double* y_minus_x) const {
  Eigen::Map<Vector15> delta(y_minus_x);
  delta = NavState::FromArray(y).Local(NavState::FromArray(x));
  return true;
}

bool StateManifold::MinusJacobian(const double*, double* jacobian) const {
  Eigen::Map<Eigen::Matrix<double, kTangent, kAmbient, Eigen::RowMajor>> j(jacobian);
  j.setZero();
  j.leftCols<kTangent>().setIdentity();
  return true;
}

}  // namespace peer
