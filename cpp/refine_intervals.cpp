// Symmetric matching of the two lines' intervals, after Szeliski and Scharstein, around a winner.
#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include "parallel.hpp"
#include "stages.hpp"
#include "start.hpp"

namespace stereopsis {

namespace {

int clamp(int v, int low, int high) { return std::min(std::max(v, low), high); }

// A line, straight between its pixels, in steps of 1 / steps: what it spans within half a step of each. Values are
// 2 * steps times the pixels', and so whole.
struct Spans {
  std::vector<int32_t> low, high;

  void take(const int32_t* row, int width, int channels, int channel, int steps) {
    const int last = steps * (width - 1);
    low.resize(last + 1);
    high.resize(last + 1);
    const auto value = [&](int half) {
      const int at = clamp(half, 0, 2 * last), x = at / (2 * steps), j = at % (2 * steps);
      const int32_t here = row[x * channels + channel], next = row[std::min(x + 1, width - 1) * channels + channel];
      return (2 * steps - j) * here + j * next;
    };
    for (int i = 0; i <= last; ++i) {
      const int32_t a = value(2 * i - 1), b = value(2 * i), c = value(2 * i + 1);
      low[i] = std::min(a, std::min(b, c));
      high[i] = std::max(a, std::max(b, c));
    }
  }
};

// Sums over columns of the gaps between intervals, for every pixel that a window reaches and every candidate.
class Columns {
 public:
  Columns(const AlignedPair& pair, const Window& window, int steps, int first, int count)
      : p_(pair), w_(window), steps_(steps), first_(first), count_(count),
        columns_(pair.width + window.width - 1), last_(steps * (pair.width - 1)),
        sums_(static_cast<size_t>(columns_) * count) {}

  void start(int y) {
    std::fill(sums_.begin(), sums_.end(), 0);
    for (int v = -w_.above(); v <= w_.below(); ++v) add(y + v, 1);
  }
  void next(int y) {
    add(y - 1 - w_.above(), -1);
    add(y + w_.below(), 1);
  }

  // Costs of the window at x for `n` candidates from i on.
  void costs(int x, int i, int n, int64_t* out) const {
    std::fill(out, out + n, 0);
    for (int u = 0; u < w_.width; ++u) {
      const int64_t* column = &sums_[static_cast<size_t>(x + u) * count_ + i];
      for (int k = 0; k < n; ++k) out[k] += column[k];
    }
  }

 private:
  void add(int y, int sign) {
    const size_t row = static_cast<size_t>(clamp(y, 0, p_.height - 1)) * p_.width * p_.channels;
    const int half = steps_ / 2;
    // The right line backwards, so that candidates run forwards.
    const int rightmost = steps_ * (p_.width - 1 + w_.right()) + half - first_;
    const int size = steps_ * (columns_ - 1) + 2 * half + count_;
    low_.resize(size);
    high_.resize(size);
    for (int c = 0; c < p_.channels; ++c) {
      left_.take(p_.left + row, p_.width, p_.channels, c, steps_);
      right_.take(p_.right + row, p_.width, p_.channels, c, steps_);
      for (int j = 0; j < size; ++j) {
        const int at = clamp(rightmost - j, 0, last_);
        low_[j] = right_.low[at];
        high_[j] = right_.high[at];
      }
      for (int i = 0; i < columns_; ++i)
        for (int s = -half; s <= half; ++s) {
          const int fine = steps_ * (i - w_.left()) + s, at = clamp(fine, 0, last_);
          const int from = rightmost + first_ - fine;
          const int32_t low = left_.low[at], high = left_.high[at];
          gaps(low, high, &low_[from], &high_[from], sign, &sums_[static_cast<size_t>(i) * count_]);
        }
    }
  }

  void gaps(int32_t low, int32_t high, const int32_t* __restrict lows, const int32_t* __restrict highs, int sign,
            int64_t* __restrict sums) const {
    for (int k = 0; k < count_; ++k) sums[k] += sign * std::max(std::max(lows[k] - high, low - highs[k]), 0);
  }

  const AlignedPair p_;
  const Window w_;
  const int steps_;
  const int first_, count_, columns_, last_;
  std::vector<int64_t> sums_;
  std::vector<int32_t> low_, high_;
  Spans left_, right_;
};

}  // namespace

void align_intervals(const AlignedPair& pair, const Window& window, int steps, const float* start, float* disparity,
                     const Workers& workers) {
  const Start from_map(pair, start, disparity);
  if (from_map.none()) return;
  const int first = steps * (from_map.low - 1), count = steps * (from_map.high - from_map.low + 2) + 1, around = 2 * steps + 1;
  parallel_rows(pair.height, workers.threads, workers.interrupted, [&](int begin, int end, const Cancel& cancel) {
    Columns columns(pair, window, steps, first, count);
    std::vector<int64_t> costs(around);
    for (int y = begin; y < end && !cancel.load(std::memory_order_relaxed); ++y) {
      if (y == begin) columns.start(y);
      else columns.next(y);
      for (int x = 0; x < pair.width; ++x) {
        const size_t at = static_cast<size_t>(y) * pair.width + x;
        if (!from_map.in_view(x, at)) continue;
        const int from = steps * (from_map.whole(at) - 1);  // fine candidate of costs[0]
        columns.costs(x, from - first, around, costs.data());
        // What lies in view of candidates from ... from + 2 steps.
        const int lowest = std::max(0, steps * (x - pair.width + 1) - from);
        const int highest = std::min(around - 1, steps * x - from);
        const auto least = std::min_element(costs.begin() + lowest, costs.begin() + highest + 1);
        const int best = static_cast<int>(least - costs.begin());
        // Intervals overlap over a stretch: of equal costs the middle.
        int last = best;
        while (last < highest && costs[last + 1] == *least) ++last;
        double offset = 0.5 * (last - best);
        if (last == best && lowest < best && best < highest) {
          const double before = static_cast<double>(costs[best - 1] - costs[best]);
          const double after = static_cast<double>(costs[best + 1] - costs[best]);
          offset = 0.5 * (before - after) / (before + after);
        }
        disparity[at] = static_cast<float>((from + best + offset) / steps);
      }
    }
  });
}

}  // namespace stereopsis
