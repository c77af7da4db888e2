// summary.json: what a peer did and how long it took.
#pragma once

#include <string>
#include <vector>

#include "batch.h"

namespace peer {

void WriteWindowSummary(const std::string& out, const Log& log, const Judge& judge, const WindowOptions& options,
                        const std::vector<UpdateTimes>& times);
void WriteBatchSummary(const std::string& out, const Log& log, const Judge& judge, const WindowOptions& options,
                       std::size_t keyframes, const BatchTimes& times);

}  // namespace peer
