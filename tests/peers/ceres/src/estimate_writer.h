// Keyframes to files: keyframes.csv with full covariances, estimate.csv and estimate.tum at every IMU sample.
#pragma once

#include <string>
#include <vector>

#include "window.h"

namespace peer {

void WriteKeyframes(const std::string& file, const std::vector<Solution>& solutions);
std::vector<Solution> ReadKeyframes(const std::string& file);

// When a keyframe's solution reaches the published estimate.
enum class Publishing {
  // As the navigator does: with the first IMU sample 50 ms after the keyframe, carried on until the next one arrives.
  kOnline,
  // A smoother's: between two keyframes, carried from the earlier.
  kSmoothed,
};

// Carries the keyframes to every IMU sample.
void WriteEstimates(const std::string& out, const Log& log, const std::vector<Solution>& solutions,
                    Publishing publishing);

}  // namespace peer
