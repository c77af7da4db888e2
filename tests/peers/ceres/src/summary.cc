#include "summary.h"

#include <algorithm>
#include <cmath>
#include <fstream>
#include <functional>

#include <ceres/version.h>

namespace peer {
namespace {

// Nearest rank.
double Percentile(std::vector<double> values, double share) {
  if (values.empty()) return NAN;
  std::sort(values.begin(), values.end());
  const auto rank = static_cast<std::size_t>(std::ceil(share * static_cast<double>(values.size())));
  return values[std::min(std::max<std::size_t>(rank, 1), values.size()) - 1];
}

// Of the updates with a full window, as the navigator counts them.
std::string Percentiles(const std::vector<UpdateTimes>& times, const std::function<double(const UpdateTimes&)>& part) {
  std::vector<double> values;
  for (const auto& update : times) values.push_back(part(update));
  return "{\"p50\": " + std::to_string(Percentile(values, 0.5)) + ", \"p99\": " +
         std::to_string(Percentile(values, 0.99)) + ", \"max\": " + std::to_string(Percentile(values, 1)) + "}";
}

void WriteHead(std::ofstream& json, const char* name, const Log& log, const Judge& judge,
               const WindowOptions& options) {
  const Geodetic& origin = log.world.frame.origin();
  json.precision(15);
  json << "{\n  \"estimator\": \"" << name << "\",\n  \"version\": \"Ceres " << CERES_VERSION_STRING << "\",\n"
       << "  \"robust\": " << (options.robustness == Robustness::kRobust ? "true" : "false") << ",\n"
       << "  \"origin\": [" << origin.latitude * 180 / M_PI << ", " << origin.longitude * 180 / M_PI << ", "
       << origin.height << "],\n  \"sensors\": {";
  for (int s = 0; s < kSensors; ++s) {
    const Counts& counts = judge.counts(static_cast<Sensor>(s));
    json << (s ? ", " : "") << "\"" << Name(static_cast<Sensor>(s)) << "\": {\"used\": " << counts.used
         << ", \"refused\": " << counts.refused << "}";
  }
  json << "},\n";
}

}  // namespace

void WriteWindowSummary(const std::string& out, const Log& log, const Judge& judge, const WindowOptions& options,
                        const std::vector<UpdateTimes>& all) {
  const std::size_t filling = std::min<std::size_t>(options.intervals, all.size());
  const std::vector<UpdateTimes> full(all.begin() + static_cast<long>(filling), all.end());
  std::ofstream json(out + "/summary.json");
  WriteHead(json, "ceres window", log, judge, options);
  json << "  \"window\": " << options.intervals << ",\n  \"keyframes\": " << all.size() + 1 << ",\n"
       << "  \"covariance\": \"" << (options.ceres_covariance ? "ceres::Covariance" : "sweep") << "\",\n"
       << "  \"solve_us\": " << Percentiles(full, [](const UpdateTimes& t) { return t.total(); }) << ",\n"
       << "  \"iterations\": " << Percentiles(full, [](const UpdateTimes& t) { return t.iterations; }) << ",\n"
       << "  \"parts_us\": {\n"
       << "    \"make_room\": " << Percentiles(full, [](const UpdateTimes& t) { return t.make_room; }) << ",\n"
       << "    \"append\": " << Percentiles(full, [](const UpdateTimes& t) { return t.append; }) << ",\n"
       << "    \"solve\": " << Percentiles(full, [](const UpdateTimes& t) { return t.solve; }) << ",\n"
       << "    \"solve.preprocess\": " << Percentiles(full, [](const UpdateTimes& t) { return t.preprocess; }) << ",\n"
       << "    \"solve.residuals\": " << Percentiles(full, [](const UpdateTimes& t) { return t.residuals; }) << ",\n"
       << "    \"solve.jacobians\": " << Percentiles(full, [](const UpdateTimes& t) { return t.jacobians; }) << ",\n"
       << "    \"solve.linear_solver\": "
       << Percentiles(full, [](const UpdateTimes& t) { return t.linear_solver; }) << ",\n"
       << "    \"covariance\": " << Percentiles(full, [](const UpdateTimes& t) { return t.covariance; })
       << "\n  }\n}\n";
}

void WriteBatchSummary(const std::string& out, const Log& log, const Judge& judge, const WindowOptions& options,
                       std::size_t keyframes, const BatchTimes& times) {
  std::ofstream json(out + "/summary.json");
  WriteHead(json, "ceres batch", log, judge, options);
  const double whole = times.solve + times.covariances;
  json << "  \"window\": " << keyframes - 1 << ",\n  \"keyframes\": " << keyframes << ",\n  \"solve_us\": {\"p50\": "
       << whole << ", \"p99\": " << whole << ", \"max\": " << whole << "},\n  \"iterations\": {\"p50\": "
       << times.iterations << "},\n  \"parts_us\": {\"build\": " << times.build << ", \"solve\": " << times.solve
       << ", \"covariance\": " << times.covariances << "}\n}\n";
}

}  // namespace peer
