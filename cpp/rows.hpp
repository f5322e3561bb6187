// Loops over rows of maps and images, one build for each instruction set.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>

namespace stereopsis {

// The windows that corners are sought by and points are followed with: so many columns, and up to so many rows.
constexpr int kTrackedColumns = 13, kMostTrackedRows = 15;

// A pair of images of the same size and windows of kTrackedColumns x `rows` in them.
struct Windows {
  const uint8_t *left, *right;
  int height, width, rows;
};

// How many pixels beyond its margin a row must have room for.
constexpr int kRowRoom = 64;

// A row of a map, and what is to become of pixels of it that are refused: no value, no confidence, one more bit.
struct RowRefusal {
  float *disparity, *confidence;
  uint8_t* flags;
  uint8_t bit;
};

// Sums of gradients over windows that fit a `Sum`.
template <class T, class Sum>
struct GradientKernels {
  // Adds the gradients of a row of one channel to those of the columns, and takes those of another row away.
  void (*change)(const T* added, const T* removed, int width, Sum* columns);
  // The sum of `size` columns from each on; both arrays have room for kRowRoom columns more.
  void (*sum_columns)(const Sum* columns, int width, int size, Sum* sums);
  // Refuses the pixels of a row whose sum is at most that.
  void (*refuse_low)(const Sum* sums, Sum most, int width, const RowRefusal& refused);
};

struct RowKernels {
  // `count` grey pixels of as many of three channels, as `grey` has them.
  void (*grey_bytes)(const uint8_t* rgb, size_t count, uint8_t* grey);
  void (*grey_words)(const int32_t* rgb, size_t count, int32_t* grey);
  // The rounded means of 2 x 2 pixels of two rows, `count` of them.
  void (*halve)(const uint8_t* above, const uint8_t* below, int count, uint8_t* means);
  // (pixel - low) times the factor, rounded to even, within 0 and 255.
  void (*stretch)(const int32_t* row, size_t count, double low, double factor, uint8_t* bytes);
  // Columns [begin, end) of a row that lies start + slope x of the way from row 1 to row 2 of four, by cubic convolution; values
  // are counted from the lowest one and stay within the range.
  void (*between_bytes)(const uint8_t* const* rows, double start, double slope, int begin, int end, int channels, uint8_t lowest,
                        float range, uint8_t* out);
  void (*between_words)(const int32_t* const* rows, double start, double slope, int begin, int end, int channels, int32_t lowest,
                        float range, int32_t* out);
  GradientKernels<uint8_t, uint16_t> gradients_of_bytes;
  GradientKernels<int32_t, uint32_t> gradients_of_words;
  // Of a row's pixels, 64 a word and the first in the lowest bit, with 0 beyond the last one. Which ones go on into the next one:
  // they are apart by at most that, or neither has a value.
  void (*go_on)(const float* row, int width, float difference, uint64_t* bits);
  // Which ones have a value.
  void (*have_values)(const float* row, int width, uint64_t* bits);
  // Which ones are apart from the one above by at most that.
  void (*meet)(const float* row, const float* above, int width, float difference, uint64_t* bits);
  // Median of those of nine pixels that have a value; the rows have a margin of one pixel.
  void (*median_of_nine)(const float* above, const float* here, const float* below, int width, float* filtered);
  // The same of 25 pixels in five rows, which have a margin of two pixels.
  void (*median_of_25)(const float* const* rows, int width, float* filtered);
  // Weights 1 2 1 down the columns, then along the row, its ends repeated; `line` has room for these.
  void (*blur)(const float* above, const float* here, const float* below, int width, float* line, float* blurred);
  // The larger of what there was and of the central differences, halved; `line` as before.
  void (*steepen)(const float* above, const float* here, const float* below, int width, float* line, float* steepest);
  // (steepest - calm) / unit, rounded to even, within 0 and 255.
  void (*quantise)(const float* steepest, float calm, float unit, int width, uint8_t* relief);
  // The smaller eigenvalue of the summed products of gradients about (x, y) of the left image.
  double (*cornerness)(const Windows& windows, int x, int y);
  // As `track`, of one point.
  void (*track)(const Windows& windows, int x, int y, int iterations, double* motion, double* correlation);
};
// The build that goes with the named instruction set, or with the best one for an empty name.
const RowKernels& choose_rows(const std::string& name);

}  // namespace stereopsis
