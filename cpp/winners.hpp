// From a row's winners to its disparities: the checks, the sub-pixel fit, the flags and the confidence.
#pragma once

#include <limits>

#include "fused.hpp"
#include "score.hpp"

namespace stereopsis {
namespace {

enum FlagBit : uint8_t { kOccluded = 1, kMismatched = 2, kAmbiguous = 4, kOutOfView = 32 };

template <class Scalar>
struct RowWinners {
  const int32_t* winner;  // index of the winning candidate, or -1 where none is in view
  const Scalar *cost, *before, *after;
  const Scalar* second;        // least cost apart from the winner and its neighbours; with uniqueness alone
  int32_t* claims;             // scratch, two rows and one long; this and the next with the left-right check alone
  const int32_t* right_index;  // winner of right pixel x - first - i at [width - 1 - x + i]
};

template <class Scalar>
inline void check_uniqueness(const Scalar* __restrict costs, const Scalar* __restrict seconds, double perfect, double ratio,
                             int begin, int end, uint8_t* __restrict flags) {
  for (int x = begin; x < end; ++x) {
    const bool near = static_cast<double>(seconds[x]) - perfect <= (static_cast<double>(costs[x]) - perfect) * ratio;
    flags[x] = static_cast<uint8_t>(flags[x] | (near & (seconds[x] < worst_cost<Scalar>()) ? kAmbiguous : 0));
  }
}

// Whether column x, or one within `tolerance` of it, is the match of some right pixel by the right view's winners: in
// claims[x], 0 or 1.
inline void find_claims(const Pair& pair, const int32_t* __restrict right_index, int tolerance, uint8_t* __restrict claims) {
  const int W = pair.width, span = 2 * tolerance + 1;
  for (int x = 0; x < W + 2 * tolerance; ++x) claims[x] = 0;
  // Right pixel W - 1 - first - j for those j that a candidate can have.
  const int begin = pair.first < 0 ? -pair.first : 0;
  const int end = W - pair.first < W - 1 + pair.count ? W - pair.first : W - 1 + pair.count;
  uint8_t* matches = claims + tolerance;
  for (int j = begin; j < end; ++j)
    if (right_index[j] >= 0) matches[W - 1 - j + right_index[j]] = 1;
  // Twice as many columns to the right each time; in the end `span` of them.
  for (int seen = 1; seen < span;) {
    const int more = 2 * seen < span ? seen : span - seen, to = W + 2 * tolerance - more;
    for (int x = 0; x < to; ++x) claims[x] = static_cast<uint8_t>(claims[x] | claims[x + more]);
    seen += more;
  }
}

// Whether the right view's winner at the match of a pixel agrees with it within `tolerance` columns; if not, whether
// another right pixel's winner lies within them: then the match is wrong, else the pixel is hidden in the right view
// (Hirschmueller 2008, doi:10.1109/TPAMI.2007.1166).
inline void check_left_right(const int32_t* __restrict winner, const int32_t* __restrict right_index,
                             const uint8_t* __restrict claims, int width, int tolerance, int begin, int end,
                             uint8_t* __restrict flags) {
  static_assert(kMismatched == kOccluded + 1, "one claim more");
  for (int x = begin; x < end; ++x) {
    const int apart = right_index[width - 1 - x + winner[x]] - winner[x];
    const int why = (apart < 0 ? -apart : apart) > tolerance ? kOccluded + claims[x] : 0;
    flags[x] = static_cast<uint8_t>(flags[x] | why);
  }
}

// Whoever asks for the costs too decides by himself what to refuse of what is in view.
inline void refuse_flagged(const uint8_t* __restrict flags, uint8_t refused, int width, float* __restrict disparity,
                           float* __restrict confidence) {
  for (int x = 0; x < width; ++x) {
    disparity[x] = flags[x] & refused ? std::numeric_limits<float>::quiet_NaN() : disparity[x];
    confidence[x] = flags[x] & refused ? 0.0f : confidence[x];
  }
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
  for (int x = 0; x < W; ++x) flags[x] = x >= begin && x < end ? 0 : kOutOfView;
  if (out.cost) {
    float* cost = out.cost + static_cast<size_t>(y) * W;
    for (int x = 0; x < W; ++x)
      cost[x] = flags[x] ? std::numeric_limits<float>::infinity() : static_cast<float>(row.cost[x]);
  }
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
  if (settings.uniqueness) check_uniqueness(row.cost, row.second, perfect, settings.ratio, begin, end, flags);
  if (settings.left_right) {
    // Candidates are whole, so what a tolerance has beyond whole pixels makes no difference.
    const int tolerance = settings.tolerance < W ? static_cast<int>(settings.tolerance) : W;
    uint8_t* claims = reinterpret_cast<uint8_t*>(row.claims);
    find_claims(pair, row.right_index, tolerance, claims);
    check_left_right(row.winner, row.right_index, claims, W, tolerance, begin, end, flags);
  }
  refuse_flagged(flags, out.cost ? kOutOfView : 0xFF, W, disparity, confidence);
}

}  // namespace
}  // namespace stereopsis
