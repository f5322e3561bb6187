// Moves disparities by what is left between the grey levels of both views: one step of Gauss and Newton in each window.
#include "photometric.hpp"

#include <cmath>
#include <vector>

#include "parallel.hpp"
#include "scratch.hpp"
#include "stages.hpp"

namespace stereopsis {

namespace {

constexpr int kUnit = kPhotometricUnit, kAlong = kPhotometricAlong, kAcross = kPhotometricAcross;
using Factors = const int16_t* [kPhotometricFactors];

void compare_row(const float* disparity, const uint8_t* doubtful, const uint8_t* left, const uint8_t* right, int width, int16_t* seen,
                 int16_t* brighter) {
  for (int x = 0; x < width; ++x) {
    brighter[x] = seen[x] = 0;
    if (doubtful[x] || std::isnan(disparity[x]) || x == 0 || x == width - 1) continue;
    const int at = kUnit * x - parts_of(disparity[x], kUnit), part = at % kUnit;
    if (at < 0 || at >= kUnit * (width - 1)) continue;
    const uint8_t* const r = right + at / kUnit;
    brighter[x] = static_cast<int16_t>(kUnit * left[x] - (kUnit - part) * r[0] - part * r[1]);
    seen[x] = 1;
  }
}

// The first terms, so many, summed over windows. Where a window leaves the image it is smaller.
class WindowSums {
 public:
  WindowSums(int width, int terms, const PhotometricKernel& kernel)
      : width_(width), terms_(terms), kernel_(kernel), columns_(static_cast<size_t>(terms) * (width + 2 * kAlong)),
        threes_(width + 2 * kAlong), sums_(static_cast<size_t>(terms) * width) {
    for (int k = 0; k < terms; ++k) sum_[k] = sums_.get() + static_cast<size_t>(k) * width;
  }

  void change(const Factors& added, const Factors& removed) {
    for (int k = 0; k < terms_; ++k) {
      const auto [a, b] = kPhotometricTerm[k];
      kernel_.change(added[a], added[b], removed[a], removed[b], width_, columns(k));
    }
  }

  const int32_t* const* take() {
    for (int k = 0; k < terms_; ++k) kernel_.sum(columns(k), width_, threes_.get(), sum_[k]);
    return sum_;
  }

 private:
  int32_t* columns(int k) { return columns_.data() + static_cast<size_t>(k) * (width_ + 2 * kAlong) + kAlong; }

  const int width_, terms_;
  const PhotometricKernel& kernel_;
  std::vector<int32_t> columns_;
  Unset<int32_t> threes_, sums_;
  int32_t* sum_[kPhotometricTerms];
};

// For rows begin to end - 1 the sums of all windows on each: `factors(y, found)` is what a row adds, `take(y, sums)`.
template <class Rows, class Take>
void over_windows(int height, int width, int begin, int end, const Cancel& cancel, WindowSums sums, const Rows& factors, const Take& take) {
  const std::vector<int16_t> none(width);
  const auto look_up = [&](int y, Factors& found) {
    if (y >= 0 && y < height)
      factors(y, found);
    else
      for (auto& factor : found) factor = none.data();
  };
  Factors added, removed;
  look_up(-1, removed);
  for (int y = begin - kAcross; y < begin + kAcross; ++y) look_up(y, added), sums.change(added, removed);
  for (int y = begin; y < end && !cancel.load(std::memory_order_relaxed); ++y) {
    look_up(y + kAcross, added);
    if (y > begin) look_up(y - kAcross - 1, removed);
    sums.change(added, removed);
    take(y, sums.take());
  }
}

}  // namespace

void photometric(const float* disparity, const uint8_t* doubtful, const GreyPair& grey, int height, int width, float least, float most,
                 float* moved, const PhotometricKernel& kernel, const Workers& workers) {
  const auto at = [width](int y) { return static_cast<size_t>(y) * width; };
  Unset<int16_t> seen(at(height)), brighter(at(height)), counts(at(height));  // what counts is seen, and no outlier
  parallel_rows(height, workers.threads, workers.interrupted, [&](int begin, int end, const Cancel& cancel) {
    for (int y = begin; y < end && !cancel.load(std::memory_order_relaxed); ++y)
      compare_row(disparity + at(y), doubtful + at(y), grey.left + at(y), grey.right + at(y), width, seen.get() + at(y),
                  brighter.get() + at(y));
  });
  parallel_rows(height, workers.threads, workers.interrupted, [&](int begin, int end, const Cancel& cancel) {
    const auto factors = [&](int y, Factors& found) { found[kCounts] = seen.get() + at(y), found[kBrighter] = brighter.get() + at(y); };
    over_windows(height, width, begin, end, cancel, WindowSums(width, 2, kernel), factors, [&](int y, const int32_t* const* sums) {
      kernel.keep(seen.get() + at(y), brighter.get() + at(y), sums[0], sums[1], width, counts.get() + at(y));
    });
  });
  parallel_rows(height, workers.threads, workers.interrupted, [&](int begin, int end, const Cancel& cancel) {
    // A row's factors are made when it comes, and still there when it goes.
    constexpr int kRows = 2 * kAcross + 2, kMade = kPhotometricFactors - 1;
    Unset<int16_t> made(at(kRows * kMade));
    std::vector<int> which(kRows, -1);
    const auto factors = [&](int y, Factors& found) {
      int16_t* const row = made.get() + at(y % kRows * kMade);
      if (which[y % kRows] != y)
        kernel.describe(counts.get() + at(y), brighter.get() + at(y), grey.left + at(y), width, row, row + at(1), row + at(2));
      which[y % kRows] = y;
      found[kCounts] = counts.get() + at(y), found[kBrighter] = row, found[kSlope] = row + at(1), found[kLevel] = row + at(2);
    };
    over_windows(height, width, begin, end, cancel, WindowSums(width, kPhotometricTerms, kernel), factors,
                 [&](int y, const int32_t* const* sums) {
                   kernel.move(sums, disparity + at(y), doubtful + at(y), width, least, most, moved + at(y));
                 });
  });
}

}  // namespace stereopsis
