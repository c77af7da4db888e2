// The state of a keyframe and how it is perturbed: x ⊞ δ = (p+δp, v+δv, q⊗Exp(δθ), b_a+δb_a, b_g+δb_g).
#pragma once

#include <ceres/manifold.h>

#include "so3.h"

namespace peer {

constexpr int kAmbient = 16;  // p, v, q (w x y z), b_a, b_g
constexpr int kTangent = 15;
constexpr int kPosition = 0, kVelocity = 3, kAttitude = 6, kAccelBias = 9, kGyroBias = 12;

using Vector15 = Eigen::Matrix<double, 15, 1>;
using Matrix15 = Eigen::Matrix<double, 15, 15>;
using RowMatrix15 = Eigen::Matrix<double, 15, 15, Eigen::RowMajor>;

struct NavState {
  Vector3d p = Vector3d::Zero(), v = Vector3d::Zero();
  Quaterniond q = Quaterniond::Identity();
  Vector3d ba = Vector3d::Zero(), bg = Vector3d::Zero();

  static NavState FromArray(const double* x) {
    NavState s;
    s.p = Eigen::Map<const Vector3d>(x);
    s.v = Eigen::Map<const Vector3d>(x + 3);
    s.q = Quaterniond(x[6], x[7], x[8], x[9]);
    s.ba = Eigen::Map<const Vector3d>(x + 10);
    s.bg = Eigen::Map<const Vector3d>(x + 13);
    return s;
  }
  void ToArray(double* x) const;
  NavState Retract(const Vector15& delta) const;
  // this ⊟ other.
  Vector15 Local(const NavState& other) const;
};

// The manifold that Ceres steps on.
//
// Every cost function writes ∂r/∂δ into the first 15 ambient columns and zero into the last, and this PlusJacobian takes
// just those: no derivative by quaternion components is formed and undone again.
class StateManifold final : public ceres::Manifold {
 public:
  int AmbientSize() const override { return kAmbient; }
  int TangentSize() const override { return kTangent; }
  bool Plus(const double* x, const double* delta, double* x_plus_delta) const override;
  bool PlusJacobian(const double* x, double* jacobian) const override;
  bool RightMultiplyByPlusJacobian(const double* x, const int num_rows, const double* ambient_matrix,
                                   double* tangent_matrix) const override;
  bool Minus(const double* y, const double* x, double* y_minus_x) const override;
  bool MinusJacobian(const double* x, double* jacobian) const override;
};

// What a cost function linearises about: the state itself, or a point held since the keyframe carries a marginal prior
// (first-estimates Jacobians).
struct Linearisation {
  bool held = false;
  NavState point;
};

}  // namespace peer
