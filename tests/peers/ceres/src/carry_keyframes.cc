// carry_keyframes LOG OUT [--smoothed]
//
// Reads OUT/keyframes.csv of any peer and writes OUT/estimate.csv and OUT/estimate.tum at every IMU sample, so that all
// are scored alike.

#include <cstdio>
#include <cstring>

#include "estimate_writer.h"

int main(int argc, char** argv) {
  const bool smoothed = argc == 4 && std::strcmp(argv[3], "--smoothed") == 0;
  if (argc != 3 && !smoothed) {
    std::fprintf(stderr, "usage: carry_keyframes LOG OUT [--smoothed]\n");
    return 2;
  }
  try {
    const std::string out = argv[2];
    peer::WriteEstimates(out, peer::ReadLog(argv[1], {}), peer::ReadKeyframes(out + "/keyframes.csv"),
                         smoothed ? peer::Publishing::kSmoothed : peer::Publishing::kOnline);
  } catch (const std::exception& error) {
    std::fprintf(stderr, "carry_keyframes: %s\n", error.what());
    return 2;
  }
  return 0;
}
