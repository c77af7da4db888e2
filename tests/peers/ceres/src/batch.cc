#include "batch.h"

#include <stdexcept>

namespace peer {

std::vector<Solution> SolveBatch(std::deque<std::unique_ptr<Keyframe>> keyframes,
                                 const WindowOptions& options, BatchTimes* times) {

  const double began = ThreadMicroseconds();
  StateManifold manifold;
  ceres::Problem::Options problem_options;
  problem_options.cost_function_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
  problem_options.loss_function_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
  problem_options.manifold_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
  problem_options.disable_all_safety_checks = true;
  ceres::Problem problem(problem_options);
  for (std::size_t k = 0; k < keyframes.size(); ++k) {
    Keyframe& keyframe = *keyframes[k];
    // Priors but the first stand for keyframes that are here themselves.
    if (k > 0) keyframe.prior.reset();
    problem.AddParameterBlock(keyframe.x, kAmbient, &manifold);
    for (const Term& term : keyframe.Terms()) {
      problem.AddResidualBlock(const_cast<ceres::CostFunction*>(term.cost),
                               const_cast<ceres::LossFunction*>(term.loss), keyframe.x);
    }
    if (k > 0) problem.AddResidualBlock(keyframes[k - 1]->imu.get(), nullptr, keyframes[k - 1]->x, keyframe.x);
  }
  const double built = ThreadMicroseconds();
  ceres::Solver::Summary summary;
  ceres::Solve(SolverOptions(options), &problem, &summary);
  if (!summary.IsSolutionUsable()) throw std::runtime_error("Ceres: " + summary.message);
  const double solved = ThreadMicroseconds();
  std::vector<Link> links;
  links.reserve(keyframes.size());
  for (std::size_t k = 0; k < keyframes.size(); ++k) {
    const double* next = k + 1 < keyframes.size() ? keyframes[k + 1]->x : nullptr;
    links.push_back(Linearise(keyframes[k]->Terms(), keyframes[k]->imu.get(), keyframes[k]->x, next));
  }
  const auto covariances = Covariances(links);
  const double done = ThreadMicroseconds();
  *times = {built - began, solved - built, done - solved, static_cast<int>(summary.iterations.size()) - 1};

  std::vector<Solution> solutions;
  for (std::size_t k = 0; k < keyframes.size(); ++k) {
    solutions.push_back({keyframes[k]->t, NavState::FromArray(keyframes[k]->x), covariances[k]});
  }
  return solutions;
}

}  // namespace peer
