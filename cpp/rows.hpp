// Loops over rows of maps and images, one build for each instruction set.
#pragma once

#include <cstdint>
#include <string>

namespace stereopsis {

// The windows that corners are sought by and points are followed with, where they are of the usual width and not too tall.
constexpr int kUsualColumns = 13, kTallestUsual = 15;

// A pair of images of the same size and windows of kUsualColumns x `rows` in them.
struct Windows {
  const uint8_t *left, *right;
  int height, width, rows;
};

// How many pixels beyond its margin a row must have room for.
constexpr int kRowRoom = 64;

struct RowKernels {
  // Median of those of nine pixels that have a value; the rows have a margin of one pixel.
  void (*median_of_nine)(const float* above, const float* here, const float* below, int width, float* filtered);
  // The same of 25 pixels in five rows, which have a margin of two pixels.
  void (*median_of_25)(const float* const* rows, int width, float* filtered);
  // The smaller eigenvalue of the summed products of gradients about (x, y) of the left image.
  double (*cornerness)(const Windows& windows, int x, int y);
  // As `track`, of one point.
  void (*track)(const Windows& windows, int x, int y, int iterations, double* motion, double* correlation);
};
// The build that goes with the named instruction set, or with the best one for an empty name.
const RowKernels& choose_rows(const std::string& name);

}  // namespace stereopsis
