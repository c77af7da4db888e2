#include "estimate_writer.h"

#include <cmath>
#include <cstdio>
#include <fstream>
#include <memory>
#include <sstream>

namespace peer {
namespace {

constexpr Time kSettle = 50000000;
constexpr double kDeg = M_PI / 180;

using File = std::unique_ptr<std::FILE, int (*)(std::FILE*)>;

File Create(const std::string& path) {
  File file(std::fopen(path.c_str(), "w"), std::fclose);
  if (!file) throw LogError(path + ": cannot be written");
  return file;
}

// Seconds with nanoseconds, exactly.
std::string TimeText(Time t) {
  char text[32];
  const long long magnitude = std::llabs(t);
  std::snprintf(text, sizeof text, "%s%lld.%09lld", t < 0 ? "-" : "", magnitude / 1000000000, magnitude % 1000000000);
  return text;
}

void WriteRow(std::FILE* csv, std::FILE* tum, Time t, const NavState& s, const Matrix15& c, const World& world,
              std::size_t solution, Time t_keyframe) {
  const Geodetic g = world.frame.ToGeodetic(s.p);
  const Matrix3d r = s.q.toRotationMatrix();
  const auto sigma = [&c](int i) { return std::sqrt(c(i, i)); };
  const double yaw = std::sqrt((r.row(2) * c.block<3, 3>(kAttitude, kAttitude) * r.row(2).transpose()).value());
  const std::string time = TimeText(t);
  std::fprintf(csv,
               "%s,%.6f,%.6f,%.6f,%.9f,%.9f,%.9f,%.9f,%.6f,%.6f,%.6f,%.9f,%.9f,%.9f,%.12f,%.12f,%.12f,"
               "%.7g,%.7g,%.7g,%.7g,%.7g,%.7g,%.11f,%.11f,%.6f,1,%zu,%s,%.7g,%.7g,%.7g\n",
               time.c_str(), s.p.x(), s.p.y(), s.p.z(), s.q.w(), s.q.x(), s.q.y(), s.q.z(), s.v.x(), s.v.y(), s.v.z(),
               s.ba.x(), s.ba.y(), s.ba.z(), s.bg.x(), s.bg.y(), s.bg.z(), sigma(0), sigma(1), sigma(2),
               sigma(6) / kDeg, sigma(7) / kDeg, yaw / kDeg, g.latitude / kDeg, g.longitude / kDeg, g.height, solution,
               TimeText(t_keyframe).c_str(), sigma(3), sigma(4), sigma(5));
  std::fprintf(tum, "%s %.6f %.6f %.6f %.9f %.9f %.9f %.9f\n", time.c_str(), s.p.x(), s.p.y(), s.p.z(), s.q.x(),
               s.q.y(), s.q.z(), s.q.w());
}

}  // namespace

void WriteKeyframes(const std::string& path, const std::vector<Solution>& solutions) {
  const File file = Create(path);
  std::fprintf(file.get(), "t_ns,e,n,u,ve,vn,vu,qw,qx,qy,qz,bax,bay,baz,bgx,bgy,bgz,covariance by rows of the upper half\n");
  for (const Solution& solution : solutions) {
    double x[kAmbient];
    solution.state.ToArray(x);
    std::fprintf(file.get(), "%lld", static_cast<long long>(solution.t));
    for (const double value : x) std::fprintf(file.get(), ",%.17g", value);
    for (int i = 0; i < 15; ++i) {
      for (int j = i; j < 15; ++j) std::fprintf(file.get(), ",%.17g", solution.covariance(i, j));
    }
    std::fprintf(file.get(), "\n");
  }
}

std::vector<Solution> ReadKeyframes(const std::string& path) {
  std::ifstream in(path);
  std::string line;
  if (!in || !std::getline(in, line)) throw LogError(path + ": cannot be read");
  std::vector<Solution> solutions;
  while (std::getline(in, line)) {
    std::stringstream cells(line);
    std::string cell;
    std::getline(cells, cell, ',');
    Solution solution{std::stoll(cell), {}, {}};
    const auto next = [&] {
      if (!std::getline(cells, cell, ',')) throw LogError(path + ": a row ends early");
      return std::stod(cell);
    };
    double x[kAmbient];
    for (double& value : x) value = next();
    solution.state = NavState::FromArray(x);
    for (int i = 0; i < 15; ++i) {
      for (int j = i; j < 15; ++j) solution.covariance(i, j) = solution.covariance(j, i) = next();
    }
    solutions.push_back(solution);
  }
  return solutions;
}

void WriteEstimates(const std::string& out, const Log& log, const std::vector<Solution>& solutions,
                    Publishing publishing) {
  const File csv = Create(out + "/estimate.csv"), tum = Create(out + "/estimate.tum");
  std::fprintf(csv.get(),
               "t,e,n,u,qw,qx,qy,qz,ve,vn,vu,bax,bay,baz,bgx,bgy,bgz,se,sn,su,sroll,spitch,syaw,lat,lon,h,mode,"
               "solution,t_keyframe,sve,svn,svu\n");
  const ImuHistory history(log.imu, log.vehicle.imu);
  const Time delay = publishing == Publishing::kOnline ? kSettle : 0;
  std::size_t base = 0;
  bool is_fresh = true;
  Preintegration run;
  ImuSample here{};
  for (const ImuSample& sample : log.imu) {
    if (sample.t < solutions[0].t + delay) continue;
    while (base + 1 < solutions.size() && solutions[base + 1].t + delay <= sample.t) {
      ++base;
      is_fresh = true;
    }
    const Solution& solution = solutions[base];
    if (is_fresh) {
      run = history.Prefixes(solution.t, {sample.t}, solution.state.ba, solution.state.bg).back();
      is_fresh = false;
    } else {
      run.Step(here, sample, log.vehicle.imu);
    }
    here = sample;
    WriteRow(csv.get(), tum.get(), sample.t, Transport(solution.state, run, log.world),
             PredictCovariance(solution.covariance, solution.state, run, log.world), log.world, base + 1, solution.t);
  }
}

}  // namespace peer
