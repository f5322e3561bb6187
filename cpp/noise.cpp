#include <algorithm>
#include <cmath>
#include <vector>

#include "parallel.hpp"
#include "simd.hpp"
#include "stages.hpp"

namespace stereopsis {

namespace {

// Adds how much the mask (1, -2, 1; -2, 4, -2; 1, -2, 1) answers to `count` elements, those of each channel apart.
void respond(const float* STEREOPSIS_RESTRICT rows, size_t pitch, int channels, int count, float* STEREOPSIS_RESTRICT down,
             float* STEREOPSIS_RESTRICT response) {
  const float *const second = rows + pitch, *const third = second + pitch;
  for (int k = 0; k < count + 2 * channels; ++k) down[k] = (third[k] - second[k]) - (second[k] - rows[k]);
  for (int k = 0; k < count; ++k)
    response[k] += std::fabs((down[k + 2 * channels] - down[k + channels]) - (down[k + channels] - down[k]));
}

}  // namespace

void noise_means(const float* image, int width, int channels, const NoiseBlocks& blocks, double* means, const Workers& workers) {
  const int64_t pixels = static_cast<int64_t>(blocks.rows) * blocks.height * width * channels;
  quick_bands(blocks.rows, pixels, 1 << 17, workers.threads, workers.interrupted, [&](int begin, int end, const Cancel& cancel) {
    const size_t pitch = static_cast<size_t>(width) * channels;
    const int count = blocks.columns * blocks.width * channels, one = blocks.width * channels;
    std::vector<float> down(pitch), response(count);
    for (int row = begin; row < end && !cancel.load(std::memory_order_relaxed); ++row) {
      double* const sums = means + static_cast<size_t>(row) * blocks.columns * channels;
      std::fill(sums, sums + static_cast<size_t>(blocks.columns) * channels, 0.0);
      std::fill(response.begin(), response.end(), 0.0f);
      for (int y = row * blocks.height; y < (row + 1) * blocks.height; ++y)
        respond(image + y * pitch, pitch, channels, count, down.data(), response.data());
      for (int block = 0; block < blocks.columns; ++block)
        for (int k = 0; k < one; k += channels)
          for (int c = 0; c < channels; ++c) sums[block * channels + c] += response[block * one + k + c];
      for (int k = 0; k < blocks.columns * channels; ++k) sums[k] /= blocks.height * blocks.width;
    }
  });
}

}  // namespace stereopsis
