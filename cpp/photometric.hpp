// Sums over the windows in which both views' grey levels are compared, and what these tell of the disparity.
#pragma once

#include <cstdint>
#include <string>

namespace stereopsis {

// Parts of a pixel, and of a grey level: few enough for sums over a window of products of differences and levels to fit 31 bits.
constexpr int kPhotometricUnit = 128;
constexpr int kPhotometricAlong = 7, kPhotometricAcross = 4;  // windows of 15 x 9
constexpr int kPhotometricArea = (2 * kPhotometricAlong + 1) * (2 * kPhotometricAcross + 1);

// What is known of each pixel of a row, 0 where it does not count: 1; how much brighter it is than its match, in units; the
// difference of its neighbours, whose noise neither of the two shares; its level, less 128.
enum PhotometricFactor { kCounts, kBrighter, kSlope, kLevel, kPhotometricFactors };
// What is summed are products of two.
constexpr int kPhotometricTerms = 9;
constexpr PhotometricFactor kPhotometricTerm[kPhotometricTerms][2] = {
    {kCounts, kCounts},   {kCounts, kBrighter}, {kCounts, kSlope},  {kCounts, kLevel}, {kBrighter, kSlope},
    {kBrighter, kLevel},  {kSlope, kSlope},     {kSlope, kLevel},   {kLevel, kLevel}};

struct PhotometricKernel {
  // The factors but the first of a row of the left view.
  void (*describe)(const int16_t* counts, const int16_t* brighter, const uint8_t* left, int width, int16_t* counted,
                   int16_t* slope, int16_t* level);
  // Adds products of two rows to the sums of the columns, and takes those of two others away.
  void (*change)(const int16_t* a, const int16_t* b, const int16_t* old_a, const int16_t* old_b, int width, int32_t* columns);
  // Sums of the columns around each; those have a margin of kPhotometricAlong, and `threes` room for twice that more.
  void (*sum)(const int32_t* columns, int width, int32_t* threes, int32_t* sums);
  // Which of those that are seen differ from the window's mean by less than an outlier.
  void (*keep)(const int16_t* seen, const int16_t* brighter, const int32_t* count, const int32_t* sum, int width, int16_t* counts);
  // Moves what is not doubtful, within [least, most].
  void (*move)(const int32_t* const* sums, const float* disparity, const uint8_t* doubtful, int width, float least, float most,
               float* moved);
};
// The build that goes with the named instruction set, or with the best one for an empty name.
const PhotometricKernel& choose_photometric(const std::string& name);

}  // namespace stereopsis
