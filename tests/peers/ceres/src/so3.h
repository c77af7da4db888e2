// The rotation group: exponential, logarithm and their Jacobians.
//
//   Exp φ  = I + c1[φ]× + c2[φ]×²      J_l(φ) = I + c2[φ]× + c3[φ]×²      J_r(φ) = J_l(−φ)
//   Γ2(φ)  = ½I + c3[φ]× + c4[φ]×²     c_m = Σ (−1)^k t^{2k}/(2k+m)!,  t = |φ|
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>

namespace peer {

using Eigen::Matrix3d;
using Eigen::Quaterniond;
using Eigen::Vector3d;

namespace so3 {

// [v]×: Skew(v)·w = v × w.
inline Matrix3d Skew(const Vector3d& v) {
  Matrix3d m;
  m << 0, -v.z(), v.y(), v.z(), 0, -v.x(), -v.y(), v.x(), 0;
  return m;
}

Matrix3d Exp(const Vector3d& phi);
Quaterniond ExpQuaternion(const Vector3d& phi);
// Rotation vector of a matrix, at most π long. By atan2, never by acos.
Vector3d Log(const Matrix3d& rotation);
Vector3d Log(const Quaterniond& q);
Matrix3d LeftJacobian(const Vector3d& phi);
Matrix3d RightJacobian(const Vector3d& phi);
Matrix3d LeftJacobianInverse(const Vector3d& phi);
Matrix3d RightJacobianInverse(const Vector3d& phi);
// ∫₀¹ (1−s) Exp(sφ) ds.
Matrix3d Gamma2(const Vector3d& phi);

}  // namespace so3
}  // namespace peer
