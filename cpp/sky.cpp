#include <algorithm>
#include <cstring>
#include <vector>

#include "parallel.hpp"
#include "rows.hpp"
#include "stages.hpp"

namespace stereopsis {

namespace {

// A map with one more element on every side, so that each of its own has four neighbours.
struct Bordered {
  Bordered(int height, int width) : rows(static_cast<size_t>(height) + 2), pitch(static_cast<size_t>(width) + 2) {}
  size_t size() const { return rows * pitch; }
  size_t at(int y) const { return (y + 1) * pitch + 1; }  // where row y begins
  size_t rows, pitch;
};

}  // namespace

void relief(const float* planes, int channels, int height, int width, float calm, float unit, uint8_t* relief,
            const RowKernels& kernels, const Workers& workers) {
  const int64_t pixels = static_cast<int64_t>(height) * width * channels;
  quick_bands(height, pixels, 1 << 16, workers.threads, workers.interrupted, [&](int begin, int end, const Cancel& cancel) {
    const size_t pitch = width;
    const int first = std::max(0, begin - 2), last = std::min(height, end + 2);
    std::vector<float> once((last - first) * pitch), twice((last - first) * pitch), line(pitch + 2), steepest((end - begin) * pitch);
    for (int c = 0; c < channels; ++c) {
      const float* plane = planes + static_cast<size_t>(c) * height * pitch;
      const auto row = [&](auto* rows, int y) { return rows + std::clamp(y, first, last - 1) * pitch - first * pitch; };
      const auto of_image = [&](int y) { return plane + std::clamp(y, 0, height - 1) * pitch; };
      for (int y = first; y < last; ++y)
        kernels.blur(of_image(y - 1), of_image(y), of_image(y + 1), width, line.data(), row(once.data(), y));
      if (cancel.load(std::memory_order_relaxed)) return;
      for (int y = std::max(0, begin - 1); y < std::min(height, end + 1); ++y)
        kernels.blur(row(once.data(), y - 1), row(once.data(), y), row(once.data(), y + 1), width, line.data(),
                     row(twice.data(), y));
      for (int y = begin; y < end; ++y)
        kernels.steepen(row(twice.data(), y - 1), row(twice.data(), y), row(twice.data(), y + 1), width, line.data(),
                        steepest.data() + (y - begin) * pitch);
    }
    for (int y = begin; y < end; ++y)
      kernels.quantise(steepest.data() + (y - begin) * pitch, calm, unit, width, relief + y * pitch);
  });
}

void flood(const uint8_t* relief, int height, int width, uint8_t* level, const Workers& workers) {
  // The water rises a level at a time; `front[k]` holds the pixels that it reaches at level k, so that the whole is linear.
  parallel_rows(1, 1, workers.interrupted, [&](int, int, const Cancel& cancel) {
    using Place = uint32_t;
    const Bordered frame(height, width);
    std::vector<uint8_t> dry(frame.size()), levels(frame.size());
    std::vector<std::vector<Place>> front(256);
    for (int y = 0; y < height; ++y) {
      std::memset(&dry[frame.at(y)], 1, width);
      std::memcpy(&levels[frame.at(y)], relief + static_cast<size_t>(y) * width, width);
    }
    std::vector<Place> open;  // reached at the level that the water has
    const auto reach = [&](size_t at, int water) {
      if (!dry[at]) return;
      dry[at] = 0;
      if (levels[at] > water) return front[levels[at]].push_back(static_cast<Place>(at));
      levels[at] = static_cast<uint8_t>(water);
      open.push_back(static_cast<Place>(at));
    };
    for (int x = 0; x < width && height > 0; ++x) reach(frame.at(0) + x, 0);
    for (int water = 0; water < 256; ++water) {
      open.insert(open.end(), front[water].begin(), front[water].end());
      for (size_t k = 0; !open.empty(); ++k) {
        if (k % 4096 == 0 && cancel.load(std::memory_order_relaxed)) return;
        const size_t at = open.back();
        open.pop_back();
        for (const size_t next : {at - 1, at + 1, at - frame.pitch, at + frame.pitch}) reach(next, water);
      }
    }
    for (int y = 0; y < height; ++y) std::memcpy(level + static_cast<size_t>(y) * width, &levels[frame.at(y)], width);
  });
}

void keep_regions(const uint8_t* inside, const uint8_t* marked, int height, int width, double share, bool others, uint8_t* kept,
                  const Workers& workers) {
  parallel_rows(1, 1, workers.interrupted, [&](int, int, const Cancel& cancel) {
    // Runs of rows; those that touch are one region's, whose counts its first run has.
    struct Run {
      int first, end;
      size_t region;
      int64_t size, marks;
    };
    std::vector<Run> runs;
    std::vector<size_t> begin_of(static_cast<size_t>(height) + 1);
    const auto region_of = [&](size_t run) {
      while (runs[run].region != run) run = runs[run].region = runs[runs[run].region].region;
      return run;
    };
    const auto join = [&](size_t one, size_t other) {
      const size_t a = region_of(one), b = region_of(other);
      if (a == b) return;
      const auto [first, second] = std::minmax(a, b);
      runs[second].region = first;
      runs[first].size += runs[second].size;
      runs[first].marks += runs[second].marks;
    };
    size_t above = 0;
    for (int y = 0; y < height; ++y) {
      if (cancel.load(std::memory_order_relaxed)) return;
      const uint8_t *const in = inside + static_cast<size_t>(y) * width, *const mark = marked + static_cast<size_t>(y) * width;
      const size_t here = begin_of[y] = runs.size();
      for (int x = 0; x < width;) {
        if (!in[x]) {
          const void* const next = std::memchr(in + x, 1, width - x);
          if (!next) break;
          x = static_cast<int>(static_cast<const uint8_t*>(next) - in);
        }
        const void* const gap = std::memchr(in + x, 0, width - x);
        const int end = gap ? static_cast<int>(static_cast<const uint8_t*>(gap) - in) : width;
        int64_t marks = 0;
        for (int k = x; k < end; ++k) marks += mark[k];
        const size_t own = runs.size();
        runs.push_back({x, end, own, end - x, marks});
        while (above < here && runs[above].end <= x) ++above;
        for (size_t k = above; k < here && runs[k].first < end; ++k) join(k, own);
        x = end;
      }
      above = here;
    }
    begin_of[height] = runs.size();
    for (int y = 0; y < height; ++y) {
      uint8_t* const row = kept + static_cast<size_t>(y) * width;
      std::memset(row, 0, width);
      for (size_t k = begin_of[y]; k < begin_of[y + 1]; ++k) {
        const Run& region = runs[region_of(k)];
        if ((region.marks > share * region.size) != others) std::memset(row + runs[k].first, 1, runs[k].end - runs[k].first);
      }
    }
  });
}

}  // namespace stereopsis
