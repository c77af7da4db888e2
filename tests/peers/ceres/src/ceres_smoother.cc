// ceres_smoother LOG --out OUT [--window N | --batch] [--clean] [--without dvl,mcp] ...
//
// Writes keyframes.csv, estimate.csv, estimate.tum and summary.json into OUT.

#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <set>
#include <sstream>
#include <string>

#include "estimate_writer.h"
#include "summary.h"

namespace {

struct Arguments {
  std::string log, out;
  std::set<std::string> without;
  bool batch = false;
  peer::WindowOptions window;
};

[[noreturn]] void Usage(const std::string& problem) {
  std::fprintf(stderr,
               "ceres_smoother: %s\n"
               "usage: ceres_smoother LOG --out OUT [--window N | --batch] [--clean] [--without SENSOR,...] [--no-fej]\n"
               "                      [--covariance sweep|ceres] [--library suite|eigen|cx] [--tolerance X]\n",
               problem.c_str());
  std::exit(2);
}

Arguments Parse(int argc, char** argv) {
  Arguments args;
  bool has_tolerance = false;
  for (int i = 1; i < argc; ++i) {
    const std::string flag = argv[i];
    const auto value = [&]() -> std::string {
      if (++i == argc) Usage(flag + " needs a value");
      return argv[i];
    };
    if (flag == "--out") {
      args.out = value();
    } else if (flag == "--window") {
      args.window.intervals = std::atoi(value().c_str());
      if (args.window.intervals < 2) Usage("--window needs at least 2");
    } else if (flag == "--batch") {
      args.batch = args.window.keep_all = true;
    } else if (flag == "--clean") {
      args.window.robustness = peer::Robustness::kClean;
    } else if (flag == "--no-fej") {
      args.window.first_estimates = false;
    } else if (flag == "--without") {
      std::stringstream names(value());
      for (std::string name; std::getline(names, name, ',');) args.without.insert(name);
    } else if (flag == "--covariance") {
      args.window.ceres_covariance = value() == "ceres";
    } else if (flag == "--library") {
      const std::string name = value();
      args.window.library = name == "eigen" ? ceres::EIGEN_SPARSE : name == "cx" ? ceres::CX_SPARSE : ceres::SUITE_SPARSE;
    } else if (flag == "--tolerance") {
      args.window.function_tolerance = std::atof(value().c_str());
      has_tolerance = true;
    } else if (args.log.empty() && flag[0] != '-') {
      args.log = flag;
    } else {
      Usage("unknown argument " + flag);
    }
  }
  // A batch has no next keyframe that would take the rest of the way: Ceres' default.
  if (args.batch && !has_tolerance) args.window.function_tolerance = 1e-6;
  if (args.log.empty() || args.out.empty()) Usage("a log directory and --out are needed");
  return args;
}

void Run(const Arguments& args) {
  const peer::Log log = peer::ReadLog(args.log, args.without);
  std::filesystem::create_directories(args.out);
  peer::Window window(log, args.window);
  std::vector<peer::Solution> solutions{window.First()};
  std::vector<peer::UpdateTimes> times;
  for (const peer::Closing& closing : peer::Schedule(log, log.vehicle.initial.t)) {
    times.emplace_back();
    solutions.push_back(window.Advance(closing, &times.back()));
  }
  if (args.batch) {
    peer::BatchTimes batch;
    solutions = peer::SolveBatch(window.TakeAll(), args.window, &batch);
    peer::WriteBatchSummary(args.out, log, window.judge(), args.window, solutions.size(), batch);
  } else {
    peer::WriteWindowSummary(args.out, log, window.judge(), args.window, times);
  }
  peer::WriteKeyframes(args.out + "/keyframes.csv", solutions);
  peer::WriteEstimates(args.out, log, solutions,
                       args.batch ? peer::Publishing::kSmoothed : peer::Publishing::kOnline);
}

}  // namespace

int main(int argc, char** argv) {
  const Arguments args = Parse(argc, argv);
  try {
    Run(args);
  } catch (const std::exception& error) {
    std::fprintf(stderr, "ceres_smoother: %s\n", error.what());
    return 2;
  }
  return 0;
}
