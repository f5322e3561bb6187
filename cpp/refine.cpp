#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include "parallel.hpp"
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

// Median of those of nine pixels that have a value, by minima and maxima alone, which vectorise: in order, what has no value
// coming last, the median is the mean of places (n - 1) / 2 and n / 2.
void median_of_nine(const float* __restrict above, const float* __restrict here, const float* __restrict below, int width,
                    float* __restrict filtered) {
  constexpr float last = std::numeric_limits<float>::infinity();
  for (int x = 0; x < width; ++x) {
    float v[9] = {above[x], above[x + 1], above[x + 2], here[x], here[x + 1], here[x + 2], below[x], below[x + 1], below[x + 2]};
    float n = 0;
    for (float& value : v) {
      n += value == value ? 1.0f : 0.0f;
      value = value == value ? value : last;
    }
    const auto order = [&](int i, int k) {
      const float a = v[i], b = v[k];
      v[i] = a < b ? a : b;
      v[k] = a < b ? b : a;
    };
    // Floyd's network, whose 25 exchanges sort nine.
    order(0, 1), order(3, 4), order(6, 7), order(1, 2), order(4, 5), order(7, 8), order(0, 1), order(3, 4), order(6, 7);
    order(0, 3), order(3, 6), order(0, 3), order(1, 4), order(4, 7), order(1, 4), order(2, 5), order(5, 8), order(2, 5);
    order(1, 3), order(5, 7), order(2, 6), order(4, 6), order(2, 4), order(2, 3), order(5, 6);
    float lower = v[4], upper = v[4];
    for (int k = 3; k >= 0; --k) {
      lower = n < static_cast<float>(2 * k + 3) ? v[k] : lower;
      upper = n < static_cast<float>(2 * k + 2) ? v[k] : upper;
    }
    const float middle = here[x + 1], median = lower == upper ? lower : 0.5f * (lower + upper);
    filtered[x] = middle == middle ? median : middle;
  }
}

}  // namespace

void median(const float* disparity, int height, int width, int size, float* filtered, const Workers& workers) {
  const int before = size / 2, after = size - 1 - before;
  parallel_rows(height, workers.threads, workers.interrupted, [&](int begin, int end, const Cancel& cancel) {
    if (size == 3) {
      Padded map(disparity, height, width);
      const float *above = map.row(begin - 1), *here = map.row(begin);
      for (int y = begin; y < end && !cancel.load(std::memory_order_relaxed); ++y) {
        const float* below = map.row(y + 1);
        median_of_nine(above, here, below, width, filtered + static_cast<size_t>(y) * width);
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
