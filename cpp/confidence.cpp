#include <algorithm>
#include <cmath>
#include <vector>

#include "parallel.hpp"
#include "scratch.hpp"
#include "stages.hpp"

namespace stereopsis {

namespace {

// Sums over a side x side window that slides down `map`, edge pixels repeated: one row of them at a time.
template <class T>
struct SlidingBox {
  SlidingBox(const T* map, int height, int width, int side, int y)
      : map(map), height(height), width(width), reach(side / 2), next(y - side / 2), column(width + side), sums(width) {
    for (; next < y + reach; ++next) add(next, 1);
  }
  // The row after the one before; the first: y.
  const T* row() {
    add(next, 1);
    T *first = column.data() + reach, *last = first + width - 1;
    std::fill(column.data(), first, *first);
    std::fill(last + 1, column.data() + column.size(), *last);
    const int side = 2 * reach + 1;
    T sum = 0;
    for (int u = 0; u < side; ++u) sum += column[u];
    for (int x = 0; x < width; ++x) {
      sums[x] = sum;
      sum += column[x + side] - column[x];
    }
    add(next - 2 * reach, -1);
    ++next;
    return sums.data();
  }

 private:
  void add(int y, T sign) {
    const T* row = map + static_cast<size_t>(std::min(std::max(y, 0), height - 1)) * width;
    T* inner = column.data() + reach;
    for (int x = 0; x < width; ++x) inner[x] += sign * row[x];
  }
  const T* map;
  int height, width, reach, next;
  std::vector<T> column, sums;
};

// Disparities and their differences count in sixteenths of a pixel, sharpness in 2^-16: fine enough, and whole numbers sum to
// the same bits in any order.
constexpr float kLevels = 16, kSharpness = 65536;
constexpr float kJump = 1.5f, kFarOff = 3;

// To the nearest, of two to the even one: so large a number has no fraction. Up to 2^21 either way.
inline int32_t whole(float value) { return static_cast<int32_t>(value + 12582912.0f) - 12582912; }

}  // namespace

void probability(const AnsweredMap& map, const LogisticModel& model, float* confidence, const Workers& workers) {
  const int height = map.height, width = map.width;
  const size_t size = static_cast<size_t>(height) * width;
  const Unset<int32_t> valid(size), jump(size), off(size), sharp(size), level(size);
  const Unset<double> square(size);  // their sums are exact as well
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
        square[at] = static_cast<double>(level[at]) * level[at];
      }
  });
  parallel_rows(height, workers.threads, workers.interrupted, [&](int begin, int end, const Cancel& cancel) {
    const auto box = [&](const auto& values, int side) { return SlidingBox(values.get(), height, width, side, begin); };
    auto valid_box = box(valid, 21), jump_box = box(jump, 31), off_box = box(off, 5), sharp_box = box(sharp, 15);
    auto level_near = box(level, 5), level_wide = box(level, 15), level_widest = box(level, 31);
    auto square_box = box(square, 31);
    std::vector<float> scores(width);
    for (int y = begin; y < end && !cancel.load(std::memory_order_relaxed); ++y) {
      const int32_t *valids = valid_box.row(), *jumps = jump_box.row(), *offs = off_box.row(), *sharps = sharp_box.row();
      const int32_t *near = level_near.row(), *wide = level_wide.row(), *widest = level_widest.row();
      const double* squares = square_box.row();
      const size_t start = static_cast<size_t>(y) * width;
      const float *sharpness = map.sharpness + start, *texture = map.texture + start;
      const int32_t *own = level.get() + start, *on = valid.get() + start;
      for (int x = 0; x < width; ++x) {
        const double sum = widest[x], variance = std::max(961 * squares[x] - sum * sum, 0.0);
        const float spread = static_cast<float>(std::sqrt(variance)) / (961 * kLevels);
        const float off_near = std::fabs(own[x] - near[x] / 25.0f) / kLevels;
        const float off_wide = std::fabs(own[x] - wide[x] / 225.0f) / kLevels;
        const float drawn = offs[x] / (25 * kLevels);
        const float features[LogisticModel::kFeatures] = {sharpness[x],
                                                          sharps[x] / (225 * kSharpness),
                                                          valids[x] / 441.0f,
                                                          drawn / (drawn + 0.5f),
                                                          jumps[x] / 961.0f,
                                                          off_near / (off_near + 1),
                                                          off_wide / (off_wide + 1),
                                                          spread / (spread + 2),
                                                          texture[x] / (texture[x] + 8),
                                                          1};
        float answered = 0, filled = 0;
        for (int k = 0; k < LogisticModel::kFeatures; ++k) {
          answered += model.answered[k] * features[k];
          filled += model.filled[k] * features[k];
        }
        scores[x] = on[x] ? answered : filled;
      }
      for (int x = 0; x < width; ++x) {
        // The logistic function, straight between the table's entries.
        const float place = std::min(std::max((scores[x] + 8) * 16, 0.0f), 255.99f);
        const int cell = static_cast<int>(place);
        confidence[start + x] = model.logistic[cell] + (place - cell) * (model.logistic[cell + 1] - model.logistic[cell]);
      }
    }
  });
}

}  // namespace stereopsis
