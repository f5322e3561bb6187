// What an image shows, inside the black border around it.
#include <algorithm>
#include <cmath>
#include <cstring>

#include "parallel.hpp"
#include "stages.hpp"

namespace stereopsis {

namespace {

// Which end of a line a place lies beyond, 0 or 1, and how far off it is.
struct Beyond {
  int end, off;
};

Beyond beyond(int at, const int32_t* ends, int far) {
  const bool after = at >= ends[1];
  const int off = after ? at - ends[1] + 1 : ends[0] - at;
  return {after, off > 0 && ends[0] < ends[1] ? off : far};
}

bool hides(const Shown& image, int y, int x) {
  const int32_t *row = image.rows + 2 * y, *column = image.columns + 2 * x;
  return x < row[0] || x >= row[1] || y < column[0] || y >= column[1];
}

}  // namespace

void continue_over(const Shown& image, const BorderEdge& edge, const Patch& part, uint8_t* pixels, const Workers& workers) {
  const int far = image.height + image.width;
  int first = 0, last = image.height - 1;
  while (first < last && image.rows[2 * first + 1] == 0) ++first;
  while (last > first && image.rows[2 * last + 1] == 0) --last;
  const bool any = image.rows[2 * first + 1] > 0;
  parallel_bands(part.height, 16, workers.threads, workers.interrupted, [&](int begin, int end, const Cancel&) {
    for (int y = part.top + begin; y < part.top + end; ++y)
      for (int x = part.left; x < part.left + part.width; ++x) {
        if (!hides(image, y, x)) continue;
        const bool corner = any && image.rows[2 * y + 1] == 0 && image.columns[2 * x + 1] == 0;
        const int from = corner ? std::clamp(y, first, last) : y;
        const Beyond across = beyond(x, image.rows + 2 * from, far), along = beyond(from, image.columns + 2 * x, far);
        if (across.off == far && along.off == far) continue;
        const uint8_t* nearest = across.off < along.off ? edge.rows + (2 * static_cast<size_t>(from) + across.end) * edge.size
                                                        : edge.columns + (2 * static_cast<size_t>(x) + along.end) * edge.size;
        const size_t to = static_cast<size_t>(y - part.top) * part.width + (x - part.left);
        std::memcpy(pixels + to * edge.size, nearest, edge.size);
      }
  });
}

void find_hidden(const float* disparity, float sign, const Shown* here, const Shown* there, const Patch& part, uint8_t* hidden,
                 const Workers& workers) {
  parallel_bands(part.height, 16, workers.threads, workers.interrupted, [&](int begin, int end, const Cancel&) {
    for (int row = begin; row < end; ++row) {
      const int y = part.top + row;
      const size_t at = static_cast<size_t>(row) * part.width;
      for (int i = 0; i < part.width; ++i) {
        const int x = part.left + i;
        const float d = disparity[at + i];
        bool found = here && hides(*here, y, x);
        if (there && !std::isnan(d)) {
          const float match = std::floor(static_cast<float>(x) - sign * d + 0.5f);
          const float inside = std::clamp(match, 0.0f, static_cast<float>(there->width - 1));
          found = found || hides(*there, y, static_cast<int>(inside));
        }
        hidden[at + i] = found;
      }
    }
  });
}

}  // namespace stereopsis
