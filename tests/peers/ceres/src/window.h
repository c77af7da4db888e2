// The sliding window: one Ceres problem that lives as long as the run, to which each keyframe adds its blocks and from
// which the oldest is taken by Schur complement.
//
//   make room   the oldest keyframe becomes a prior on the next (FEJ: that one's linearisation point is held from then on)
//   append      predicted state, IMU factor, readings gated and tied
//   solve       Ceres, to convergence
//   covariance  of the newest keyframe
#pragma once

#include <deque>
#include <memory>
#include <vector>

#include <ceres/problem.h>
#include <ceres/solver.h>

#include "chain.h"
#include "imu_factor.h"
#include "intervals.h"
#include "judge.h"
#include "prior_factor.h"
#include "schedule.h"

namespace peer {

struct WindowOptions {
  int intervals = 20;
  Robustness robustness = Robustness::kRobust;
  bool first_estimates = true;
  // Covariance by ceres::Covariance in place of a sweep over the chain.
  bool ceres_covariance = false;
  // Keep marginalised keyframes and their factors, for a batch.
  bool keep_all = false;
  ceres::SparseLinearAlgebraLibraryType library = ceres::SUITE_SPARSE;
  // Relative change of the cost at which a solve ends. Ceres' own 1e-6 takes two to three times the steps under Cauchy kernels
  // and moves no RMS by more than 0.1 mm; 1e-3 does.
  double function_tolerance = 1e-4;
  int max_iterations = 50;
};

// CPU time of this thread by parts of one keyframe's update, µs.
struct UpdateTimes {
  double make_room = 0, append = 0, solve = 0, covariance = 0;
  // Of `solve`, by Ceres' own wall clock.
  double preprocess = 0, residuals = 0, jacobians = 0, linear_solver = 0;
  int iterations = 0;
  double total() const { return make_room + append + solve + covariance; }
};

// The newest keyframe, as published.
struct Solution {
  Time t;
  NavState state;
  Matrix15 covariance;
};

double ThreadMicroseconds();
// What every solve of this problem is asked for. The trust radius leaves Gauss-Newton steps undamped: with Ceres' own
// default the first steps are cut to nothing beside the scales of this problem, and it stops before the minimum.
ceres::Solver::Options SolverOptions(const WindowOptions& options);

// One keyframe with what is tied to it, and the interval behind it.
struct Keyframe {
  Time t;
  double x[kAmbient];
  Linearisation linearisation;
  std::unique_ptr<PriorFactor> prior;
  std::vector<std::unique_ptr<ceres::CostFunction>> readings;
  std::vector<ceres::LossFunction*> kernels;
  std::unique_ptr<ImuFactor> imu;  // to the next keyframe

  std::vector<Term> Terms() const;
};

class Window {
 public:
  Window(const Log& log, const WindowOptions& options);
  // Closes the interval up to a keyframe and solves.
  Solution Advance(const Closing& closing, UpdateTimes* times);
  Solution First() const;
  const Judge& judge() const { return judge_; }
  // All keyframes, oldest first; only with `keep_all`.
  std::deque<std::unique_ptr<Keyframe>> TakeAll();

 private:
  struct Pieces;
  void MakeRoom();
  void Append(const Closing& closing, const Pieces& pieces);
  void Tie(Keyframe* keyframe, const Reading& reading, const Preintegration* piece, const Matrix15& covariance);
  Matrix15 CovarianceOfNewest();
  Pieces Preintegrate(const Closing& closing) const;

  const Log& log_;
  WindowOptions options_;
  ImuHistory history_;
  Judge judge_;
  StateManifold manifold_;
  ceres::Problem problem_;
  ceres::Solver::Options solver_options_;
  std::deque<std::unique_ptr<Keyframe>> keyframes_, forgotten_;
  Matrix15 newest_covariance_;
};

}  // namespace peer
