#include <algorithm>
#include <cmath>
#include <vector>

#include "parallel.hpp"
#include "stages.hpp"

namespace stereopsis {

namespace {

// Sums over a side x side window that slides down `map`, edge pixels repeated: one row of them at a time.
struct SlidingBox {
  SlidingBox(const int32_t* map, int height, int width, int side, int y)
      : map(map), height(height), width(width), reach(side / 2), next(y - side / 2), column(width), sums(width) {
    for (; next < y + reach; ++next) add(next, 1);
  }
  // The row after the one before; the first: y.
  const int32_t* row() {
    add(next, 1);
    int32_t sum = 0;
    for (int x = -reach; x <= reach; ++x) sum += column[clamped(x, width)];
    for (int x = 0; x < width; ++x) {
      sums[x] = sum;
      sum += column[clamped(x + reach + 1, width)] - column[clamped(x - reach, width)];
    }
    add(next - 2 * reach, -1);
    ++next;
    return sums.data();
  }

 private:
  static int clamped(int v, int size) { return std::min(std::max(v, 0), size - 1); }
  void add(int y, int32_t sign) {
    const int32_t* row = map + static_cast<size_t>(clamped(y, height)) * width;
    for (int x = 0; x < width; ++x) column[x] += sign * row[x];
  }
  const int32_t* map;
  int height, width, reach, next;
  std::vector<int32_t> column, sums;
};

}  // namespace

void probability(const float* surface, const uint8_t* answered, const float* sharpness, int height, int width,
                 const LogisticModel& model, float* confidence, const Workers& workers) {
  const size_t size = static_cast<size_t>(height) * width;
  std::vector<int32_t> valid(size), jump(size), level(size);
  parallel_rows(height, workers.threads, workers.interrupted, [&](int begin, int end, const Cancel& cancel) {
    for (int y = begin; y < end && !cancel.load(std::memory_order_relaxed); ++y)
      for (int x = 0; x < width; ++x) {
        const size_t at = static_cast<size_t>(y) * width + x;
        const auto apart = [&](size_t other) { return !(std::fabs(surface[other] - surface[at]) <= 1.5f); };
        valid[at] = answered[at] != 0;
        jump[at] = (x > 0 && apart(at - 1)) || (x + 1 < width && apart(at + 1)) || (y > 0 && apart(at - width)) ||
                   (y + 1 < height && apart(at + width));
        // A sixteenth of a pixel is fine enough, and whole numbers sum to the same bits in any order.
        level[at] = static_cast<int32_t>(std::lrintf(16 * std::min(std::max(surface[at], -8192.0f), 8192.0f)));
      }
  });
  parallel_rows(height, workers.threads, workers.interrupted, [&](int begin, int end, const Cancel& cancel) {
    const auto box = [&](const std::vector<int32_t>& map, int side) { return SlidingBox(map.data(), height, width, side, begin); };
    SlidingBox valid_near = box(valid, 21), valid_wide = box(valid, 41), jump_near = box(jump, 5), jump_wide = box(jump, 15),
               jump_widest = box(jump, 31), level_near = box(level, 5), level_wide = box(level, 15);
    for (int y = begin; y < end && !cancel.load(std::memory_order_relaxed); ++y) {
      const int32_t *v0 = valid_near.row(), *v1 = valid_wide.row(), *j0 = jump_near.row(), *j1 = jump_wide.row(),
                    *j2 = jump_widest.row(), *l0 = level_near.row(), *l1 = level_wide.row();
      for (int x = 0; x < width; ++x) {
        const size_t at = static_cast<size_t>(y) * width + x;
        const float near = std::fabs(level[at] - l0[x] / 25.0f) / 16, wide = std::fabs(level[at] - l1[x] / 225.0f) / 16;
        const float close = std::fabs(level[at] / 16.0f);
        const float features[LogisticModel::kFeatures] = {sharpness[at],
                                                          sharpness[at] / (sharpness[at] + 0.05f),
                                                          v0[x] / 441.0f,
                                                          v1[x] / 1681.0f,
                                                          j0[x] / 25.0f,
                                                          j1[x] / 225.0f,
                                                          j2[x] / 961.0f,
                                                          near / (near + 1),
                                                          wide / (wide + 1),
                                                          close / (close + 16),
                                                          1};
        const float* weights = valid[at] ? model.answered : model.filled;
        float score = 0;
        for (int k = 0; k < LogisticModel::kFeatures; ++k) score += weights[k] * features[k];
        // The logistic function, straight between the table's entries.
        const float place = std::min(std::max((score + 8) * 16, 0.0f), 255.99f);
        const int cell = static_cast<int>(place);
        confidence[at] = model.logistic[cell] + (place - cell) * (model.logistic[cell + 1] - model.logistic[cell]);
      }
    }
  });
}

}  // namespace stereopsis
