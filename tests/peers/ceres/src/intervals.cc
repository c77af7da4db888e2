#include "intervals.h"

#include <algorithm>

namespace peer {
namespace {

auto FirstNotBefore(const std::vector<ImuSample>& samples, Time t) {
  return std::lower_bound(samples.begin(), samples.end(), t, [](const ImuSample& s, Time u) { return s.t < u; });
}

}  // namespace

ImuSample ImuHistory::At(Time t) const {
  const auto next = FirstNotBefore(samples_, t);
  if (next == samples_.end()) return {t, samples_.back().gyro_body, samples_.back().accel_body};
  if (next->t == t || next == samples_.begin()) return {t, next->gyro_body, next->accel_body};
  return Between(*(next - 1), *next, t);
}

std::vector<Preintegration> ImuHistory::Prefixes(Time from, const std::vector<Time>& stops, const Vector3d& accel_bias,
                                                 const Vector3d& gyro_bias) const {
  std::vector<Preintegration> prefixes;
  if (stops.empty()) return prefixes;
  const bool forward = stops.back() >= from;
  Preintegration run;
  run.accel_bias = accel_bias;
  run.gyro_bias = gyro_bias;
  ImuSample here = At(from);
  auto index = FirstNotBefore(samples_, from) - samples_.begin();
  if (forward && index < static_cast<long>(samples_.size()) && samples_[index].t == from) ++index;
  if (!forward) --index;
  for (const Time stop : stops) {
    while (index >= 0 && index < static_cast<long>(samples_.size()) &&
           (forward ? samples_[index].t < stop : samples_[index].t > stop)) {
      run.Step(here, samples_[index], noise_);
      here = samples_[index];
      index += forward ? 1 : -1;
    }
    prefixes.push_back(run);
    prefixes.back().Step(here, At(stop), noise_);
  }
  return prefixes;
}

}  // namespace peer
