#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <limits>
#include <vector>

#include "parallel.hpp"
#include "scratch.hpp"
#include "simd.hpp"
#include "stages.hpp"

namespace stereopsis {

namespace {

constexpr float kJump = 4, kStep = 2;       // between neighbours: an outline; what may be one that is fattened
constexpr int kBeside = 2, kAround = 3;     // how far from an outline; and from a pixel the surfaces on either side
constexpr int kStride = 4, kStrides = 3;    // where votes are taken: every fourth row and column, up to 12 pixels off
constexpr int kPatch = 2, kUnits = 16;      // what a pixel's match is judged by: 5 x 5 pixels; parts of a pixel
constexpr int kMostApart = 20 * kUnits;     // gradients 10 grey levels a pixel apart (differences over two) are as bad as any
constexpr int kVote = 480;                  // a vote of what looks the same, in units of these; what was found has one

// Of each pixel of a row the least and the greatest disparity within `reach` rows and columns; infinite where there is none.
class Extremes {
 public:
  Extremes(const float* disparity, int height, int width, int reach)
      : disparity_(disparity), height_(height), width_(width), reach_(reach), low_(width + 2 * reach), high_(width + 2 * reach) {}

  void find(int y, float* STEREOPSIS_RESTRICT least, float* STEREOPSIS_RESTRICT most) {
    constexpr float far = std::numeric_limits<float>::infinity();
    std::fill(low_.begin(), low_.end(), far);
    std::fill(high_.begin(), high_.end(), -far);
    float *STEREOPSIS_RESTRICT const low = low_.data() + reach_, *STEREOPSIS_RESTRICT const high = high_.data() + reach_;
    for (int v = std::max(0, y - reach_); v <= std::min(height_ - 1, y + reach_); ++v) {
      const float* STEREOPSIS_RESTRICT const row = disparity_ + static_cast<size_t>(v) * width_;
      for (int x = 0; x < width_; ++x) {
        low[x] = row[x] < low[x] ? row[x] : low[x];
        high[x] = row[x] > high[x] ? row[x] : high[x];
      }
    }
    std::fill_n(least, width_, far);
    std::fill_n(most, width_, -far);
    for (int k = -reach_; k <= reach_; ++k)
      for (int x = 0; x < width_; ++x) {
        least[x] = low[x + k] < least[x] ? low[x + k] : least[x];
        most[x] = high[x + k] > most[x] ? high[x + k] : most[x];
      }
  }

 private:
  const float* disparity_;
  const int height_, width_, reach_;
  std::vector<float> low_, high_;
};

// Whether there is an outline within kBeside columns of each pixel of a row: whether its 3 x 3 pixels span more than `jump`.
class Jumps {
 public:
  Jumps(const float* disparity, int height, int width, float jump)
      : extremes_(disparity, height, width, 1), width_(width), jump_(jump), least_(width), most_(width), jumps_(width + 2 * kBeside) {}

  void mark(int y, uint8_t* STEREOPSIS_RESTRICT beside) {
    extremes_.find(y, least_.data(), most_.data());
    uint8_t* STEREOPSIS_RESTRICT const jumps = jumps_.data();
    for (int x = 0; x < width_; ++x) jumps[x + kBeside] = most_[x] - least_[x] > jump_;
    for (int x = 0; x < width_; ++x) {
      uint8_t any = 0;
      for (int k = 0; k <= 2 * kBeside; ++k) any |= jumps[x + k];
      beside[x] = any;
    }
  }

 private:
  Extremes extremes_;
  const int width_;
  const float jump_;
  std::vector<float> least_, most_;
  std::vector<uint8_t> jumps_;
};

// How pixels of an image that are alike weigh, by the largest difference of the channels. `Channels` 0: as many as there are.
template <int Channels>
struct Alike {
  const uint8_t* image;
  int channels;
  const int32_t* weights;

  int operator()(size_t p, size_t q) const {
    const int count = Channels ? Channels : channels;
    const uint8_t *const one = image + p * count, *const other = image + q * count;
    int most = 0;
    for (int c = 0; c < count; ++c) most = std::max(most, std::abs(one[c] - other[c]));
    return weights[most];
  }
};

void unite(const uint8_t* STEREOPSIS_RESTRICT one, int width, uint8_t* STEREOPSIS_RESTRICT all) {
  for (int x = 0; x < width; ++x) all[x] |= one[x];
}

// For every row whether there is an outline within kBeside columns of its pixels.
std::vector<uint8_t> outlined_columns(const float* disparity, int height, int width, float jump, const Workers& workers) {
  std::vector<uint8_t> columns(static_cast<size_t>(height) * width);
  parallel_rows(height, workers.threads, workers.interrupted, [&](int begin, int end, const Cancel& cancel) {
    Jumps jumps(disparity, height, width, jump);
    for (int y = begin; y < end && !cancel.load(std::memory_order_relaxed); ++y) jumps.mark(y, columns.data() + static_cast<size_t>(y) * width);
  });
  return columns;
}

// Whether there is an outline within kBeside rows and columns of each pixel of a row.
void mark_beside(const std::vector<uint8_t>& columns, int height, int width, int y, uint8_t* beside) {
  std::fill_n(beside, width, uint8_t{0});
  for (int v = std::max(0, y - kBeside); v <= std::min(height - 1, y + kBeside); ++v)
    unite(columns.data() + static_cast<size_t>(v) * width, width, beside);
}

// Gradients of an image of bytes, as differences over two pixels; edge pixels are repeated.
class Gradients {
 public:
  Gradients(const uint8_t* image, int height, int width, int y)
      : row_(image + static_cast<size_t>(y) * width),
        above_(image + static_cast<size_t>(std::max(0, y - 1)) * width),
        below_(image + static_cast<size_t>(std::min(height - 1, y + 1)) * width),
        last_(width - 1) {}

  int along(int x) const { return row_[std::min(x + 1, last_)] - row_[std::max(x - 1, 0)]; }
  int down(int x) const { return below_[x] - above_[x]; }
  int last() const { return last_; }

 private:
  const uint8_t *row_, *above_, *below_;
  const int last_;
};

// How far the gradients of two rows are apart at a pixel of the left one and what it meets at a disparity, in kUnits.
int unlike(const Gradients& left, const Gradients& right, int x, float disparity) {
  const int at = std::min(std::max(kUnits * x - parts_of(disparity, kUnits), 0), kUnits * right.last());
  const int one = at / kUnits, other = std::min(one + 1, right.last()), part = at % kUnits, rest = kUnits - part;
  return std::min(kMostApart, std::abs(kUnits * left.along(x) - rest * right.along(one) - part * right.along(other)) +
                                  std::abs(kUnits * left.down(x) - rest * right.down(one) - part * right.down(other)));
}

template <int Channels>
void give_to_nearer(const float* disparity, const uint8_t* doubtful, const Alike<Channels>& alike, int height, int width, float* moved,
                    const Workers& workers) {
  const auto at = [width](int y, int x) { return static_cast<size_t>(y) * width + x; };
  const std::vector<uint8_t> columns = outlined_columns(disparity, height, width, kJump, workers);
  const auto inside = [&](int y, int x, int reach, auto&& each) {
    for (int v = std::max(0, y - reach); v <= std::min(height - 1, y + reach); ++v)
      for (int u = std::max(0, x - reach); u <= std::min(width - 1, x + reach); ++u) each(at(v, u));
  };
  parallel_bands(height, 8, workers.threads, workers.interrupted, [&](int begin, int end, const Cancel& cancel) {
    std::vector<uint8_t> beside(width);
    for (int y = begin; y < end && !cancel.load(std::memory_order_relaxed); ++y) {
      std::copy_n(disparity + at(y, 0), width, moved + at(y, 0));
      mark_beside(columns, height, width, y, beside.data());
      for (int x = 0; x < width; ++x) {
        if (!doubtful[at(y, x)] || !beside[x]) continue;
        float farther = std::numeric_limits<float>::infinity(), nearer = -farther;
        inside(y, x, kAround, [&](size_t q) {
          farther = disparity[q] < farther ? disparity[q] : farther;
          nearer = disparity[q] > nearer ? disparity[q] : nearer;
        });
        const float span = nearer - farther;
        int votes = 0;
        for (int dy = -kStride * kStrides; dy <= kStride * kStrides; dy += kStride) {
          if (y + dy < 0 || y + dy >= height) continue;
          for (int dx = -kStride * kStrides; dx <= kStride * kStrides; dx += kStride) {
            if (x + dx < 0 || x + dx >= width) continue;
            const size_t q = at(y + dy, x + dx);
            if (doubtful[q]) continue;
            const int weight = alike(at(y, x), q);
            if (3 * std::abs(disparity[q] - nearer) < span) votes += weight;
            if (3 * std::abs(disparity[q] - farther) < span) votes -= weight;
          }
        }
        if (votes > 0) moved[at(y, x)] = nearer;
      }
    }
  });
}

template <int Channels>
void give_to_farther(const float* disparity, const uint8_t* doubtful, const GreyPair& grey, const Alike<Channels>& alike, int height,
                     int width, float* moved, const Workers& workers) {
  const auto at = [width](int y, int x) { return static_cast<size_t>(y) * width + x; };
  const size_t size = at(height, 0);
  Unset<uint8_t> beside(size);
  Unset<float> farther(size), nearer(size);
  Unset<int16_t> worse(size);  // how much worse a pixel beside a jump matches on the farther surface
  {
    const std::vector<uint8_t> columns = outlined_columns(disparity, height, width, kStep, workers);
    parallel_bands(height, 8, workers.threads, workers.interrupted, [&](int begin, int end, const Cancel& cancel) {
      Extremes sides(disparity, height, width, kAround);
      for (int y = begin; y < end && !cancel.load(std::memory_order_relaxed); ++y) {
        mark_beside(columns, height, width, y, beside.get() + at(y, 0));
        sides.find(y, farther.get() + at(y, 0), nearer.get() + at(y, 0));
        const Gradients left(grey.left, height, width, y), right(grey.right, height, width, y);
        for (int x = 0; x < width; ++x) {
          const size_t p = at(y, x);
          const int by = beside[p] ? unlike(left, right, x, farther[p]) - unlike(left, right, x, nearer[p]) : 0;
          worse[p] = static_cast<int16_t>(by);
        }
      }
    });
  }
  parallel_bands(height, 8, workers.threads, workers.interrupted, [&](int begin, int end, const Cancel& cancel) {
    for (int y = begin; y < end && !cancel.load(std::memory_order_relaxed); ++y) {
      std::copy_n(disparity + at(y, 0), width, moved + at(y, 0));
      for (int x = 0; x < width; ++x) {
        const size_t p = at(y, x);
        if (!beside[p] || !(disparity[p] - farther[p] > nearer[p] - disparity[p])) continue;
        const float span = nearer[p] - farther[p];
        int stays = kVote * alike.weights[0];
        for (int v = std::max(0, y - kPatch); v <= std::min(height - 1, y + kPatch); ++v)
          for (int u = std::max(0, x - kPatch); u <= std::min(width - 1, x + kPatch); ++u)
            if (worse[at(v, u)]) stays += alike(p, at(v, u)) * worse[at(v, u)];
        for (int dy = -kStride; dy <= kStride; dy += kStride) {
          if (y + dy < 0 || y + dy >= height) continue;
          for (int dx = -kStride * kStrides; dx <= kStride * kStrides; dx += kStride) {
            if (x + dx < 0 || x + dx >= width) continue;
            const size_t q = at(y + dy, x + dx);
            if (beside[q] || doubtful[q]) continue;
            if (3 * std::abs(disparity[q] - nearer[p]) < span) stays += kVote * alike(p, q);
            if (3 * std::abs(disparity[q] - farther[p]) < span) stays -= kVote * alike(p, q);
          }
        }
        if (stays < 0) moved[p] = farther[p];
      }
    }
  });
}

// `run` with weights for as many channels as there are, known to the compiler where they are the usual ones.
template <class Run>
void by_channels(const uint8_t* image, int channels, const int32_t* weights, const Run& run) {
  switch (channels) {
    case 1: return run(Alike<1>{image, channels, weights});
    case 3: return run(Alike<3>{image, channels, weights});
    default: return run(Alike<0>{image, channels, weights});
  }
}

}  // namespace

void outlines(const float* disparity, const uint8_t* doubtful, const uint8_t* image, int channels, const int32_t* alike, int height,
              int width, float* moved, const Workers& workers) {
  by_channels(image, channels, alike,
              [&](const auto& weight) { give_to_nearer(disparity, doubtful, weight, height, width, moved, workers); });
}

void unfatten(const float* disparity, const uint8_t* doubtful, const GreyPair& grey, const uint8_t* image, int channels,
              const int32_t* alike, int height, int width, float* moved, const Workers& workers) {
  by_channels(image, channels, alike,
              [&](const auto& weight) { give_to_farther(disparity, doubtful, grey, weight, height, width, moved, workers); });
}

}  // namespace stereopsis
