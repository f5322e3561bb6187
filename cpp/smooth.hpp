// Edge-aware smoothing in linear time: one line of the image after the other (Min et al. 2014).
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "scratch.hpp"
#include "stages.hpp"

namespace stereopsis {

// Of each pixel with the one to the right, and with the one below; 0 at the last column and row.
struct EdgeWeights {
  Unset<float> right, down;
};
// table[k] of the largest difference k over the channels; the last entry for all beyond.
EdgeWeights edge_weights(const int32_t* guide, int height, int width, int channels, const float* table, int length,
                         const Workers& workers);

// How much a surface rises from each pixel to its right, and to its lower neighbour: one number for each cell of kCell x kCell
// pixels, row by row.
constexpr int kCell = 4;
struct Slopes {
  int wide;  // cells a row
  std::vector<float> right, down;
  size_t cell(int y, int x) const { return static_cast<size_t>(y / kCell) * wide + x / kCell; }
};
// What is smoothed, (H, W) each, in place: values and how much each is worth. With slopes, values are counted from a surface
// that rises by them.
struct Weighed {
  float *value, *weight;
};
constexpr int kLines = 16;  // lines solved side by side: a cache line of floats

// Lines `first` to first + kLines - 1: rows of the maps, or their columns; and what they are smoothed by.
struct Strip {
  int height, width, first;
  bool rows;
  const Weighed* fields;
  int field_count;
  const float* slopes;  // in cells, along the lines; or null
  int cells_wide;
  const float* edges;
  float strength;
};
// The kernel that smooths a strip, in memory with room for five times its samples: the build that goes with the named instruction set, or with the best one for an empty name.
SmoothKernel choose_smoothing(const std::string& name);

// Solves (I + strength A) v = f along every row, then along every column, `iterations` times with falling strength, for
// f = weight * value and f = weight; value becomes their quotient. A is the line's graph Laplacian with the edge weights.
void smooth(const std::vector<Weighed>& fields, const Slopes* slopes, int height, int width, const EdgeWeights& edges,
            float strength, int iterations, SmoothKernel kernel, const Workers& workers);

// The slopes of a map: differences over gaps of k pixels, where they are at most 1.5 + k / 2, smoothed from cell to cell.
Slopes surface_slopes(const float* disparity, const int32_t* guide, int height, int width, int channels, const float* table,
                      int length, SmoothKernel kernel, const Workers& workers);

}  // namespace stereopsis
