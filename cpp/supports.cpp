#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <utility>
#include <vector>

#include "dispatch.hpp"
#include "parallel.hpp"
#include "scratch.hpp"
#include "stages.hpp"

namespace stereopsis {

namespace {

int clamp(int v, int lo, int hi) { return std::min(std::max(v, lo), hi); }

// `value(y, x, c)` of the right image, as Reversed tells it, for columns first_x to last_x.
template <class Value>
Reversed reversed(const Pair& pair, int channels, int disparity_step, int first_x, int last_x, std::vector<double>& memory,
                  Value value) {
  const size_t length = (last_x - first_x) / disparity_step + static_cast<size_t>(pair.count) + kSupportCandidates;
  Reversed plane{nullptr, first_x, last_x, disparity_step, length, length * disparity_step, 0};
  plane.channel = plane.row * pair.height;
  memory.resize(plane.channel * channels);
  plane.data = memory.data();
  double* out = memory.data();
  for (int c = 0; c < channels; ++c)
    for (int y = 0; y < pair.height; ++y)
      for (int phase = 0; phase < disparity_step; ++phase)
        for (size_t k = 0; k < length; ++k) {
          const int64_t x = last_x - pair.first - phase - static_cast<int64_t>(k) * disparity_step;
          *out++ = value(y, static_cast<int>(std::min<int64_t>(std::max<int64_t>(x, 0), pair.width - 1)), c);
        }
  return plane;
}

// A job with both images as doubles, and the memory that it points to.
struct Prepared {
  std::vector<double> left, right, mean, square, right_mean, right_square, area;
  SupportJob job;

  Prepared(const Pair& pair, CostKind cost, const Sampling& sampling, int before, int after, float* costs) : job{} {
    const size_t values = static_cast<size_t>(pair.height) * pair.width * pair.channels;
    const auto* l = static_cast<const int32_t*>(pair.left);
    const auto* r = static_cast<const int32_t*>(pair.right);
    left.assign(l, l + values);
    job.cost = cost;
    job.height = pair.height;
    job.width = pair.width;
    job.channels = pair.channels;
    job.first = pair.first;
    job.count = pair.count;
    job.sampling = sampling;
    job.left = left.data();
    job.costs = costs;
    job.right = reversed(pair, pair.channels, sampling.disparity_step, -before, pair.width - 1 + after, right,
                         [&](int y, int x, int c) { return r[(static_cast<size_t>(y) * pair.width + x) * pair.channels + c]; });
  }
};

void run(SupportKernel kernel, const Prepared& prepared, int units, const SupportKernels& kernels, const Workers& workers) {
  parallel_rows(units, workers.threads, workers.interrupted, [&](int begin, int end, const Cancel& cancel) {
    const Scratch scratch(kernels.scratch_bytes(kernel, prepared.job));
    kernels.units(kernel, prepared.job, begin, end, scratch.memory, cancel);
  });
}

int rows_of(const SupportJob& job) { return sampled(job.height, job.sampling.step); }

// Tap (y, x) of the support, whose left pixel is repeated from the edge, with the right pixels of (y, x + offset).
Tap tap(const SupportJob& job, int y, int x, double weight) {
  const int row = clamp(y, 0, job.height - 1), column = clamp(x, 0, job.width - 1);
  return {weight, job.left + (static_cast<size_t>(row) * job.width + column) * job.channels, at(job.right, row, x)};
}

// ---- separable ---------------------------------------------------------------------------------------------------------

// Weighted means over both axes, edge pixels repeated, of `value(y, x)`, (H, W).
template <class Value>
std::vector<double> blurred(const SupportJob& job, const Workers& workers, Value value) {
  const int H = job.height, W = job.width, r = job.radius;
  std::vector<double> result(static_cast<size_t>(H) * W);
  parallel_rows(H, workers.threads, workers.interrupted, [&](int begin, int end, const Cancel& cancel) {
    std::vector<double> column(W);
    for (int y = begin; y < end && !cancel.load(std::memory_order_relaxed); ++y) {
      std::fill(column.begin(), column.end(), 0);
      for (int j = -r; j <= r; ++j)
        for (int x = 0; x < W; ++x) column[x] += job.taps[j + r] * value(clamp(y + j, 0, H - 1), x);
      double* out = result.data() + static_cast<size_t>(y) * W;
      for (int j = -r; j <= r; ++j)
        for (int x = 0; x < W; ++x) out[x] += job.taps[j + r] * column[clamp(x + j, 0, W - 1)];
    }
  });
  return result;
}

struct WeightedMoments {
  std::vector<double> mean, square;  // (H, W, C) and (H, W)
};

template <class Value>
WeightedMoments blurred_moments(const SupportJob& job, const Workers& workers, Value value) {
  const int C = job.channels;
  const size_t pixels = static_cast<size_t>(job.height) * job.width;
  WeightedMoments m{std::vector<double>(pixels * C), std::vector<double>(pixels)};
  for (int c = 0; c < C; ++c) {
    const auto mean = blurred(job, workers, [&](int y, int x) { return value(y, x, c); });
    for (size_t k = 0; k < pixels; ++k) m.mean[k * C + c] = mean[k];
  }
  m.square = blurred(job, workers, [&](int y, int x) {
    double sum = 0;
    for (int c = 0; c < C; ++c) sum += value(y, x, c) * value(y, x, c);
    return sum;
  });
  return m;
}

int gather_separable(const SupportJob& job, int y, int x, Tap* taps) {
  int n = 0;
  for (int j = -job.radius; j <= job.radius; ++j)
    for (int i = -job.radius; i <= job.radius; ++i)
      taps[n++] = tap(job, y + j, x + i, job.taps[j + job.radius] * job.taps[i + job.radius]);
  return n;
}

// ---- rectangles and crosses --------------------------------------------------------------------------------------------

// Sums over every pixel's support of `value(y, x)`, in integers, which wrap around on the way but not in the end.
template <class Value>
std::vector<uint64_t> support_sums(const SupportJob& job, bool cross, Value value) {
  const int H = job.height, W = job.width;
  const Reach& most = job.most;
  const int before = cross ? 0 : most.left, columns = W + (cross ? 0 : most.left + most.right);
  const int kept = cross ? W : columns + 1;
  const int above = cross ? 0 : most.above, rows = H + (cross ? 0 : most.above + most.below);
  std::vector<uint64_t> line(static_cast<size_t>(columns) + 1), sums(static_cast<size_t>(rows + 1) * kept);
  for (int k = 0; k < rows; ++k) {
    const int y = clamp(k - above, 0, H - 1);
    for (int i = 0; i < columns; ++i)
      line[i + 1] = line[i] + static_cast<uint64_t>(static_cast<int64_t>(value(y, clamp(i - before, 0, W - 1))));
    const uint64_t* from = sums.data() + static_cast<size_t>(k) * kept;
    uint64_t* to = sums.data() + static_cast<size_t>(k + 1) * kept;
    for (int i = 0; i < kept; ++i) {
      const Reach* reach = job.reach + static_cast<size_t>(y) * W;
      to[i] = from[i] + (cross ? line[i + reach[i].right + 1] - line[i - reach[i].left] : line[i]);
    }
  }
  std::vector<uint64_t> result(static_cast<size_t>(H) * W);
  for (int y = 0; y < H; ++y)
    for (int x = 0; x < W; ++x) {
      const size_t here = static_cast<size_t>(y) * W + x;
      const Reach& reach = job.reach[here];
      const uint64_t* upper = sums.data() + static_cast<size_t>(y + above - reach.above) * kept;
      const uint64_t* lower = sums.data() + static_cast<size_t>(y + above + reach.below + 1) * kept;
      const int begin = x + before - reach.left, end = x + before + reach.right + 1;
      result[here] = cross ? lower[x] - upper[x] : (lower[end] - lower[begin]) - (upper[end] - upper[begin]);
    }
  return result;
}

Reach most_of(const Reach* reach, size_t pixels) {
  Reach most{0, 0, 0, 0};
  for (size_t k = 0; k < pixels; ++k) {
    most.left = std::max(most.left, reach[k].left);
    most.right = std::max(most.right, reach[k].right);
    most.above = std::max(most.above, reach[k].above);
    most.below = std::max(most.below, reach[k].below);
  }
  return most;
}

int gather_rectangle(const SupportJob& job, int y, int x, Tap* taps) {
  const size_t here = static_cast<size_t>(y) * job.width + x;
  const Reach& reach = job.reach[here];
  int n = 0;
  for (int j = -reach.above; j <= reach.below; ++j)
    for (int i = -reach.left; i <= reach.right; ++i) taps[n++] = tap(job, y + j, x + i, 1 / job.area[here]);
  return n;
}

int gather_cross(const SupportJob& job, int y, int x, Tap* taps) {
  const size_t here = static_cast<size_t>(y) * job.width + x;
  int n = 0;
  for (int j = -job.reach[here].above; j <= job.reach[here].below; ++j) {
    const Reach& reach = job.reach[here + static_cast<int64_t>(j) * job.width];
    for (int i = -reach.left; i <= reach.right; ++i) taps[n++] = tap(job, y + j, x + i, 1 / job.area[here]);
  }
  return n;
}

// ---- bilateral ---------------------------------------------------------------------------------------------------------

struct Bilateral {
  Window window;
  double per_colour;              // 1 / sigma_colour
  std::vector<double> space;      // exponents, (height, width)
  std::vector<double> of_square;  // weights by squared distance of colour, for those that 8-bit pixels have
};

double colour_weight(const Bilateral& b, const double* one, const double* other, int channels) {
  double square = 0;
  for (int c = 0; c < channels; ++c) square += (one[c] - other[c]) * (one[c] - other[c]);
  if (square < static_cast<double>(b.of_square.size())) return b.of_square[static_cast<size_t>(square)];
  return std::exp(-std::sqrt(square / channels) * b.per_colour);
}

int gather_bilateral(const SupportJob& job, int y, int x, Tap* taps) {
  const auto& b = *static_cast<const Bilateral*>(job.gatherer);
  const double* centre = job.left + (static_cast<size_t>(y) * job.width + x) * job.channels;
  int n = 0;
  double sum = 0;
  for (int j = -b.window.above(); j <= b.window.below(); ++j)
    for (int i = -b.window.left(); i <= b.window.right(); ++i, ++n) {
      taps[n] = tap(job, y + j, x + i, b.space[n]);
      sum += taps[n].weight *= colour_weight(b, centre, taps[n].left, job.channels);
    }
  for (int k = 0; k < n; ++k) taps[k].weight /= sum;
  return n;
}

}  // namespace

void separable_costs(const Pair& pair, CostKind cost, const Sampling& sampling, const double* taps, int radius, float* costs,
                     const SupportKernels& kernels, const Workers& workers) {
  Prepared prepared(pair, cost, sampling, radius, radius, costs);
  SupportJob& job = prepared.job;
  job.taps = taps;
  job.radius = radius;
  job.gather = gather_separable;
  job.most_taps = (2 * static_cast<size_t>(radius) + 1) * (2 * radius + 1);
  if (cost != CostKind::sad && cost != CostKind::zsad && cost != CostKind::ssd) {
    const int W = pair.width, C = pair.channels;
    const auto* r = static_cast<const int32_t*>(pair.right);
    WeightedMoments of_left = blurred_moments(
        job, workers, [&](int y, int x, int c) { return prepared.left[(static_cast<size_t>(y) * W + x) * C + c]; });
    const WeightedMoments of_right = blurred_moments(job, workers, [&](int y, int x, int c) {
      return static_cast<double>(r[(static_cast<size_t>(y) * W + x) * C + c]);
    });
    prepared.mean = std::move(of_left.mean);
    prepared.square = std::move(of_left.square);
    const auto turned = [&](const std::vector<double>& plane, int channels, std::vector<double>& memory) {
      return reversed(pair, channels, sampling.disparity_step, 0, W - 1, memory,
                      [&](int y, int x, int c) { return plane[(static_cast<size_t>(y) * W + x) * channels + c]; });
    };
    job.right_mean = turned(of_right.mean, C, prepared.right_mean);
    job.right_square = turned(of_right.square, 1, prepared.right_square);
  } else {
    const size_t pixels = static_cast<size_t>(pair.height) * pair.width;
    prepared.mean.resize(pixels * pair.channels);
    prepared.square.resize(pixels);
  }
  job.mean = prepared.mean.data();
  job.square = prepared.square.data();
  run(SupportKernel::separable, prepared, rows_of(job), kernels, workers);
}

void reach_costs(const Pair& pair, CostKind cost, const Sampling& sampling, bool cross, const Reach* reach, float* costs,
                 const SupportKernels& kernels, const Workers& workers) {
  const size_t pixels = static_cast<size_t>(pair.height) * pair.width;
  const int C = pair.channels;
  const Reach most = most_of(reach, pixels);
  Prepared prepared(pair, cost, sampling, cross ? 0 : most.left, cross ? 0 : most.right, costs);
  SupportJob& job = prepared.job;
  job.reach = reach;
  job.most = most;
  job.gather = cross ? gather_cross : gather_rectangle;
  job.most_taps = (static_cast<size_t>(most.left) + most.right + 1) * (static_cast<size_t>(most.above) + most.below + 1);

  const auto* l = static_cast<const int32_t*>(pair.left);
  const auto area = support_sums(job, cross, [](int, int) { return 1; });
  prepared.area.assign(area.begin(), area.end());
  prepared.mean.resize(pixels * C);
  prepared.square.resize(pixels);
  for (int c = 0; c < C; ++c) {
    const auto value = [&](int y, int x) { return static_cast<int64_t>(l[(static_cast<size_t>(y) * pair.width + x) * C + c]); };
    const auto sum = support_sums(job, cross, value);
    const auto square = support_sums(job, cross, [&](int y, int x) { return value(y, x) * value(y, x); });
    for (size_t k = 0; k < pixels; ++k) {
      prepared.mean[k * C + c] = static_cast<double>(static_cast<int64_t>(sum[k])) / prepared.area[k];
      prepared.square[k] += static_cast<double>(static_cast<int64_t>(square[k])) / prepared.area[k];
    }
  }
  job.area = prepared.area.data();
  job.mean = prepared.mean.data();
  job.square = prepared.square.data();
  const int rows = rows_of(job);
  run(cross ? SupportKernel::cross : SupportKernel::rectangle, prepared,
      cost == CostKind::zsad ? rows : (rows + kRowsInBlock - 1) / kRowsInBlock, kernels, workers);
}

void bilateral_costs(const Pair& pair, CostKind cost, const Sampling& sampling, const Window& window, double sigma_space,
                     double sigma_colour, float* costs, const SupportKernels& kernels, const Workers& workers) {
  Prepared prepared(pair, cost, sampling, window.left(), window.right(), costs);
  SupportJob& job = prepared.job;
  Bilateral bilateral{window, 1 / sigma_colour, {}, {}};
  for (int j = -window.above(); j <= window.below(); ++j)
    for (int i = -window.left(); i <= window.right(); ++i)
      bilateral.space.push_back(std::exp(-std::sqrt(static_cast<double>(i) * i + static_cast<double>(j) * j) / sigma_space));
  for (int square = 0; square <= 255 * 255 * pair.channels; ++square)
    bilateral.of_square.push_back(std::exp(-std::sqrt(static_cast<double>(square) / pair.channels) / sigma_colour));
  job.gather = gather_bilateral;
  job.gatherer = &bilateral;
  job.most_taps = static_cast<size_t>(window.area());
  run(SupportKernel::any, prepared, rows_of(job), kernels, workers);
}

void cross_arms(const int32_t* image, int height, int width, int channels, int arm, double threshold, Reach* reach,
                const Workers& workers) {
  parallel_rows(height, workers.threads, workers.interrupted, [&](int begin, int end, const Cancel& cancel) {
    for (int y = begin; y < end && !cancel.load(std::memory_order_relaxed); ++y)
      for (int x = 0; x < width; ++x) {
        const auto pixel = [&](int row, int column) {
          return image + (static_cast<size_t>(row) * width + column) * channels;
        };
        const auto alike = [&](int row, int column) {
          for (int c = 0; c < channels; ++c) {
            const int64_t difference = static_cast<int64_t>(pixel(y, x)[c]) - pixel(row, column)[c];
            if (static_cast<double>(std::abs(difference)) > threshold) return false;
          }
          return true;
        };
        // An arm ends before the first pixel that differs, but reaches its neighbour at least.
        const auto length = [&](int down, int across, int room) {
          int k = 0;
          while (k < std::min(arm, room) && alike(y + (k + 1) * down, x + (k + 1) * across)) ++k;
          return std::max(k, std::min(1, room));
        };
        reach[static_cast<size_t>(y) * width + x] = {length(0, -1, x), length(0, 1, width - 1 - x), length(-1, 0, y),
                                                     length(1, 0, height - 1 - y)};
      }
  });
}

}  // namespace stereopsis
