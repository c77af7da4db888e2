#include "so3.h"

#include <array>
#include <cmath>

namespace peer::so3 {
namespace {

// c1 … c4. Below half a radian the closed forms cancel and the series stands.
std::array<double, 4> Coefficients(double t_squared) {
  if (t_squared < 0.25) {
    static constexpr double kOdd[8] = {1.0 / 6, 1.0 / 120, 1.0 / 5040, 1.0 / 362880, 1.0 / 39916800,
                                       1.0 / 6227020800.0, 1.0 / 1307674368000.0, 1.0 / 355687428096000.0};
    static constexpr double kEven[8] = {1.0 / 24, 1.0 / 720, 1.0 / 40320, 1.0 / 3628800, 1.0 / 479001600,
                                        1.0 / 87178291200.0, 1.0 / 20922789888000.0, 1.0 / 6402373705728000.0};
    // Five terms are exact to rounding below a tenth of a radian.
    const int terms = t_squared < 0.01 ? 5 : 8;
    double c3 = 0, c4 = 0;
    for (int k = terms - 1; k >= 0; --k) {
      c3 = kOdd[k] - t_squared * c3;
      c4 = kEven[k] - t_squared * c4;
    }
    return {1 - t_squared * c3, 0.5 - t_squared * c4, c3, c4};
  }
  const double t = std::sqrt(t_squared), s = std::sin(t), c = std::cos(t);
  return {s / t, (1 - c) / t_squared, (t - s) / (t * t_squared), (c - 1 + 0.5 * t_squared) / (t_squared * t_squared)};
}

// scale·I + first·[φ]× + second·[φ]×².
Matrix3d Combine(const Vector3d& phi, double t_squared, double scale, double first, double second) {
  Matrix3d m = (second * phi) * phi.transpose();
  m.diagonal().array() += scale - second * t_squared;
  return m + Skew(first * phi);
}

double InverseCoefficient(double t_squared) {
  if (t_squared < 0.01) {
    return 1.0 / 12 + t_squared * (1.0 / 720 + t_squared * (1.0 / 30240 + t_squared / 1209600));
  }
  const double t = std::sqrt(t_squared);
  return 1 / t_squared - 1 / (2 * t * std::tan(0.5 * t));
}

}  // namespace

Matrix3d Exp(const Vector3d& phi) {
  const double t2 = phi.squaredNorm();
  const auto c = Coefficients(t2);
  return Combine(phi, t2, 1, c[0], c[1]);
}

Quaterniond ExpQuaternion(const Vector3d& phi) {
  const double half_squared = 0.25 * phi.squaredNorm();
  const auto c = Coefficients(half_squared);
  const Vector3d v = 0.5 * c[0] * phi;
  return Quaterniond(1 - half_squared * c[1], v.x(), v.y(), v.z());
}

Vector3d Log(const Quaterniond& q_any) {
  const double sign = q_any.w() < 0 ? -1 : 1;
  const Vector3d v = sign * q_any.vec();
  const double w = sign * q_any.w(), n2 = v.squaredNorm();
  if (n2 < 1e-6) {
    const double ratio = n2 / (w * w);
    return (2 / w * (1 - ratio * (1.0 / 3 - ratio / 5))) * v;
  }
  const double n = std::sqrt(n2);
  return (2 * std::atan2(n, w) / n) * v;
}

Vector3d Log(const Matrix3d& r) {
  const Vector3d sine = 0.5 * Vector3d(r(2, 1) - r(1, 2), r(0, 2) - r(2, 0), r(1, 0) - r(0, 1));
  const double cosine = 0.5 * (r.trace() - 1);
  // Beyond 120 degrees the sine fades, and the axis with it.
  if (cosine < -0.5) return Log(Quaterniond(r));
  const double s2 = sine.squaredNorm();
  if (s2 < 1e-6 && cosine > 0) return sine * (1 + s2 * (1.0 / 6 + s2 * 3.0 / 40));
  const double s = std::sqrt(s2);
  return sine * (std::atan2(s, cosine) / s);
}

Matrix3d LeftJacobian(const Vector3d& phi) {
  const double t2 = phi.squaredNorm();
  const auto c = Coefficients(t2);
  return Combine(phi, t2, 1, c[1], c[2]);
}

Matrix3d RightJacobian(const Vector3d& phi) { return LeftJacobian(-phi); }

Matrix3d LeftJacobianInverse(const Vector3d& phi) {
  const double t2 = phi.squaredNorm();
  return Combine(phi, t2, 1, -0.5, InverseCoefficient(t2));
}

Matrix3d RightJacobianInverse(const Vector3d& phi) { return LeftJacobianInverse(-phi); }

Matrix3d Gamma2(const Vector3d& phi) {
  const double t2 = phi.squaredNorm();
  const auto c = Coefficients(t2);
  return Combine(phi, t2, 0.5, c[2], c[3]);
}

}  // namespace peer::so3
