// Analytic Jacobians against central differences, at tilted, moving, biased states, forwards and backwards; the first-
// estimates form, the marginal prior, the inverse of the two directions. Exit code 1 and a line for each that fails.

#include <cstdio>
#include <functional>
#include <string>

#include "chain.h"
#include "imu_factor.h"
#include "intervals.h"
#include "prior_factor.h"
#include "sensor_factor.h"

namespace {

using namespace peer;

int failures = 0;

void Expect(const std::string& what, double error, double tolerance) {
  const bool passed = error <= tolerance;
  std::printf("%s %s: %.2e (at most %.0e)\n", passed ? "ok    " : "FAILED", what.c_str(), error, tolerance);
  failures += passed ? 0 : 1;
}

// Largest difference between the analytic and the numeric derivative by one parameter block, relative to its size.
double JacobianError(const ceres::CostFunction& cost, const std::vector<NavState>& states, std::size_t block) {
  const int rows = cost.num_residuals();
  const auto evaluate = [&](const std::vector<NavState>& at, double* residual, double* jacobian) {
    std::vector<std::array<double, kAmbient>> x(at.size());
    std::vector<const double*> parameters;
    std::vector<double*> jacobians(at.size(), nullptr);
    for (std::size_t i = 0; i < at.size(); ++i) {
      at[i].ToArray(x[i].data());
      parameters.push_back(x[i].data());
    }
    jacobians[block] = jacobian;
    cost.Evaluate(parameters.data(), residual, jacobian ? jacobians.data() : nullptr);
  };
  Eigen::VectorXd plus(rows), minus(rows);
  Eigen::Matrix<double, Eigen::Dynamic, kAmbient, Eigen::RowMajor> analytic(rows, kAmbient);
  evaluate(states, plus.data(), analytic.data());
  double worst = 0;
  for (int column = 0; column < kTangent; ++column) {
    const double step = 1e-5;
    Vector15 delta = Vector15::Zero();
    delta[column] = step;
    auto moved = states;
    moved[block] = states[block].Retract(delta);
    evaluate(moved, plus.data(), nullptr);
    moved[block] = states[block].Retract(-delta);
    evaluate(moved, minus.data(), nullptr);
    const Eigen::VectorXd numeric = (plus - minus) / (2 * step);
    worst = std::max(worst, (numeric - analytic.col(column)).norm() / (1 + analytic.col(column).norm()));
  }
  return worst;
}

NavState Tilted(const Vector3d& p, const Vector3d& v, const Quaterniond& q) {
  NavState s;
  s.p = p;
  s.v = v;
  s.q = q.normalized();
  s.ba = {0.012, -0.021, 0.0315};
  s.bg = {0.0011, 0.0018, -0.00285};
  return s;
}

}  // namespace

int main() {
  const World world{LocalFrame(Geodetic::FromDegrees(36.38, 127.36, 0)), 0.7};
  const Vehicle::Imu noise{2.9e-5, 1e-3, 1e-7, 1e-6, 1.2e-4, 1e-3, 1.0};
  std::vector<ImuSample> samples;
  for (int i = 0; i <= 5; ++i) {
    samples.push_back({static_cast<Time>(i) * 100000000, Vector3d(0.1, -0.2, 0.3) + i * Vector3d(0.01, 0.02, -0.03),
                       Vector3d(0.5, 0.2, 9.8) + i * Vector3d(-0.1, 0.05, 0.02)});
  }
  const ImuHistory history(samples, noise);
  const Vector3d ba(0.01, -0.02, 0.03), bg(0.001, 0.002, -0.003);
  const Preintegration whole = history.Prefixes(0, {500000000}, ba, bg)[0];
  const Preintegration back = history.Prefixes(500000000, {0}, ba, bg)[0];
  const NavState from = Tilted({120, -340, -55}, {1.5, -0.7, 0.2}, {0.9, 0.1, -0.05, 0.42});
  const NavState to = Tilted({120.8, -340.3, -54.8}, {1.7, -0.5, 0.4}, {0.88, 0.05, -0.09, 0.47});

  // Golden numbers of an independent program.
  Expect("forward alpha", (whole.alpha - Vector3d(0.00228271208529, 0.0147325252208, 1.22601562318)).norm(), 1e-10);
  Expect("forward beta", (whole.beta - Vector3d(-0.0918756887415, 0.0260320796123, 4.91023012189)).norm(), 1e-10);
  Expect("backward alpha", (back.alpha - Vector3d(0.0487143008949, 0.0745286218411, 1.22681946419)).norm(), 1e-10);
  Expect("sigma of alpha x", std::abs(std::sqrt(whole.covariance(0, 0)) / 0.000203387002782 - 1), 1e-9);
  Expect("sigma of phi x", std::abs(std::sqrt(whole.covariance(6, 6)) / 2.05054403435e-5 - 1), 1e-9);
  const Vector3d gravity = world.GravityAt({1234.5, -2345.6, -78.9});
  Expect("gravity", (gravity - Vector3d(-0.00189435500861, 0.00361507777366, -9.79874061208)).norm(), 1e-10);
  const NavState there = Transport(from, whole, world);
  Expect("transport, position", (there.p - Vector3d(120.732513293, -340.611511656, -54.9272535836)).norm(), 1e-8);
  Expect("transport, velocity", (there.v - Vector3d(1.39040408178, -1.84338895305, 0.0748754326474)).norm(), 1e-9);

  const Linearisation current;
  // The numeric side sees the state's own whitening, so that errors are in sigmas.
  const ImuFactor imu(whole, from, &current, &current, &world);
  Expect("IMU factor, older state", JacobianError(imu, {from, to}, 0), 1e-5);
  Expect("IMU factor, newer state", JacobianError(imu, {from, to}, 1), 1e-5);

  const Vector3d lever(0.4, -0.15, 0.25);
  const Matrix3d mounting = (Eigen::AngleAxisd(0.5, Vector3d::UnitZ()) * Eigen::AngleAxisd(-0.03, Vector3d::UnitY()) *
                             Eigen::AngleAxisd(0.02, Vector3d::UnitX()))
                                .toRotationMatrix();
  const Preintegration half = history.Prefixes(0, {250000000}, ba, bg)[0];
  const Preintegration half_back = history.Prefixes(500000000, {250000000}, ba, bg)[0];
  const auto check = [&](const std::string& name, const auto& model) {
    using Factor = SensorFactor<std::decay_t<decltype(model)>>;
    const Factor at_keyframe(model, nullptr, from, &current, &world);
    const Factor forward(model, &half, from, &current, &world);
    const Factor backward(model, &half_back, to, &current, &world);
    Expect(name + " at its keyframe", JacobianError(at_keyframe, {from}, 0), 1e-5);
    Expect(name + " forwards", JacobianError(forward, {from}, 0), 1e-5);
    Expect(name + " backwards", JacobianError(backward, {to}, 0), 1e-5);
  };
  check("LBL", LblModel{620, 0.3, {-400, 0, 0}, lever});
  check("GNSS", GnssModel{{120.5, -340.1, -54.6}, {0.02, 0.02, 0.01}, lever});
  check("DVL", DvlModel{{1, -1.2, 0.3}, history.At(250000000).gyro_body, lever, mounting.transpose(), 0.01, 3e-4});
  check("MCP", McpModel{0.38, 1.7e-4});
  check("PS", PsModel{55.2, 0.01, lever});
  {
    const SensorFactor<LblModel> forward(LblModel{620, 0.3, {-400, 0, 0}, lever}, &half, from, &current, &world);
    Vector3d residual;
    Eigen::Matrix<double, 3, 15> rows;
    forward.Rows(from, &residual, &rows);
    // The inflation takes a ten-thousandth of it.
    Expect("LBL residual", std::abs(0.3 * residual[0] - 4.336585276), 1e-3);
  }

  // A held linearisation point: the Jacobian stays that of the point wherever the state goes.
  Linearisation held{true, from};
  const SensorFactor<PsModel> first_estimate(PsModel{55.2, 0.01, lever}, &half, from, &held, &world);
  const NavState moved = from.Retract(0.01 * Vector15::Ones());
  double x[kAmbient], y[kAmbient];
  from.ToArray(x);
  moved.ToArray(y);
  Eigen::Matrix<double, 1, kAmbient> at_point, at_moved;
  double* out[1] = {at_point.data()};
  const double* in[1] = {x};
  double residual[15];
  first_estimate.Evaluate(in, residual, out);
  out[0] = at_moved.data();
  in[0] = y;
  first_estimate.Evaluate(in, residual, out);
  Expect("held linearisation", (at_point - at_moved).norm(), 0);

  // A marginal prior says of the newer state what the chain of both says of it.
  const PriorFactor prior(Matrix15::Identity() * 4, Vector15::Ones(), from, false);
  Expect("prior", JacobianError(prior, {moved}, 0), 1e-5);
  double z[kAmbient];
  to.ToArray(z);
  const Link oldest = Linearise({{&prior, nullptr}}, &imu, x, z);
  Matrix15 information;
  Vector15 eta;
  Marginalise(oldest, &information, &eta);
  Link newest;
  const Matrix15 of_chain = NewestCovariance({oldest, newest});
  Expect("marginal prior", (of_chain * information - Matrix15::Identity()).cwiseAbs().maxCoeff(), 1e-4);
  Expect("covariances of all", (Covariances({oldest, newest})[1] - of_chain).norm() / of_chain.norm(), 1e-12);
  return failures == 0 ? 0 : 1;
}
