#include <algorithm>
#include <atomic>
#include <cmath>
#include <limits>
#include <vector>

#include "parallel.hpp"
#include "smooth.hpp"
#include "stages.hpp"

namespace stereopsis {

namespace {

constexpr float kNone = std::numeric_limits<float>::quiet_NaN();

float lower(float a, float b) { return std::isnan(a) || b < a ? b : a; }

}  // namespace

template <class T>
void background(const T* disparity, int height, int width, T* filled, const Workers& workers) {
  constexpr T none = std::numeric_limits<T>::quiet_NaN();
  parallel_rows(height, workers.threads, workers.interrupted, [&](int begin, int end, const Cancel& cancel) {
    for (int y = begin; y < end && !cancel.load(std::memory_order_relaxed); ++y) {
      const T* from = disparity + static_cast<size_t>(y) * width;
      T* to = filled + static_cast<size_t>(y) * width;
      T before = none;
      for (int x = 0; x < width;) {
        if (std::isfinite(from[x])) {
          to[x] = before = from[x];
          ++x;
          continue;
        }
        int next = x;
        while (next < width && !std::isfinite(from[next])) ++next;
        const T after = next < width ? from[next] : before;
        std::fill(to + x, to + next, std::isnan(before) || after < before ? after : before);
        x = next;
      }
    }
  });
  // Each row is now answered throughout or not at all.
  const auto answered = [&](int y) { return width > 0 && !std::isnan(filled[static_cast<size_t>(y) * width]); };
  const auto repeat = [&](int from, int to) { std::copy_n(filled + static_cast<size_t>(from) * width, width, filled + static_cast<size_t>(to) * width); };
  int first = 0, last = height - 1;
  while (first < height && !answered(first)) ++first;
  if (first == height) return;
  while (!answered(last)) --last;
  for (int y = 0; y < first; ++y) repeat(first, y);
  for (int y = last + 1; y < height; ++y) repeat(last, y);
}
template void background(const float*, int, int, float*, const Workers&);
template void background(const double*, int, int, double*, const Workers&);

void interpolate(const float* disparity, const uint8_t* occluded, int height, int width, float* filled, const Workers& workers) {
  // Two sweeps over the rows carry the nearest answers along: from above and from the left, then from below and the right.
  parallel_rows(1, 1, workers.interrupted, [&](int, int, const Cancel& cancel) {
    std::vector<float> first;
    for (int sweep = 0; sweep < 2; ++sweep) {
      // By column: the nearest answers along the two diagonals and straight, as the row before saw them.
      std::vector<float> carried[3], now[3];
      for (int k = 0; k < 3; ++k) carried[k].assign(width + 2, kNone), now[k].assign(width + 2, kNone);
      const int step = sweep ? -1 : 1;
      for (int row = 0; row < height && !cancel.load(std::memory_order_relaxed); ++row) {
        const int y = sweep ? height - 1 - row : row;
        float beside = kNone;
        for (int column = 0; column < width; ++column) {
          const int x = sweep ? width - 1 - column : column;
          const size_t at = static_cast<size_t>(y) * width + x;
          const float value = disparity[at], around[4] = {beside, carried[0][x + 1 - step], carried[1][x + 1],
                                                          carried[2][x + 1 + step]};
          if (!std::isnan(value)) {
            beside = filled[at] = value;
            for (auto& line : now) line[x + 1] = value;
            continue;
          }
          for (int k = 0; k < 3; ++k) now[k][x + 1] = around[k + 1];
          if (sweep == 0) {
            first.insert(first.end(), around, around + 4);
            continue;
          }
          float found[8];
          int count = 0;
          for (int k = 0; k < 4; ++k)
            for (const float answer : {around[k], *(first.end() - 4 + k)})
              if (!std::isnan(answer)) found[count++] = answer;
          first.resize(first.size() - 4);
          std::sort(found, found + count);
          if (count == 0)
            filled[at] = kNone;
          else if (occluded[at])
            filled[at] = found[std::min(1, count - 1)];
          else
            filled[at] = count % 2 ? found[count / 2] : 0.5f * (found[count / 2 - 1] + found[count / 2]);
        }
        for (int k = 0; k < 3; ++k) std::swap(carried[k], now[k]);
      }
    }
  });
}

void nearer(const float* disparity, const uint8_t* doubtful, const float* again, int height, int width, float* found, const Workers& workers) {
  parallel_rows(height, workers.threads, workers.interrupted, [&](int begin, int end, const Cancel& cancel) {
    for (int y = begin; y < end && !cancel.load(std::memory_order_relaxed); ++y) {
      const size_t row = static_cast<size_t>(y) * width;
      const auto stands = [&](int x) { return !doubtful[row + x] && !std::isnan(disparity[row + x]); };
      float before = kNone;
      for (int x = 0; x < width;) {
        if (stands(x)) {
          before = found[row + x] = disparity[row + x];
          ++x;
          continue;
        }
        int next = x;
        while (next < width && !stands(next)) ++next;
        const float after = next < width ? disparity[row + next] : before;
        const float least = lower(before, after), most = -lower(-before, -after);
        for (; x < next; ++x) {
          const float first = disparity[row + x], second = std::min(std::max(again[row + x], least), most);
          found[row + x] = doubtful[row + x] && !std::isnan(least) && second > first ? second : first;
        }
      }
    }
  });
}

void fill_surfaces(const float* disparity, const uint8_t* occluded, const SurfaceGuide& guide, int height, int width, float least,
                   float most, float* filled, const Workers& workers) {
  const size_t size = static_cast<size_t>(height) * width;
  const Slopes slopes = surface_slopes(disparity, guide.image, height, width, guide.channels, guide.coarse, guide.length, workers);
  // Continued from above and below, down and up every column.
  const Unset<float> above(size), below(size), range(size), weight(size), base(size), value(size);
  parallel_rows(width, workers.threads, workers.interrupted, [&](int begin, int end, const Cancel& cancel) {
    for (int y = 0; y < height && !cancel.load(std::memory_order_relaxed); ++y)
      for (int x = begin; x < end; ++x) {
        const size_t at = static_cast<size_t>(y) * width + x;
        above[at] = !std::isnan(disparity[at]) ? disparity[at] : y ? above[at - width] + slopes.down[slopes.cell(y - 1, x)] : kNone;
      }
    for (int y = height - 1; y >= 0 && !cancel.load(std::memory_order_relaxed); --y)
      for (int x = begin; x < end; ++x) {
        const size_t at = static_cast<size_t>(y) * width + x;
        below[at] = !std::isnan(disparity[at]) ? disparity[at] : y + 1 < height ? below[at + width] - slopes.down[slopes.cell(y, x)] : kNone;
      }
  });
  std::atomic<bool> lost{false};  // whether some pixel sees no answer
  parallel_rows(height, workers.threads, workers.interrupted, [&](int begin, int end, const Cancel& cancel) {
    std::vector<float> before(width);
    for (int y = begin; y < end && !cancel.load(std::memory_order_relaxed); ++y) {
      const size_t row = static_cast<size_t>(y) * width;
      float carried = kNone;
      for (int x = 0; x < width; ++x) {
        if (x) carried += slopes.right[slopes.cell(y, x - 1)];
        if (!std::isnan(disparity[row + x])) carried = disparity[row + x];
        before[x] = carried;
      }
      carried = kNone;
      bool none = false;
      for (int x = width - 1; x >= 0; --x) {
        const size_t at = row + x;
        carried -= slopes.right[slopes.cell(y, x)];
        if (!std::isnan(disparity[at])) {
          carried = filled[at] = value[at] = disparity[at];
          weight[at] = 1;
          continue;
        }
        float low = kNone, high = kNone;
        for (const float answer : {before[x], carried, above[at], below[at]}) {
          low = lower(low, answer);
          high = -lower(-high, -answer);
        }
        range[at] = high - low;
        const float beside = lower(before[x], carried);
        value[at] = base[at] = std::isnan(beside) ? lower(above[at], below[at]) : beside;
        weight[at] = 1e-6f;
        none |= std::isnan(base[at]);
      }
      if (none) lost.store(true, std::memory_order_relaxed);
    }
  });
  if (lost.load()) {
    std::vector<float> answers;
    for (size_t at = 0; at < size; ++at)
      if (!std::isnan(disparity[at])) answers.push_back(disparity[at]);
    if (answers.empty()) {
      std::fill(filled, filled + size, kNone);
      return;
    }
    std::nth_element(answers.begin(), answers.begin() + answers.size() / 2, answers.end());
    const float middle = answers[answers.size() / 2];
    for (size_t at = 0; at < size; ++at)
      if (std::isnan(value[at])) value[at] = middle;
  }
  const EdgeWeights edges = edge_weights(guide.image, height, width, guide.channels, guide.fine, guide.length, workers);
  smooth({{value.get(), weight.get()}}, &slopes, height, width, edges, guide.strength, 2, workers);
  parallel_rows(height, workers.threads, workers.interrupted, [&](int begin, int end, const Cancel&) {
    for (size_t at = static_cast<size_t>(begin) * width; at < static_cast<size_t>(end) * width; ++at) {
      if (!std::isnan(disparity[at])) continue;
      const bool surface = std::isnan(base[at]) || range[at] <= (occluded[at] ? 8.0f : 12.0f);
      filled[at] = std::min(std::max(surface ? value[at] : base[at], least), most);
    }
  });
}

}  // namespace stereopsis
