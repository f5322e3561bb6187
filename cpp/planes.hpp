// Segments of one plane each: their pixels, their planes, and how neighbouring planes meet.
#pragma once

#include <cstdint>

#include "stages.hpp"

namespace stereopsis {

// The image (H, W, C), and disparities (H, W), each believed as far as its weight says; 0: not at all, whatever its value.
struct Observed {
  const float* image;
  const float* disparity;
  const float* weight;
  int height, width, channels;
};

// Disparities in pixels, their squares where an energy holds them; docs/planes.md has the formulas.
struct SegmentModel {
  double side;                         // of a segment at the start, in pixels
  double truncation;                   // least squared residual that counts no more
  double most_a, most_b;               // slopes of a plane
  double position, depth, boundary;    // weights against squared grey levels, of moving a pixel to another segment
  double smoothness, hinge, occlusion; // weight of a boundary, and what a fold and a step in depth cost, squared pixels
};

// `label` (H, W) holds 0 ... count - 1, each at least once; planes (count, 3), NaN where a segment has none.

// Fits each segment's plane to its pixels: random samples beside the plane that it has, then least squares.
void fit_planes(const Observed& seen, const SegmentModel& model, const int32_t* label, int count, int trials, double* planes,
                const Workers& workers);

// Gives pixels at the segments' boundaries to the neighbours that explain them better. A segment that is 4-connected stays so,
// and keeps a pixel at least. At most 63 sweeps.
void move_boundaries(const Observed& seen, const SegmentModel& model, const double* planes, int count, int sweeps,
                     int32_t* label, const Workers& workers);

// Lets each segment take a neighbour's plane, or the best compromise with its neighbours', where that lowers the energy.
// Segments i and j are worked on at once where i / columns and i % columns are as even or odd as those of j.
void smooth_planes(const Observed& seen, const SegmentModel& model, const int32_t* label, int count, int columns, int rounds,
                   double* planes, const Workers& workers);

// Each pixel's disparity on its segment's plane, kept within [least, most].
void render_planes(const int32_t* label, int height, int width, const double* planes, double least, double most,
                   float* disparity, const Workers& workers);

}  // namespace stereopsis
