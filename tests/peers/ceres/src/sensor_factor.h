// A reading as a cost function on the keyframe that it is tied to (method §3.1, FBPF with inflation).
//
//   y_j = transport(x_s),  r = h(y_j) − z,   J = H·T_j + [0 … H_b],   Λ = R_z + Q P15 Qᵀ,  Q = [H L | 0 H_b]
//
// Λ is evaluated once, when the reading is tied, and held.
#pragma once

#include <ceres/sized_cost_function.h>

#include "sensors.h"

namespace peer {

// What the window needs to know of any sensor's factor.
class TiedReading {
 public:
  virtual ~TiedReading() = default;
  // Whitened residual and rows by the 15 error coordinates at a state.
  virtual int Rows(const NavState& at, Eigen::Vector3d* residual, Eigen::Matrix<double, 3, 15>* jacobian) const = 0;
};

template <class Model>
class SensorFactor final : public ceres::SizedCostFunction<Model::kRows, kAmbient>, public TiedReading {
 public:
  static constexpr int R = Model::kRows;
  using Rows15 = Eigen::Matrix<double, R, 15>;
  using RowsR = Eigen::Matrix<double, R, R>;

  // `piece`: from the keyframe to the reading; null where they coincide. Both referred to must outlive the factor.
  SensorFactor(const Model& model, const Preintegration* piece, const NavState& at, const Linearisation* linearisation,
               const World* world)
      : model_(model),
        piece_(piece ? *piece : Preintegration()),
        earth_(piece_.dt, at, *world),
        linearisation_(linearisation),
        world_(world) {
    const Pose there = Carried(at, piece_, earth_, *world_).at();
    model_.Place(there, *world_);
    Rows15 jacobian;
    Eigen::Matrix<double, R, 9> by_increment;
    See(at, &jacobian, &by_increment);
    RowsR covariance = model_.Covariance(there, *world_);
    Eigen::Matrix<double, R, 15> q;
    q << by_increment, Eigen::Matrix<double, R, 3>::Zero(), model_.GyroBias().template topRows<R>();
    covariance += q * piece_.covariance * q.transpose();
    const RowsR lower = covariance.llt().matrixL();
    whitener_ = lower.template triangularView<Eigen::Lower>().solve(RowsR::Identity());
  }

  bool Evaluate(double const* const* x, double* residual, double** jacobians) const override {
    const NavState state = NavState::FromArray(x[0]);
    const bool wanted = jacobians && jacobians[0];
    Rows15 jacobian;
    const auto r = See(state, wanted && !linearisation_->held ? &jacobian : nullptr, nullptr);
    Eigen::Map<Eigen::Matrix<double, R, 1>> whitened(residual);
    whitened = whitener_ * r;
    if (wanted) {
      if (linearisation_->held) See(linearisation_->point, &jacobian, nullptr);
      Eigen::Map<Eigen::Matrix<double, R, kAmbient, Eigen::RowMajor>> out(jacobians[0]);
      out.template leftCols<15>() = whitener_ * jacobian;
      out.template rightCols<1>().setZero();
    }
    return true;
  }

  int Rows(const NavState& at, Eigen::Vector3d* residual, Eigen::Matrix<double, 3, 15>* rows) const override {
    Rows15 jacobian;
    residual->head<R>() = whitener_ * See(at, &jacobian, nullptr);
    rows->topRows<R>() = whitener_ * jacobian;
    return R;
  }

 private:
  // Residual, and where asked for the rows by the state and by the increment; not whitened.
  Eigen::Matrix<double, R, 1> See(const NavState& state, Rows15* jacobian,
                                  Eigen::Matrix<double, R, 9>* by_increment) const {
    if (piece_.dt == 0) {
      const Pose here{state.p, state.v, state.q.toRotationMatrix()};
      const auto seen = model_.See(here, state.bg, *world_, jacobian != nullptr);
      if (jacobian) {
        *jacobian << seen.h, Eigen::Matrix<double, R, 3>::Zero(), model_.GyroBias().template topRows<R>();
      }
      if (by_increment) by_increment->setZero();
      return seen.residual;
    }
    const Carried carried(state, piece_, earth_, *world_);
    const auto seen = model_.See(carried.at(), state.bg, *world_, jacobian != nullptr);
    if (jacobian) {
      Eigen::Matrix<double, R, 9> increment_rows;
      carried.template Rows<R>(seen.h, jacobian, &increment_rows);
      if constexpr (R == 3) jacobian->template rightCols<3>() += model_.GyroBias();
      if (by_increment) *by_increment = increment_rows;
    }
    return seen.residual;
  }

  Model model_;
  Preintegration piece_;
  EarthMotion earth_;
  const Linearisation* linearisation_;
  const World* world_;
  RowsR whitener_;
};

}  // namespace peer
