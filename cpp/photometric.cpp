// Moves disparities by what is left between the grey levels of both views: one step of Gauss and Newton in each window.
#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <vector>

#include "parallel.hpp"
#include "scratch.hpp"
#include "stages.hpp"

namespace stereopsis {

namespace {

constexpr int kUnit = 256;               // parts of a pixel, and of a grey level
constexpr int kAlong = 7, kAcross = 4;   // windows of 15 x 9
constexpr int kArea = (2 * kAlong + 1) * (2 * kAcross + 1);
constexpr int kOutlier = 20 * kUnit;     // so far from the window's mean a difference does not count
constexpr int kLeast = kArea / 3;        // pixels that a window has to have
constexpr int64_t kNoise = 5 * kArea;    // added to the squares of the levels: what noise alone would show
// The difference may grow with the left grey level: of two views one is at most twice as bright.
constexpr double kLeastGain = -kUnit, kMostGain = kUnit / 2;
constexpr double kFarthest = 0.5;

// How much brighter a pixel is than its match, in units, and the difference of its neighbours, whose noise neither
// of the two shares.
struct Differences {
  explicit Differences(size_t size) : brighter(size), slope(size), counts(size) {}
  Unset<int32_t> brighter;
  Unset<int16_t> slope;
  Unset<uint8_t> counts;
};

void compare_row(const float* disparity, const uint8_t* doubtful, const uint8_t* left, const uint8_t* right, int width,
                 int32_t* brighter, int16_t* slope, uint8_t* counts) {
  for (int x = 0; x < width; ++x) {
    brighter[x] = slope[x] = counts[x] = 0;
    if (doubtful[x] || std::isnan(disparity[x]) || x == 0 || x == width - 1) continue;
    const int at = kUnit * x - parts_of(disparity[x], kUnit), part = at % kUnit;
    if (at < 0 || at >= kUnit * (width - 1)) continue;
    const uint8_t* const r = right + at / kUnit;
    brighter[x] = kUnit * left[x] - (kUnit - part) * r[0] - part * r[1];
    slope[x] = static_cast<int16_t>(left[x + 1] - left[x - 1]);
    counts[x] = 1;
  }
}

// Sums over windows, kept as sums over columns; `Terms` of them at once. Where a window leaves the image it is smaller.
template <int Terms>
class WindowSums {
 public:
  explicit WindowSums(int width) : width_(width), columns_(static_cast<size_t>(width) * Terms) {}

  template <class Term>
  void add(int sign, const Term& term) {
    int64_t terms[Terms];
    for (int x = 0; x < width_; ++x) {
      term(x, terms);
      for (int k = 0; k < Terms; ++k) columns_[static_cast<size_t>(x) * Terms + k] += sign * terms[k];
    }
  }

  template <class Take>
  void take(const Take& take) const {
    int64_t sums[Terms] = {};
    for (int x = 0; x < std::min(kAlong, width_); ++x) slide(x, 1, sums);
    for (int x = 0; x < width_; ++x) {
      if (x + kAlong < width_) slide(x + kAlong, 1, sums);
      take(x, sums);
      if (x >= kAlong) slide(x - kAlong, -1, sums);
    }
  }

 private:
  void slide(int x, int sign, int64_t* sums) const {
    for (int k = 0; k < Terms; ++k) sums[k] += sign * columns_[static_cast<size_t>(x) * Terms + k];
  }

  const int width_;
  std::vector<int64_t> columns_;
};

// For rows begin to end - 1 the sums of all windows on each: `term(row, x, terms)` is what a pixel adds, `take(row, x, sums)`.
template <int Terms, class Term, class Take>
void over_windows(int height, int width, int begin, int end, const Cancel& cancel, const Term& term, const Take& take) {
  WindowSums<Terms> sums(width);
  const auto row = [&](int y, int sign) {
    if (y >= 0 && y < height) sums.add(sign, [&](int x, int64_t* terms) { term(y, x, terms); });
  };
  for (int y = begin - kAcross; y < begin + kAcross; ++y) row(y, 1);
  for (int y = begin; y < end && !cancel.load(std::memory_order_relaxed); ++y) {
    row(y + kAcross, 1);
    sums.take([&](int x, const int64_t* sum) { take(y, x, sum); });
    row(y - kAcross, -1);
  }
}

}  // namespace

void photometric(const float* disparity, const uint8_t* doubtful, const GreyPair& grey, int height, int width, float least, float most,
                 float* moved, const Workers& workers) {
  const auto at = [width](int y, int x) { return static_cast<size_t>(y) * width + x; };
  Differences seen(at(height, 0));
  Unset<uint8_t> counts(at(height, 0));  // without outliers
  parallel_rows(height, workers.threads, workers.interrupted, [&](int begin, int end, const Cancel& cancel) {
    for (int y = begin; y < end && !cancel.load(std::memory_order_relaxed); ++y)
      compare_row(disparity + at(y, 0), doubtful + at(y, 0), grey.left + at(y, 0), grey.right + at(y, 0), width,
                  seen.brighter.get() + at(y, 0), seen.slope.get() + at(y, 0), seen.counts.get() + at(y, 0));
  });
  parallel_rows(height, workers.threads, workers.interrupted, [&](int begin, int end, const Cancel& cancel) {
    const auto term = [&](int y, int x, int64_t* terms) {
      terms[0] = seen.counts[at(y, x)];
      terms[1] = seen.brighter[at(y, x)];
    };
    over_windows<2>(height, width, begin, end, cancel, term, [&](int y, int x, const int64_t* sums) {
      const size_t p = at(y, x);
      counts[p] = seen.counts[p] && std::abs(seen.brighter[p] * sums[0] - sums[1]) < kOutlier * sums[0];
    });
  });
  parallel_rows(height, workers.threads, workers.interrupted, [&](int begin, int end, const Cancel& cancel) {
    const auto term = [&](int y, int x, int64_t* terms) {
      const size_t p = at(y, x);
      const int64_t count = counts[p], e = count * seen.brighter[p], g = count * seen.slope[p], level = count * grey.left[p];
      terms[0] = count, terms[1] = e, terms[2] = g, terms[3] = level;
      terms[4] = e * g, terms[5] = e * level, terms[6] = g * g, terms[7] = g * level, terms[8] = level * level;
    };
    over_windows<9>(height, width, begin, end, cancel, term, [&](int y, int x, const int64_t* sums) {
      const size_t p = at(y, x);
      moved[p] = disparity[p];
      const int64_t n = sums[0], e = sums[1], g = sums[2], level = sums[3];
      if (doubtful[p] || n < kLeast || std::isnan(disparity[p])) return;
      const double eg = static_cast<double>(sums[4] * n - e * g), el = static_cast<double>(sums[5] * n - e * level);
      const double gg = static_cast<double>(sums[6] * n - g * g + 4 * kNoise * n), gl = static_cast<double>(sums[7] * n - g * level);
      const double ll = static_cast<double>(sums[8] * n - level * level + kNoise * n);
      const double gain = std::min(std::max(el / ll, kLeastGain), kMostGain);
      // The slope is the left view's, which the right one's is but for the gain.
      const double by = 2 * (gain * gl - eg) / ((kUnit - gain) * (gg - gl * gl / ll));
      const float found = disparity[p] + static_cast<float>(std::min(std::max(by, -kFarthest), kFarthest));
      moved[p] = std::min(std::max(found, least), most);
    });
  });
}

}  // namespace stereopsis
