// What a refinement starts from: whole disparities whose match lies inside the right image.
#pragma once

#include <algorithm>
#include <cmath>
#include <limits>

#include "stages.hpp"

namespace stereopsis {

struct Start {
  const float* disparity;
  int width, low = std::numeric_limits<int>::max(), high = std::numeric_limits<int>::min();

  // Copies the map to where the refined one goes, and notes from `low` to `high` which whole disparities are in view.
  Start(const AlignedPair& pair, const float* start, float* copy) : disparity(start), width(pair.width) {
    for (int y = 0; y < pair.height; ++y)
      for (int x = 0; x < width; ++x) {
        const size_t at = static_cast<size_t>(y) * width + x;
        copy[at] = start[at];
        if (in_view(x, at)) low = std::min(low, whole(at)), high = std::max(high, whole(at));
      }
  }

  int whole(size_t at) const { return static_cast<int>(std::floor(disparity[at] + 0.5f)); }
  bool in_view(int x, size_t at) const {
    if (!(std::abs(disparity[at]) <= static_cast<float>(width))) return false;  // NaN neither
    const int match = x - whole(at);
    return 0 <= match && match < width;
  }
  bool none() const { return low > high; }
};

}  // namespace stereopsis
