#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include "parallel.hpp"
#include "rows.hpp"
#include "stages.hpp"

namespace stereopsis {

namespace {

// Rows of the map in turn, with no value on either side of them, nor above the first and below the last.
class Padded {
 public:
  Padded(const float* map, int height, int width)
      : map_(map), height_(height), width_(width), rows_(3, std::vector<float>(width + 2, kNone)) {}
  // The row from the column before its first; three rows in turn are there at once.
  const float* row(int y) {
    std::vector<float>& row = rows_[(y + 3) % 3];
    if (y < 0 || y >= height_)
      std::fill(row.begin(), row.end(), kNone);
    else
      std::copy_n(map_ + static_cast<size_t>(y) * width_, width_, row.begin() + 1);
    return row.data();
  }

 private:
  static constexpr float kNone = std::numeric_limits<float>::quiet_NaN();
  const float* map_;
  const int height_, width_;
  std::vector<std::vector<float>> rows_;
};

}  // namespace

void median(const float* disparity, int height, int width, int size, float* filtered, const RowKernels& kernels,
            const Workers& workers) {
  const int before = size / 2, after = size - 1 - before;
  parallel_rows(height, workers.threads, workers.interrupted, [&](int begin, int end, const Cancel& cancel) {
    if (size == 3) {
      Padded map(disparity, height, width);
      const float *above = map.row(begin - 1), *here = map.row(begin);
      for (int y = begin; y < end && !cancel.load(std::memory_order_relaxed); ++y) {
        const float* below = map.row(y + 1);
        kernels.median_of_nine(above, here, below, width, filtered + static_cast<size_t>(y) * width);
        above = here;
        here = below;
      }
      return;
    }
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
