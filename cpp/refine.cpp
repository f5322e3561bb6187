#include <algorithm>
#include <cmath>
#include <vector>

#include "parallel.hpp"
#include "stages.hpp"

namespace stereopsis {

namespace {

// Median of the nine pixels around each of a row's inner ones, by minima and maxima alone, which vectorise.
// Where one of them has no value, `filtered` becomes NaN.
void median_of_nine(const float* __restrict above, const float* __restrict here, const float* __restrict below, int width,
                    float* __restrict filtered) {
  const auto least = [](float a, float b) { return a < b ? a : b; };
  const auto most = [](float a, float b) { return a < b ? b : a; };
  for (int x = 1; x < width - 1; ++x) {
    const float a0 = above[x - 1], a1 = above[x], a2 = above[x + 1];
    const float b0 = here[x - 1], b1 = here[x], b2 = here[x + 1];
    const float c0 = below[x - 1], c1 = below[x], c2 = below[x + 1];
    const float nothing = 0 * (a0 + a1 + a2 + b0 + b1 + b2 + c0 + c1 + c2);
    // Each row in order: least, middle, most.
    const float la = least(least(a0, a1), a2), ma = most(most(a0, a1), a2);
    const float lb = least(least(b0, b1), b2), mb = most(most(b0, b1), b2);
    const float lc = least(least(c0, c1), c2), mc = most(most(c0, c1), c2);
    const float ia = most(least(a0, a1), least(most(a0, a1), a2));
    const float ib = most(least(b0, b1), least(most(b0, b1), b2));
    const float ic = most(least(c0, c1), least(most(c0, c1), c2));
    // The median is that of the greatest least, the middle middle and the least greatest.
    const float p = most(most(la, lb), lc), r = least(least(ma, mb), mc);
    const float q = most(least(ia, ib), least(most(ia, ib), ic));
    filtered[x] = most(least(p, q), least(most(p, q), r)) + nothing;
  }
}

}  // namespace

void median(const float* disparity, int height, int width, int size, float* filtered, const Workers& workers) {
  const int before = size / 2, after = size - 1 - before;
  parallel_rows(height, workers.threads, workers.interrupted, [&](int begin, int end, const Cancel& cancel) {
    std::vector<float> values(static_cast<size_t>(size) * size);
    for (int y = begin; y < end && !cancel.load(std::memory_order_relaxed); ++y) {
      const size_t row = static_cast<size_t>(y) * width;
      const bool quick = size == 3 && y > 0 && y < height - 1;
      if (quick) median_of_nine(disparity + row - width, disparity + row, disparity + row + width, width, filtered + row);
      for (int x = 0; x < width; ++x) {
        const size_t at = row + x;
        if (quick && x > 0 && x < width - 1 && !std::isnan(filtered[at])) continue;
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
    }
  });
}

}  // namespace stereopsis
