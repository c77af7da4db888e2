#include "schedule.h"

#include <algorithm>

namespace peer {
namespace {

constexpr Time kMaxAge = 1250000000, kMinSpacing = 200000000;

}  // namespace

std::vector<Closing> Schedule(const Log& log, Time start) {
  std::vector<Closing> closings;
  const auto& readings = log.readings;
  const Time end = log.imu.back().t;
  std::size_t ping = 0, next = 0;
  for (Time last = start;;) {
    while (ping < readings.size() &&
           (readings[ping].sensor != Sensor::kLbl || readings[ping].t < last + kMinSpacing)) {
      ++ping;
    }
    Time t = last + kMaxAge;
    if (ping < readings.size()) t = std::min(t, readings[ping].t);
    const bool is_last = t > end;
    if (is_last) {
      t = end;
      if (t - last < kMinSpacing) break;
    }
    Closing closing{t, {}, {}};
    for (; next < readings.size() && readings[next].t <= t; ++next) {
      const Reading* reading = &readings[next];
      if (reading->t < last) continue;
      (reading->t - last <= t - reading->t ? closing.forward : closing.backward).push_back(reading);
    }
    closings.push_back(std::move(closing));
    if (is_last) break;
    last = t;
  }
  return closings;
}

}  // namespace peer
