#include <algorithm>
#include <cmath>
#include <vector>

#include "parallel.hpp"
#include "stages.hpp"

namespace stereopsis {

namespace {

// Sums over a side x side window that slides down `map`, edge pixels repeated: one row of them at a time.
template <class T>
struct SlidingBox {
  SlidingBox(const std::vector<T>& map, int height, int width, int side, int y)
      : map(map.data()), height(height), width(width), reach(side / 2), next(y - side / 2), column(width), sums(width) {
    for (; next < y + reach; ++next) add(next, 1);
  }
  // The row after the one before; the first: y.
  const T* row() {
    add(next, 1);
    T sum = 0;
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
  void add(int y, int sign) {
    const T* row = map + static_cast<size_t>(clamped(y, height)) * width;
    for (int x = 0; x < width; ++x) column[x] += sign * row[x];
  }
  const T* map;
  int height, width, reach, next;
  std::vector<T> column, sums;
};

// Disparities and their differences count in sixteenths of a pixel, sharpness in 2^-16: fine enough, and whole numbers sum to
// the same bits in any order.
constexpr float kLevels = 16, kSharpness = 65536;
constexpr float kJump = 1.5f, kFarOff = 3;

int32_t whole(float value) { return static_cast<int32_t>(std::lrintf(value)); }

}  // namespace

void probability(const AnsweredMap& map, const LogisticModel& model, float* confidence, const Workers& workers) {
  const int height = map.height, width = map.width;
  const size_t size = static_cast<size_t>(height) * width;
  std::vector<int32_t> valid(size), jump(size), off(size), sharp(size), level(size);
  std::vector<int64_t> square(size);
  parallel_rows(height, workers.threads, workers.interrupted, [&](int begin, int end, const Cancel& cancel) {
    for (int y = begin; y < end && !cancel.load(std::memory_order_relaxed); ++y)
      for (int x = 0; x < width; ++x) {
        const size_t at = static_cast<size_t>(y) * width + x;
        const float here = map.surface[at];
        const auto apart = [&](size_t other) { return std::fabs(map.surface[other] - here); };
        const float left = x > 0 ? apart(at - 1) : 0, right = x + 1 < width ? apart(at + 1) : 0;
        const float up = y > 0 ? apart(at - width) : 0, down = y + 1 < height ? apart(at + width) : 0;
        const float moved = std::fabs(map.winners[at] - here);
        valid[at] = map.answered[at] != 0;
        jump[at] = std::max(std::max(left, right), std::max(up, down)) > kJump;
        off[at] = whole(kLevels * (valid[at] && moved < kFarOff ? moved : kFarOff));
        sharp[at] = whole(kSharpness * map.sharpness[at]);
        level[at] = whole(kLevels * std::min(std::max(here, -8192.0f), 8192.0f));
        square[at] = static_cast<int64_t>(level[at]) * level[at];
      }
  });
  parallel_rows(height, workers.threads, workers.interrupted, [&](int begin, int end, const Cancel& cancel) {
    const auto box = [&](const auto& values, int side) { return SlidingBox(values, height, width, side, begin); };
    auto valid_box = box(valid, 21), jump_box = box(jump, 31), off_box = box(off, 5), sharp_box = box(sharp, 15);
    auto level_near = box(level, 5), level_wide = box(level, 15), level_widest = box(level, 31);
    auto square_box = box(square, 31);
    for (int y = begin; y < end && !cancel.load(std::memory_order_relaxed); ++y) {
      const int32_t *valids = valid_box.row(), *jumps = jump_box.row(), *offs = off_box.row(), *sharps = sharp_box.row();
      const int32_t *near = level_near.row(), *wide = level_wide.row(), *widest = level_widest.row();
      const int64_t* squares = square_box.row();
      for (int x = 0; x < width; ++x) {
        const size_t at = static_cast<size_t>(y) * width + x;
        const int64_t sum = widest[x], variance = 961 * squares[x] - sum * sum;
        const float spread = std::sqrt(static_cast<float>(variance)) / (961 * kLevels);
        const float off_near = std::fabs(level[at] - near[x] / 25.0f) / kLevels;
        const float off_wide = std::fabs(level[at] - wide[x] / 225.0f) / kLevels;
        const float drawn = offs[x] / (25 * kLevels), texture = map.texture[at];
        const float features[LogisticModel::kFeatures] = {map.sharpness[at],
                                                          sharps[x] / (225 * kSharpness),
                                                          valids[x] / 441.0f,
                                                          drawn / (drawn + 0.5f),
                                                          jumps[x] / 961.0f,
                                                          off_near / (off_near + 1),
                                                          off_wide / (off_wide + 1),
                                                          spread / (spread + 2),
                                                          texture / (texture + 8),
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
