#include <algorithm>
#include <cmath>
#include <vector>

#include "parallel.hpp"
#include "stages.hpp"

namespace stereopsis {

void median(const float* disparity, int height, int width, int size, float* filtered, const Workers& workers) {
  const int before = size / 2, after = size - 1 - before;
  parallel_rows(height, workers.threads, workers.interrupted, [&](int begin, int end, const Cancel& cancel) {
    std::vector<float> values(static_cast<size_t>(size) * size);
    for (int y = begin; y < end && !cancel.load(std::memory_order_relaxed); ++y)
      for (int x = 0; x < width; ++x) {
        const size_t at = static_cast<size_t>(y) * width + x;
        filtered[at] = disparity[at];
        if (std::isnan(disparity[at])) continue;
        size_t count = 0;
        for (int v = std::max(0, y - before); v <= std::min(height - 1, y + after); ++v)
          for (int u = std::max(0, x - before); u <= std::min(width - 1, x + after); ++u) {
            const float value = disparity[static_cast<size_t>(v) * width + u];
            if (!std::isnan(value)) values[count++] = value;
          }
        const auto middle = values.begin() + count / 2;
        std::nth_element(values.begin(), middle, values.begin() + count);
        filtered[at] = count % 2 ? *middle : 0.5f * (*middle + *std::max_element(values.begin(), middle));
      }
  });
}

}  // namespace stereopsis
