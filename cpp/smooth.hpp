// Edge-aware smoothing in linear time: one line of the image after the other (Min et al. 2014).
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "stages.hpp"

namespace stereopsis {

// Of each pixel with the one to the right, and with the one below; 0 at the last column and row.
struct EdgeWeights {
  std::vector<float> right, down;
};
// table[k] of the largest difference k over the channels; the last entry for all beyond.
EdgeWeights edge_weights(const int32_t* guide, int height, int width, int channels, const float* table, int length,
                         const Workers& workers);

// What is smoothed, (H, W) each, in place: values and how much each is worth. With slopes, (H, W) each as well, values are
// counted from a surface that rises by them from each pixel to the next.
struct Weighed {
  float *value, *weight;
};
struct Slopes {
  const float *right, *down;
};
constexpr int kLines = 16;  // lines solved side by side: a cache line of floats

// Lines `first` to first + kLines - 1: rows of the maps, or their columns; and what they are smoothed by.
struct Strip {
  int height, width, first;
  bool rows;
  const Weighed* fields;
  int field_count;
  const float *slopes, *edges;
  float strength;
};
// The kernel that smooths a strip, in memory with room for six times its samples: the build that goes with the named instruction set, or with the best one for an empty name.
SmoothKernel choose_smoothing(const std::string& name);

// Solves (I + strength A) v = f along every row, then along every column, `iterations` times with falling strength, for
// f = weight * value and f = weight; value becomes their quotient. A is the line's graph Laplacian with the edge weights.
void smooth(const std::vector<Weighed>& fields, const Slopes* slopes, int height, int width, const EdgeWeights& edges,
            float strength, int iterations, SmoothKernel kernel, const Workers& workers);

// Rise of the surface from each pixel to its right and lower neighbour: differences over gaps of k pixels, where they are at
// most 1.5 + k / 2, smoothed in cells of 4 x 4 pixels.
struct SlopeMaps {
  std::vector<float> right, down;
};
SlopeMaps surface_slopes(const float* disparity, const int32_t* guide, int height, int width, int channels, const float* table,
                         int length, SmoothKernel kernel, const Workers& workers);

}  // namespace stereopsis
