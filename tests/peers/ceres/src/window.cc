#include "window.h"

#include <ctime>
#include <map>
#include <stdexcept>

#include <ceres/covariance.h>

namespace peer {
namespace {

ceres::Problem::Options ProblemOptions() {
  ceres::Problem::Options options;
  options.cost_function_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
  options.loss_function_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
  options.manifold_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
  options.enable_fast_removal = true;
  options.disable_all_safety_checks = true;
  return options;
}

// diag of the configured sigmas; attitude about body x, body y and the up axis.
Matrix15 InitialCovariance(const Vehicle& vehicle) {
  const auto& initial = vehicle.initial;
  Vector15 sigma;
  sigma << Vector3d::Constant(initial.sigma_position), Vector3d::Constant(initial.sigma_velocity), Vector3d::Zero(),
      Vector3d::Constant(vehicle.imu.accel_bias_sigma), Vector3d::Constant(vehicle.imu.gyro_bias_sigma);
  Matrix15 covariance = sigma.cwiseAbs2().asDiagonal();
  Matrix3d axes = Matrix3d::Identity();
  axes.col(2) = initial.q.toRotationMatrix().row(2).transpose();
  covariance.block<3, 3>(kAttitude, kAttitude) =
      axes * initial.sigma_attitude.cwiseAbs2().asDiagonal() * axes.transpose();
  return covariance;
}

}  // namespace

double ThreadMicroseconds() {
  timespec now;
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now);
  return 1e6 * static_cast<double>(now.tv_sec) + 1e-3 * static_cast<double>(now.tv_nsec);
}

ceres::Solver::Options SolverOptions(const WindowOptions& options) {
  ceres::Solver::Options solver;
  solver.linear_solver_type = ceres::SPARSE_NORMAL_CHOLESKY;
  solver.sparse_linear_algebra_library_type = options.library;
  solver.num_threads = 1;
  solver.initial_trust_region_radius = 1e16;
  solver.max_trust_region_radius = 1e32;
  solver.function_tolerance = options.function_tolerance;
  solver.max_num_iterations = options.max_iterations;
  solver.logging_type = ceres::SILENT;
  return solver;
}

std::vector<Term> Keyframe::Terms() const {
  std::vector<Term> terms;
  terms.reserve(readings.size() + 1);
  if (prior) terms.push_back({prior.get(), nullptr});
  for (std::size_t i = 0; i < readings.size(); ++i) terms.push_back({readings[i].get(), kernels[i]});
  return terms;
}

// What was added up while the samples came in: the whole interval, and the way to each reading from its keyframe.
struct Window::Pieces {
  Preintegration whole;
  std::map<Time, Preintegration> forward, backward;
};

Window::Window(const Log& log, const WindowOptions& options)
    : log_(log),
      options_(options),
      history_(log.imu, log.vehicle.imu),
      judge_(options.robustness),
      problem_(ProblemOptions()),
      solver_options_(SolverOptions(options)) {
  NavState first;
  const auto& initial = log.vehicle.initial;
  first.p = initial.position;
  first.v = initial.velocity;
  first.q = initial.q;
  newest_covariance_ = InitialCovariance(log.vehicle);
  auto keyframe = std::make_unique<Keyframe>();
  keyframe->t = initial.t;
  first.ToArray(keyframe->x);
  keyframe->prior = std::make_unique<PriorFactor>(newest_covariance_.inverse(), Vector15::Zero(), first, false);
  problem_.AddParameterBlock(keyframe->x, kAmbient, &manifold_);
  problem_.AddResidualBlock(keyframe->prior.get(), nullptr, keyframe->x);
  keyframes_.push_back(std::move(keyframe));
}

Solution Window::First() const {
  return {keyframes_.back()->t, NavState::FromArray(keyframes_.back()->x), newest_covariance_};
}

Solution Window::Advance(const Closing& closing, UpdateTimes* times) {
  const Pieces pieces = Preintegrate(closing);

  const double began = ThreadMicroseconds();
  MakeRoom();
  const double room_made = ThreadMicroseconds();
  Append(closing, pieces);
  const double appended = ThreadMicroseconds();
  ceres::Solver::Summary summary;
  ceres::Solve(solver_options_, &problem_, &summary);
  if (!summary.IsSolutionUsable()) throw std::runtime_error("Ceres: " + summary.message);
  const double solved = ThreadMicroseconds();
  newest_covariance_ = CovarianceOfNewest();
  const double done = ThreadMicroseconds();

  *times = {room_made - began,
            appended - room_made,
            solved - appended,
            done - solved,
            1e6 * summary.preprocessor_time_in_seconds,
            1e6 * summary.residual_evaluation_time_in_seconds,
            1e6 * summary.jacobian_evaluation_time_in_seconds,
            1e6 * summary.linear_solver_time_in_seconds,
            static_cast<int>(summary.iterations.size()) - 1};
  return {closing.t, NavState::FromArray(keyframes_.back()->x), newest_covariance_};
}

Window::Pieces Window::Preintegrate(const Closing& closing) const {
  const Time before = keyframes_.back()->t;
  const NavState last = NavState::FromArray(keyframes_.back()->x);
  Pieces pieces;
  std::vector<Time> stops;
  for (const Reading* reading : closing.forward) {
    if (reading->t > before && (stops.empty() || stops.back() != reading->t)) stops.push_back(reading->t);
  }
  stops.push_back(closing.t);
  auto prefixes = history_.Prefixes(before, stops, last.ba, last.bg);
  pieces.whole = prefixes.back();
  for (std::size_t i = 0; i + 1 < stops.size(); ++i) pieces.forward.emplace(stops[i], prefixes[i]);
  stops.clear();
  for (auto reading = closing.backward.rbegin(); reading != closing.backward.rend(); ++reading) {
    const Time t = (*reading)->t;
    if (t < closing.t && (stops.empty() || stops.back() != t)) stops.push_back(t);
  }
  prefixes = history_.Prefixes(closing.t, stops, last.ba, last.bg);
  for (std::size_t i = 0; i < stops.size(); ++i) pieces.backward.emplace(stops[i], prefixes[i]);
  return pieces;
}

void Window::MakeRoom() {
  if (static_cast<int>(keyframes_.size()) <= options_.intervals) return;
  Keyframe& oldest = *keyframes_[0];
  Keyframe& next = *keyframes_[1];
  const Link link = Linearise(oldest.Terms(), oldest.imu.get(), oldest.x, next.x);
  Matrix15 information;
  Vector15 eta;
  Marginalise(link, &information, &eta);
  // Takes the residual blocks along.
  problem_.RemoveParameterBlock(oldest.x);
  const NavState at = NavState::FromArray(next.x);
  if (options_.first_estimates) next.linearisation = {true, at};
  auto prior = std::make_unique<PriorFactor>(information, eta, at, options_.first_estimates);
  problem_.AddResidualBlock(prior.get(), nullptr, next.x);
  if (options_.keep_all) {
    forgotten_.push_back(std::move(keyframes_[0]));
    forgotten_.back()->linearisation.held = false;
  }
  next.prior = std::move(prior);
  keyframes_.pop_front();
}

void Window::Append(const Closing& closing, const Pieces& pieces) {
  Keyframe& last = *keyframes_.back();
  const NavState from = NavState::FromArray(last.x);
  const Matrix15 predicted = PredictCovariance(newest_covariance_, from, pieces.whole, log_.world);
  auto keyframe = std::make_unique<Keyframe>();
  keyframe->t = closing.t;
  Transport(from, pieces.whole, log_.world).ToArray(keyframe->x);
  last.imu = std::make_unique<ImuFactor>(pieces.whole, from, &last.linearisation, &keyframe->linearisation, &log_.world);
  problem_.AddParameterBlock(keyframe->x, kAmbient, &manifold_);
  problem_.AddResidualBlock(last.imu.get(), nullptr, last.x, keyframe->x);
  const auto tie = [&](Keyframe* to, const Reading& reading, const std::map<Time, Preintegration>& ways,
                       const Matrix15& covariance) {
    Tie(to, reading, reading.t == to->t ? nullptr : &ways.at(reading.t), covariance);
  };
  for (const Reading* reading : closing.forward) tie(&last, *reading, pieces.forward, newest_covariance_);
  for (const Reading* reading : closing.backward) tie(keyframe.get(), *reading, pieces.backward, predicted);
  keyframes_.push_back(std::move(keyframe));
}

namespace {

struct Tied {
  std::unique_ptr<ceres::CostFunction> cost;
  const TiedReading* reading = nullptr;
};

template <class Model, class... Rest>
Tied Make(const Model& model, Rest... rest) {
  auto factor = std::make_unique<SensorFactor<Model>>(model, rest...);
  const TiedReading* reading = factor.get();
  return {std::move(factor), reading};
}

}  // namespace

void Window::Tie(Keyframe* keyframe, const Reading& reading, const Preintegration* piece,
                 const Matrix15& covariance) {
  const Vehicle& vehicle = log_.vehicle;
  const NavState at = NavState::FromArray(keyframe->x);
  const auto make = [&](const auto& model) { return Make(model, piece, at, &keyframe->linearisation, &log_.world); };
  Tied tied;
  switch (reading.sensor) {
    case Sensor::kLbl: {
      const double sigma = std::hypot(vehicle.lbl_sigma, vehicle.buoy_sigma);
      tied = make(LblModel{reading.value.x(), sigma, reading.buoy_enu, vehicle.lbl_lever});
      break;
    }
    case Sensor::kGnss:
      tied = make(GnssModel{reading.value, reading.sigma, vehicle.gnss_lever});
      break;
    case Sensor::kDvl:
      tied = make(DvlModel{reading.value, history_.At(reading.t).gyro_body, vehicle.dvl_lever,
                           vehicle.r_body_dvl.transpose(), vehicle.dvl_sigma,
                           vehicle.imu.gyro_noise / std::sqrt(log_.imu_period)});
      break;
    case Sensor::kMcp:
      tied = make(McpModel{reading.value.x(), vehicle.mcp_sigma});
      break;
    case Sensor::kPs:
      tied = make(PsModel{reading.value.x(), vehicle.ps_sigma, vehicle.ps_lever});
      break;
  }
  Vector3d residual;
  Eigen::Matrix<double, 3, 15> jacobian;
  const int rows = tied.reading->Rows(at, &residual, &jacobian);
  if (!judge_.Admits(reading, rows, residual, jacobian, covariance)) return;
  ceres::LossFunction* kernel = judge_.Kernel(reading.sensor);
  problem_.AddResidualBlock(tied.cost.get(), kernel, keyframe->x);
  keyframe->readings.push_back(std::move(tied.cost));
  keyframe->kernels.push_back(kernel);
}

Matrix15 Window::CovarianceOfNewest() {
  if (options_.ceres_covariance) {
    ceres::Covariance::Options options;
    options.algorithm_type = ceres::SPARSE_QR;
    ceres::Covariance covariance(options);
    const double* newest = keyframes_.back()->x;
    RowMatrix15 block;
    const std::vector<std::pair<const double*, const double*>> wanted{{newest, newest}};
    if (!covariance.Compute(wanted, &problem_) ||
        !covariance.GetCovarianceBlockInTangentSpace(newest, newest, block.data())) {
      throw std::runtime_error("ceres::Covariance found the Jacobian rank deficient");
    }
    return block;
  }
  std::vector<Link> links;
  links.reserve(keyframes_.size());
  for (std::size_t k = 0; k < keyframes_.size(); ++k) {
    const Keyframe& keyframe = *keyframes_[k];
    const double* next = k + 1 < keyframes_.size() ? keyframes_[k + 1]->x : nullptr;
    links.push_back(Linearise(keyframe.Terms(), keyframe.imu.get(), keyframe.x, next));
  }
  return NewestCovariance(links);
}

std::deque<std::unique_ptr<Keyframe>> Window::TakeAll() {
  auto all = std::move(forgotten_);
  for (auto& keyframe : keyframes_) {
    keyframe->linearisation.held = false;
    all.push_back(std::move(keyframe));
  }
  keyframes_.clear();
  return all;
}

}  // namespace peer
