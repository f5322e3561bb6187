// Costs of single pixels, whole numbers of at most 255, and their sums over a box: a volume (H, W, D) of 16 bits, whose worst
// value is 65535. They compare what each image alone says of its pixels, its features, which go on past its edges by
// repeating those of the edge pixels.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>

#include "fused.hpp"

namespace stereopsis {

// Features are planes (P, H, W), one behind the other:
// - census: uint64, a bit a comparison; 1 plane, or 2 for more than 64 bits. The cost is the number of bits that differ.
// - absolute: uint8, 1 plane. |l - r|.
// - vector: int16, 2 planes. |l0 - r0| + |l1 - r1|.
// - interval: int16, 3 planes: a value, and the least and the largest one around it. How far the value of one side lies
//   outside the interval of the other; the smaller of both ways round.
// - table: uint8, 1 plane. What a table (256, 256) holds for the pair.
enum class PixelCost : int { census, absolute, vector, interval, table };

struct PixelJob {
  PixelCost cost;
  const void *left, *right;
  int height, width, planes;
  int bits;  // of a census string
  int first, count;
  int most;  // what costs more counts as much, at most 255
  const uint8_t* table;
  Window box;     // most * box.area() is below 65535
  bool add;       // to what `costs` hold already
  uint16_t* costs;
};

// Comparisons of a census: bit k says whether the pixel `first` elements on is darker than the one `second` elements on.
struct Comparison {
  ptrdiff_t first, second;
};
constexpr int kCensusStretch = 64;
struct CensusJob {
  // uint8 where `bytes`, else int32; of the first pixel, within an image wide enough for all comparisons, behind which there
  // are kCensusStretch more to be read.
  const void* image;
  bool bytes;
  ptrdiff_t stride;  // elements from row to row
  int height, width;
  const Comparison* comparisons;
  int count;
  uint64_t* strings;  // (P, H, W)
};

// What one build of the kernels offers, for rows begin ... end - 1. `scratch` is 64-byte aligned.
struct PixelwiseKernels {
  size_t (*scratch_bytes)(const PixelJob&);
  void (*rows)(const PixelJob&, int begin, int end, void* scratch, const Cancel& cancel);
  void (*census_rows)(const CensusJob&, int begin, int end, const Cancel& cancel);
};

// The build that goes with the named kernel, or with the best one for an empty name.
const PixelwiseKernels& choose_pixelwise(const std::string& name);

}  // namespace stereopsis
