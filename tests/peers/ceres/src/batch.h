// The whole log as one problem, from what a sliding window made of it.
#pragma once

#include "window.h"

namespace peer {

struct BatchTimes {
  double build = 0, solve = 0, covariances = 0;  // µs
  int iterations = 0;
};

// Solves over all keyframes of a window that kept them (`keep_all`); covariances everywhere.
std::vector<Solution> SolveBatch(std::deque<std::unique_ptr<Keyframe>> keyframes,
                                 const WindowOptions& options, BatchTimes* times);

}  // namespace peer
