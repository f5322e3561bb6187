// Windows weighted by a Gaussian: what the kernel is told, and the grid that it works on.
//
// The blurred products of a pair are as smooth as the Gaussian, so they are kept on every `stride`-th row and column alone.
// A cubic B-spline gathers pixels into knots, a short symmetric filter `taps` runs over the knots, and a cubic B-spline
// spreads them over the pixels again; the taps are such that the three together are the Gaussian. With a stride of 1 there
// are no splines, and the taps are the Gaussian's own.
#pragma once

#include "fused.hpp"

namespace stereopsis {

struct GaussianFilter {
  int stride;          // pixels from knot to knot
  int reach;           // taps on either side of the middle one
  const double* taps;  // reach + 1: the middle one and those of one side
};

// The cubic B-spline's weights are integers, pixels to the fourth power in sum; of three channels' products the sum still
// fits 32 bits up to this stride.
constexpr int kLargestStride = 12;

constexpr int kPiece = 128;  // of a row of knots, filtered at once

struct GaussianGrid {
  GaussianGrid(const Pair& pair, CostKind cost, const GaussianFilter& filter)
      : stride(filter.stride),
        reach(filter.reach),
        padded((pair.count + 15) / 16 * 16),
        spline(2 * (stride - 1)),
        first_knot(stride > 1 ? -1 : 0),
        knots(stride > 1 ? (pair.width - 1) / stride + 4 : pair.width),
        margin(stride > 1 ? 3 * stride : 0),
        positions_padded((pair.width + 2 * margin + 15) / 16 * 16),
        maps(cost == CostKind::sad ? 0 : 4 * pair.channels),
        top(-2),
        bottom(stride > 1 ? (pair.height - 4 + 3 * stride) / stride : 0) {}

  int stride, reach;
  int padded;             // candidates, up to whole vectors
  int spline;             // pixels that a B-spline reaches to either side
  int first_knot, knots;  // columns of knots that pixels ask for
  // The moments of each image alone are kept at every column, at `margin` more on either side, and up to whole vectors.
  int margin, positions_padded;
  int maps;  // left means and squares, right means and squares, of each channel
  int top, bottom;        // rows of knots; those further out gather the same repeated edge pixels

  // A row of knots: candidates of each knot, then the maps; and what keeps the same place of many rows apart in a cache, whose
  // sets repeat every 4096 bytes.
  size_t record() const {
    const size_t used = maps_at() + maps_size();
    return used + (512 + kPiece + 16 - used % 512) % 512;
  }
  size_t maps_size() const { return static_cast<size_t>(maps) * positions_padded; }
  size_t maps_at() const { return static_cast<size_t>(knots) * padded; }
};

// Rows of knots, of which the last `capacity` are kept.
struct KnotRows {
  double* base;
  size_t record;
  int top, bottom, capacity;
  double* at(int row) const {
    const int inside = row < top ? top : row > bottom ? bottom : row;
    return base + static_cast<size_t>((inside - top) % capacity) * record;
  }
};

// What one build of the kernel offers: rows of knots, horizontally finished; pieces of such rows, vertically finished; and rows of
// pixels from these. With a stride of 1 pixels need no rows of knots. Scratch as in FusedKernel.
struct GaussianKernel {
  size_t (*knots_bytes)(const Pair&, const FusedSettings&, const GaussianFilter&);
  void (*knots)(const Pair&, const FusedSettings&, const GaussianFilter&, const KnotRows&, int begin, int end,
                void* scratch, const Cancel& cancel);
  void (*filter)(const GaussianFilter&, const KnotRows& knots, const KnotRows& filtered, int first, int past, int begin,
                 int end, const Cancel& cancel);
  size_t (*rows_bytes)(const Pair&, const FusedSettings&, const GaussianFilter&);
  void (*rows)(const Pair&, const FusedSettings&, const GaussianFilter&, const KnotRows&, const FusedOutput&, int begin,
               int end, void* scratch, const Cancel& cancel);
};

}  // namespace stereopsis
