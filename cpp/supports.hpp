// Costs over support windows beyond the box: weighted means in float64, (H, W, D) float32. The weights come from the left
// image alone and sum to 1.
#pragma once

#include <atomic>
#include <cstddef>
#include <cstdint>

#include "fused.hpp"

namespace stereopsis {

// Every how many pixels of rows and columns, and every how many candidates, a cost is wanted.
struct Sampling {
  int step;
  int disparity_step;
};

// How far a support reaches at one pixel.
struct Reach {
  int32_t left, right, above, below;
};

// One pixel of a support: its weight, its left pixel's channels, and the right pixels of the candidates.
struct Tap {
  double weight;
  const double* left;
  const double* right;  // the other channels lie a `channel` of `Reversed` apart
};

// Planes of the right image's height as doubles, columns reversed, so that the candidates of a pixel lie one behind the
// other: at(r, y, x)[i] is the value at column x - first - i * disparity_step, edge columns repeated.
struct Reversed {
  const double* data;
  int first_x, last_x, disparity_step;  // the columns x that may be asked for
  size_t phase, row, channel;           // strides
};

// What a kernel needs to know of the pair. `left` is (H, W, C); `mean` (H, W, C) and `square` (H, W) are the left windows'
// weighted means of the pixels and of their squares summed over the channels.
struct SupportJob {
  CostKind cost;
  int height, width, channels, first, count;
  Sampling sampling;
  const double* left;
  Reversed right;
  float* costs;

  // Separable weights, and the right image's own weighted means: the channels', then that of the squares.
  const double* taps;
  int radius;
  const double *mean, *square;
  Reversed right_mean, right_square;

  // Rectangles, or crosses: a vertical arm, and each of its pixels' horizontal arms.
  const Reach* reach;
  const double* area;
  Reach most;

  // Any weights: writes the support of a pixel, at most `most_taps`, and returns its size.
  int (*gather)(const SupportJob& job, int y, int x, Tap* taps);
  const void* gatherer;
  size_t most_taps;
};

enum class SupportKernel : int { separable, rectangle, cross, any };

// What one build of the kernels offers. A unit is a row of costs, or kRowsInBlock of them for rectangles and crosses.
struct SupportKernels {
  size_t (*scratch_bytes)(SupportKernel, const SupportJob&);
  void (*units)(SupportKernel, const SupportJob&, int begin, int end, void* scratch, const Cancel& cancel);
};
// Fixed, so that the same sums are formed whatever the number of threads.
constexpr int kRowsInBlock = 32;
// Right pixels can be read for so many candidates more than there are.
constexpr int kSupportCandidates = 16;

// Unnamed for the reason given in fused_narrow.hpp.
namespace {

inline const double* at(const Reversed& plane, int y, int x) {
  const int t = plane.last_x - x;
  return plane.data + y * plane.row + (t % plane.disparity_step) * plane.phase + t / plane.disparity_step;
}
inline int sampled(int side, int step) { return (side + step - 1) / step; }

}  // namespace

}  // namespace stereopsis
