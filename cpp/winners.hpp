// From a row's winners to its disparities: the checks, the sub-pixel fit, the flags and the confidence.
#pragma once

#include <limits>

#include "fused.hpp"
#include "score.hpp"

namespace stereopsis {
namespace {

enum FlagBit : uint8_t { kOccluded = 1, kMismatched = 2, kAmbiguous = 4, kOutOfView = 32 };

template <class T>
constexpr T worst_cost() {
  return std::numeric_limits<T>::is_integer ? std::numeric_limits<T>::max() : std::numeric_limits<T>::infinity();
}

template <class Scalar>
struct RowWinners {
  const int32_t* winner;  // index of the winning candidate, or -1 where none is in view
  const Scalar *cost, *before, *after;
  const Scalar* second;        // least cost apart from the winner and its neighbours; with uniqueness alone
  const int32_t* right_index;  // winner of right pixel x - first - i at [width - 1 - x + i]; with the left-right check alone
};

// Whether the right view's winner at the match of pixel x, candidate i, agrees with it; if not, whether any candidate
// of x would have been agreed with: then the match is wrong, else the pixel is hidden in the right view (Hirschmueller
// 2008, doi:10.1109/TPAMI.2007.1166).
inline uint8_t check_left_right(const int32_t* right, int i, int lo, int hi, float tolerance) {
  const auto agrees = [&](int candidate) {
    const int difference = right[candidate] - candidate;
    return static_cast<float>(difference < 0 ? -difference : difference) <= tolerance;
  };
  if (agrees(i)) return 0;
  bool any = false;
  for (int k = lo; k < hi; ++k) any |= agrees(k);
  return any ? kMismatched : kOccluded;
}

// Disparity and confidence of pixels [begin, end), all of which see a candidate, as if no check were on.
template <Subpixel Kind, class Scalar>
inline void fit(const Pair& pair, float perfect, const RowWinners<Scalar>& row, int begin, int end,
                float* __restrict disparity, float* __restrict confidence) {
  const int32_t* __restrict winner = row.winner;
  const Scalar* __restrict costs = row.cost;
  const Scalar* __restrict costs_before = row.before;
  const Scalar* __restrict costs_after = row.after;
  const int first = pair.first, count = pair.count, beyond = pair.first + pair.width - 1;
  for (int x = begin; x < end; ++x) {
    const int lo = x > beyond ? x - beyond : 0;
    const int hi = x - first + 1 < count ? x - first + 1 : count;
    const int i = winner[x];
    const bool has_before = i > lo, has_after = i + 1 < hi;
    const Scalar cost = costs[x], cost_before = costs_before[x], cost_after = costs_after[x];
    // At an end of the range the one neighbour stands for both.
    const Scalar lone = has_after ? cost_after : cost;
    const Scalar before = has_before ? cost_before : lone;
    const Scalar after = has_after ? cost_after : before;
    const float offset = subpixel_offset<Kind>(before, cost, after);
    disparity[x] = static_cast<float>(first + i) + (has_before & has_after ? offset : 0.0f);
    confidence[x] =
        depth_confidence(perfect, static_cast<float>(before), static_cast<float>(cost), static_cast<float>(after));
  }
}

template <class Scalar>
inline void finish(const Pair& pair, const FusedSettings& settings, const RowWinners<Scalar>& row, const FusedOutput& out,
                   int y) {
  const int W = pair.width;
  float* disparity = out.disparity + static_cast<size_t>(y) * W;
  float* confidence = out.confidence + static_cast<size_t>(y) * W;
  uint8_t* flags = out.flags + static_cast<size_t>(y) * W;
  const float perfect = is_correlation(settings.cost) ? -1.0f : 0.0f;
  const int begin = pair.first > 0 ? (pair.first < W ? pair.first : W) : 0;
  const int seen = pair.first + pair.count + W - 1;
  const int end = seen < W ? (seen > begin ? seen : begin) : W;
  const auto refuse = [&](int x, uint8_t flag) {
    flags[x] = flag;
    if (!flag) return;
    disparity[x] = std::numeric_limits<float>::quiet_NaN();
    confidence[x] = 0;
  };
  for (int x = 0; x < begin; ++x) refuse(x, kOutOfView);
  for (int x = end; x < W; ++x) refuse(x, kOutOfView);
  switch (settings.subpixel) {
    case Subpixel::none:
      fit<Subpixel::none>(pair, perfect, row, begin, end, disparity, confidence);
      break;
    case Subpixel::parabola:
      fit<Subpixel::parabola>(pair, perfect, row, begin, end, disparity, confidence);
      break;
    case Subpixel::equiangular:
      fit<Subpixel::equiangular>(pair, perfect, row, begin, end, disparity, confidence);
      break;
  }
  if (!settings.uniqueness && !settings.left_right) {
    for (int x = begin; x < end; ++x) flags[x] = 0;
    return;
  }
  for (int x = begin; x < end; ++x) {
    uint8_t flag = 0;
    if (settings.uniqueness && row.second[x] < worst_cost<Scalar>() &&
        static_cast<double>(row.second[x]) - perfect <= (static_cast<double>(row.cost[x]) - perfect) * settings.ratio)
      flag |= kAmbiguous;
    if (settings.left_right) {
      const int beyond = x - pair.first - (W - 1), reach = x - pair.first + 1;
      flag |= check_left_right(row.right_index + (W - 1 - x), row.winner[x], beyond > 0 ? beyond : 0,
                               reach < pair.count ? reach : pair.count, settings.tolerance);
    }
    refuse(x, flag);
  }
}

}  // namespace
}  // namespace stereopsis
