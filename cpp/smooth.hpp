// Edge-aware smoothing in linear time: one line of the image after the other (Min et al. 2014).
#pragma once

#include <cstdint>
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
// Solves (I + strength A) v = f along every row, then along every column, `iterations` times with falling strength, for
// f = weight * value and f = weight; value becomes their quotient. A is the line's graph Laplacian with the edge weights.
void smooth(const std::vector<Weighed>& fields, const Slopes* slopes, int height, int width, const EdgeWeights& edges,
            float strength, int iterations, const Workers& workers);

// The slopes of a map: differences over gaps of k pixels, where they are at most 1.5 + k / 2, smoothed from cell to cell.
Slopes surface_slopes(const float* disparity, const int32_t* guide, int height, int width, int channels, const float* table,
                      int length, const Workers& workers);

}  // namespace stereopsis
