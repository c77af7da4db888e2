// When is a keyframe, and which readings are tied to it (method §4.1)?
//
// At each LBL epoch, otherwise 1.25 s after the last one; never closer than 0.2 s. A reading belongs to the nearer
// keyframe, of two equally near ones to the earlier.
#pragma once

#include <vector>

#include "log.h"

namespace peer {

// What the interval that ends with a keyframe brings.
struct Closing {
  Time t;                                // of the keyframe
  std::vector<const Reading*> forward;   // tied to the keyframe before, in order of time
  std::vector<const Reading*> backward;  // tied to this keyframe, in order of time
};

// All keyframes of a log but the first, which stands at `start`.
std::vector<Closing> Schedule(const Log& log, Time start);

}  // namespace peer
