#include <algorithm>
#include <cmath>
#include <limits>
#include <mutex>
#include <utility>
#include <vector>

#include "parallel.hpp"
#include "rows.hpp"
#include "stages.hpp"

namespace stereopsis {

namespace {

// Rows of the map in turn, with no value beyond its edges.
class Padded {
 public:
  // So many rows in turn are there at once, with a margin to match.
  Padded(const float* map, int height, int width, int side)
      : map_(map), height_(height), width_(width), margin_(side / 2),
        rows_(side, std::vector<float>(width + 2 * margin_ + kRowRoom, kNone)) {}
  // The row from its margin on.
  const float* row(int y) {
    std::vector<float>& row = rows_[(y + rows_.size()) % rows_.size()];
    if (y < 0 || y >= height_)
      std::fill(row.begin(), row.end(), kNone);
    else
      std::copy_n(map_ + static_cast<size_t>(y) * width_, width_, row.begin() + margin_);
    return row.data();
  }

 private:
  static constexpr float kNone = std::numeric_limits<float>::quiet_NaN();
  const float* map_;
  const int height_, width_, margin_;
  std::vector<std::vector<float>> rows_;
};

}  // namespace

void median(const float* disparity, int height, int width, int size, float* filtered, const RowKernels& kernels,
            const Workers& workers) {
  const int before = size / 2, after = size - 1 - before;
  const bool in_place = filtered == disparity, few = size == 3 || size == 5;
  std::vector<float> copy;
  if (in_place && !few) {
    copy.assign(disparity, disparity + static_cast<size_t>(height) * width);
    disparity = copy.data();
  }
  // In place, rows that another band may still have to read wait until all are done.
  std::mutex mutex;
  std::vector<std::pair<float*, std::vector<float>>> waiting;
  const int64_t pixels = static_cast<int64_t>(height) * width;
  const int grain = size == 3 ? 1 << 17 : size == 5 ? 1 << 15 : 1 << 10;
  quick_rows(height, pixels, grain, workers.threads, workers.interrupted, [&](int begin, int end, const Cancel& cancel) {
    if (few) {
      Padded map(disparity, height, width, size);
      std::vector<const float*> rows(1);
      for (int y = begin - before; y < begin + after; ++y) rows.push_back(map.row(y));
      for (int y = begin; y < end && !cancel.load(std::memory_order_relaxed); ++y) {
        rows.erase(rows.begin());
        rows.push_back(map.row(y + after));
        float *const own = filtered + static_cast<size_t>(y) * width, *to = own;
        if (in_place && (y < begin + after || y >= end - before)) {
          const std::lock_guard<std::mutex> lock(mutex);
          waiting.emplace_back(own, std::vector<float>(width));
          to = waiting.back().second.data();
        }
        if (size == 3)
          kernels.median_of_nine(rows[0], rows[1], rows[2], width, to);
        else
          kernels.median_of_25(rows.data(), width, to);
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
  for (const auto& [row, values] : waiting) std::copy(values.begin(), values.end(), row);
}

}  // namespace stereopsis
