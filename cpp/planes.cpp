#include "planes.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include "parallel.hpp"

namespace stereopsis {

namespace {

bool exists(const Plane& plane) { return !std::isnan(plane.c); }

Plane plane_at(const double* planes, int i) { return {planes[3 * i], planes[3 * i + 1], planes[3 * i + 2]}; }

void put(double* planes, int i, const Plane& plane) {
  planes[3 * i] = plane.a;
  planes[3 * i + 1] = plane.b;
  planes[3 * i + 2] = plane.c;
}

bool allowed(const SegmentModel& model, const Plane& plane) {
  return std::fabs(plane.a) <= model.most_a && std::fabs(plane.b) <= model.most_b;
}

// Points with a disparity and a weight. All but the weights are whole, or float32 as they came: nothing is lost.
struct Points {
  const float *x, *y, *d, *weight;
  int count;

  double rest(int k, const Plane& plane) const { return plane.at(x[k], y[k]) - d[k]; }
};

// Each segment's pixels that are believed at all, row by row.
class Members {
 public:
  Members(const Observed& seen, const int32_t* label, int count) : start_(count + 1) {
    const size_t pixels = static_cast<size_t>(seen.height) * seen.width;
    for (size_t p = 0; p < pixels; ++p)
      if (seen.weight[p] > 0) ++start_[label[p] + 1];
    for (int i = 0; i < count; ++i) start_[i + 1] += start_[i];
    for (auto* values : {&x_, &y_, &d_, &weight_}) values->resize(start_[count]);
    std::vector<int> next(start_.begin(), start_.end() - 1);
    size_t p = 0;
    for (int y = 0; y < seen.height; ++y)
      for (int x = 0; x < seen.width; ++x, ++p) {
        if (!(seen.weight[p] > 0)) continue;
        const int k = next[label[p]]++;
        x_[k] = static_cast<float>(x);
        y_[k] = static_cast<float>(y);
        d_[k] = seen.disparity[p];
        weight_[k] = seen.weight[p];
      }
  }

  Points of(int i) const {
    const int k = start_[i];
    return {x_.data() + k, y_.data() + k, d_.data() + k, weight_.data() + k, start_[i + 1] - k};
  }

 private:
  std::vector<int> start_;
  std::vector<float> x_, y_, d_, weight_;
};

// Sum of weighted truncated squares, in four partial sums: steps of four points each, which compilers turn into vectors.
double misfit(const Points& points, double truncation, const Plane& plane) {
  constexpr int kLanes = 4;
  const Plane on = plane;
  double sums[kLanes] = {0, 0, 0, 0};
  int k = 0;
  for (; k + kLanes <= points.count; k += kLanes) {
    const float *x = points.x + k, *y = points.y + k, *d = points.d + k, *weight = points.weight + k;
    double square[kLanes];
    for (int j = 0; j < kLanes; ++j) square[j] = on.at(x[j], y[j]) - d[j];
    for (int j = 0; j < kLanes; ++j) square[j] *= square[j];
    for (int j = 0; j < kLanes; ++j) square[j] = square[j] < truncation ? square[j] : truncation;
    for (int j = 0; j < kLanes; ++j) sums[j] += weight[j] * square[j];
  }
  for (; k < points.count; ++k) {
    const double rest = points.rest(k, on);
    sums[0] += points.weight[k] * std::min(rest * rest, truncation);
  }
  return (sums[0] + sums[1]) + (sums[2] + sums[3]);
}

// Sums over points: what the mean square of a plane over them, and least squares, are made of.
struct Spread {
  double n = 0, x = 0, y = 0, xx = 0, xy = 0, yy = 0;

  void add(double at_x, double at_y, double weight) {
    n += weight;
    x += weight * at_x;
    y += weight * at_y;
    xx += weight * at_x * at_x;
    xy += weight * at_x * at_y;
    yy += weight * at_y * at_y;
  }
  void add(const Spread& other, double weight) {
    n += weight * other.n;
    x += weight * other.x;
    y += weight * other.y;
    xx += weight * other.xx;
    xy += weight * other.xy;
    yy += weight * other.yy;
  }
  double mean_square(const Plane& p) const {
    return (p.a * p.a * xx + p.b * p.b * yy + p.c * p.c * n + 2 * (p.a * p.b * xy + p.a * p.c * x + p.b * p.c * y)) / n;
  }
};

struct LeastSquares {
  Spread moments;
  double d = 0, xd = 0, yd = 0;

  void add(const Points& points, double truncation, const Plane& near) {
    for (int k = 0; k < points.count; ++k) {
      const double rest = points.rest(k, near);
      if (!(rest * rest < truncation)) continue;
      const double weighted = static_cast<double>(points.weight[k]) * points.d[k];
      moments.add(points.x[k], points.y[k], points.weight[k]);
      d += weighted;
      xd += weighted * points.x[k];
      yd += weighted * points.y[k];
    }
  }
  // As if so many points lay on a plane.
  void add(const Spread& other, const Plane& on, double weight) {
    moments.add(other, weight);
    d += weight * (on.a * other.x + on.b * other.y + on.c * other.n);
    xd += weight * (on.a * other.xx + on.b * other.xy + on.c * other.x);
    yd += weight * (on.a * other.xy + on.b * other.yy + on.c * other.y);
  }
  // False where the points lie too close to a line.
  bool solve(Plane* plane) const {
    const Spread& m = moments;
    if (!(m.n > 0)) return false;
    const double x = m.x / m.n, y = m.y / m.n, mean = d / m.n;
    const double xx = m.xx - m.x * x, xy = m.xy - m.x * y, yy = m.yy - m.y * y;
    const double ux = xd - m.x * mean, uy = yd - m.y * mean;
    const double determinant = xx * yy - xy * xy;
    // Below the first bound the spread is nothing but rounding.
    if (!(xx > 1e-9 * m.xx && yy > 1e-9 * m.yy && determinant > 1e-6 * xx * yy)) return false;
    plane->a = (ux * yy - uy * xy) / determinant;
    plane->b = (uy * xx - ux * xy) / determinant;
    plane->c = mean - plane->a * x - plane->b * y;
    return true;
  }
};

// A generator of its own, so that every machine draws the same samples.
struct Draws {
  uint64_t state;
  int below(int n) {
    state = state * 6364136223846793005u + 1442695040888963407u;
    return static_cast<int>((state >> 33) % static_cast<uint32_t>(n));
  }
};

constexpr int kScored = 64;   // at least so many points are scored, or all
constexpr double kArea = 16;  // twice the least triangle whose plane means something, in pixels

Plane fitted(const SegmentModel& model, const Points& points, int number, int trials, const Plane& held) {
  const int step = std::max(1, points.count / kScored);
  float sampled[4][2 * kScored];
  Points sample{sampled[0], sampled[1], sampled[2], sampled[3], 0};
  for (int k = 0; k < points.count; k += step, ++sample.count) {
    sampled[0][sample.count] = points.x[k];
    sampled[1][sample.count] = points.y[k];
    sampled[2][sample.count] = points.d[k];
    sampled[3][sample.count] = points.weight[k];
  }
  Draws draws{static_cast<uint64_t>(number) * 2654435761u + 1};
  Plane best = held;
  double least = exists(held) ? misfit(sample, model.truncation, held) : std::numeric_limits<double>::infinity();
  const auto consider = [&](const Plane& plane) {
    if (!allowed(model, plane)) return;
    const double rest = misfit(sample, model.truncation, plane);
    if (rest < least) {
      least = rest;
      best = plane;
    }
  };
  struct Point {
    double x, y, d;
  };
  const auto drawn = [&]() -> Point {
    const int k = draws.below(points.count);
    return {points.x[k], points.y[k], points.d[k]};
  };
  for (int trial = 0; trial < trials; ++trial) {
    const Point p = drawn(), q = drawn(), r = drawn();
    consider({0, 0, p.d});
    const double ux = q.x - p.x, uy = q.y - p.y, ud = q.d - p.d, vx = r.x - p.x, vy = r.y - p.y, vd = r.d - p.d;
    const double twice_area = ux * vy - uy * vx;
    if (std::fabs(twice_area) < kArea) continue;
    const double a = (ud * vy - uy * vd) / twice_area, b = (ux * vd - ud * vx) / twice_area;
    consider({a, b, p.d - a * p.x - b * p.y});
  }
  for (int polish = 0; polish < 2; ++polish) {
    LeastSquares squares;
    squares.add(points, model.truncation, best);
    Plane polished;
    if (squares.solve(&polished) && allowed(model, polished)) best = polished;
  }
  const auto whole = [&](const Plane& plane) { return misfit(points, model.truncation, plane); };
  return !exists(held) || whole(best) < whole(held) ? best : held;
}

struct Neighbour {
  int number;
  int boundary;
};

// Which segments meet; for each boundary its places, and all pixels of both segments.
struct Graph {
  std::vector<Spread> boundaries, both;
  std::vector<std::vector<Neighbour>> neighbours;

  Graph(const int32_t* label, int height, int width, int count) : neighbours(count) {
    std::vector<Spread> segments(count);
    for (int y = 0; y < height; ++y) {
      const int32_t* row = label + static_cast<size_t>(y) * width;
      for (int x = 0; x < width; ++x) {
        segments[row[x]].add(x, y, 1);
        if (x + 1 < width && row[x + 1] != row[x]) boundaries[between(row[x], row[x + 1])].add(x + 0.5, y, 1);
        if (y + 1 < height && row[x + width] != row[x]) boundaries[between(row[x], row[x + width])].add(x, y + 0.5, 1);
      }
    }
    both.resize(boundaries.size());
    for (int i = 0; i < count; ++i)
      for (const Neighbour& other : neighbours[i]) both[other.boundary].add(segments[i], 1);
  }

  int between(int i, int j) {
    for (const Neighbour& known : neighbours[i])
      if (known.number == j) return known.boundary;
    const int number = static_cast<int>(boundaries.size());
    boundaries.emplace_back();
    neighbours[i].push_back({j, number});
    neighbours[j].push_back({i, number});
    return number;
  }
};

enum class Meeting : int { coplanar, hinge, occlusion };

}  // namespace

void fit_planes(const Observed& seen, const SegmentModel& model, const int32_t* label, int count, int trials, double* planes,
                const Workers& workers) {
  const Members members(seen, label, count);
  parallel_rows(count, workers.threads, workers.interrupted, [&](int begin, int end, const Cancel& cancel) {
    for (int i = begin; i < end && !cancel.load(std::memory_order_relaxed); ++i)
      if (const Points points = members.of(i); points.count > 0)
        put(planes, i, fitted(model, points, i, trials, plane_at(planes, i)));
  });
}

void move_boundaries(const Observed& seen, const SegmentModel& model, const double* planes, int count, int sweeps,
                     int32_t* label, const Workers& workers) {
  const int H = seen.height, W = seen.width, C = seen.channels;
  struct Mean {
    double colour[3] = {0, 0, 0}, x = 0, y = 0, n = 0;
  };
  std::vector<Mean> means(count);
  const float* pixel = seen.image;
  for (int y = 0; y < H; ++y)
    for (int x = 0; x < W; ++x, pixel += C) {
      Mean& mean = means[label[static_cast<size_t>(y) * W + x]];
      for (int c = 0; c < C; ++c) mean.colour[c] += pixel[c];
      mean.x += x;
      mean.y += y;
      mean.n += 1;
    }
  for (Mean& mean : means) {
    for (double& value : mean.colour) value /= mean.n;
    mean.x /= mean.n;
    mean.y /= mean.n;
  }

  // Around a pixel, from its upper left on; the odd ones share a side with it.
  constexpr int kX[8] = {-1, 0, 1, 1, 1, 0, -1, -1}, kY[8] = {-1, -1, -1, 0, 1, 1, 1, 0};
  const double colour_weight = 3.0 / C, position_weight = model.position / (model.side * model.side);
  // The turn in which each pixel moved last. Where nothing around has moved since its own last turn, it would stay again.
  std::vector<uint8_t> moved(static_cast<size_t>(H) * W, 0);
  const auto move = [&](int x, int y, int turn) {
    const size_t p = static_cast<size_t>(y) * W + x;
    const int32_t own = label[p];
    const bool inside = (x == 0 || label[p - 1] == own) && (x + 1 == W || label[p + 1] == own) &&
                        (y == 0 || label[p - W] == own) && (y + 1 == H || label[p + W] == own);
    if (inside) return;
    if (turn > 4) {
      bool still = true;
      for (int v = std::max(y - 1, 0); v <= std::min(y + 1, H - 1); ++v)
        for (int u = std::max(x - 1, 0); u <= std::min(x + 1, W - 1); ++u)
          still &= moved[static_cast<size_t>(v) * W + u] + 4 < turn;
      if (still) return;
    }
    int32_t around[8];
    for (int k = 0; k < 8; ++k) {
      const int u = x + kX[k], v = y + kY[k];
      around[k] = u < 0 || v < 0 || u >= W || v >= H ? -1 : label[static_cast<size_t>(v) * W + u];
    }
    // Those of its own segment that it touches have to hang together without it, around it.
    int pieces = 0;
    for (int k = 1; k < 8; k += 2)
      pieces += around[k] == own && !(around[k - 1] == own && around[(k + 6) % 8] == own);
    if (pieces != 1) return;
    const auto energy = [&](int32_t l) {
      const Mean& mean = means[l];
      double colour = 0;
      for (int c = 0; c < C; ++c) {
        const double apart = seen.image[p * C + c] - mean.colour[c];
        colour += apart * apart;
      }
      const double dx = x - mean.x, dy = y - mean.y;
      double sum = colour_weight * colour + position_weight * (dx * dx + dy * dy);
      if (seen.weight[p] > 0) {
        const Plane plane = plane_at(planes, l);
        const double rest = plane.at(x, y) - seen.disparity[p];
        sum += model.depth * (exists(plane) ? std::min(rest * rest, model.truncation) : model.truncation);
      }
      int others = 0;
      for (const int32_t other : around) others += other >= 0 && other != l;
      return sum + model.boundary * others;
    };
    int32_t best = own;
    double least = energy(own);
    for (int k = 1; k < 8; k += 2)
      if (around[k] >= 0 && around[k] != own) {
        const double tried = energy(around[k]);
        if (tried < least) {
          least = tried;
          best = around[k];
        }
      }
    if (best == own) return;
    label[p] = best;
    moved[p] = static_cast<uint8_t>(turn);
  };
  for (int sweep = 0; sweep < sweeps; ++sweep)
    // No two pixels of a phase touch, so the order in which they move does not matter.
    for (int phase = 0; phase < 4; ++phase) {
      if (workers.interrupted()) throw Interrupted();
      const int first = phase / 2;
      parallel_rows((H - first + 1) / 2, workers.threads, workers.interrupted, [&](int begin, int end, const Cancel& cancel) {
        for (int row = begin; row < end && !cancel.load(std::memory_order_relaxed); ++row)
          for (int x = phase % 2; x < W; x += 2) move(x, 2 * row + first, 4 * sweep + phase + 1);
      });
    }
}

void smooth_planes(const Observed& seen, const SegmentModel& model, const int32_t* label, int count, int columns, int rounds,
                   double* planes, const Workers& workers) {
  const Members members(seen, label, count);
  const Graph graph(label, seen.height, seen.width, count);
  // How two planes meet: as one, in a fold, or with a step between them, whichever costs least.
  const auto meet = [&](const Plane& p, const Neighbour& other, const Plane& q, Meeting* how) {
    const Plane apart{p.a - q.a, p.b - q.b, p.c - q.c};
    const Spread& boundary = graph.boundaries[other.boundary];
    const double coplanar = graph.both[other.boundary].mean_square(apart), fold = model.hinge + boundary.mean_square(apart);
    double least = coplanar;
    *how = Meeting::coplanar;
    if (fold < least) {
      least = fold;
      *how = Meeting::hinge;
    }
    if (model.occlusion < least) {
      least = model.occlusion;
      *how = Meeting::occlusion;
    }
    return model.smoothness * boundary.n * least;
  };

  std::vector<int> order[4];
  for (int i = 0; i < count; ++i) order[2 * (i / columns % 2) + i % columns % 2].push_back(i);
  std::vector<double> before(planes, planes + static_cast<size_t>(count) * 3);
  for (int turn = 0; turn < 4 * rounds; ++turn) {
    if (workers.interrupted()) throw Interrupted();
    const std::vector<int>& now = order[turn % 4];
    parallel_rows(static_cast<int>(now.size()), workers.threads, workers.interrupted,
                  [&](int begin, int end, const Cancel& cancel) {
      for (int z = begin; z < end && !cancel.load(std::memory_order_relaxed); ++z) {
        const int i = now[z];
        const Points points = members.of(i);
        const std::vector<Neighbour>& neighbours = graph.neighbours[i];
        Plane best = plane_at(before.data(), i);
        double least = std::numeric_limits<double>::infinity();
        const auto consider = [&](const Plane& plane) {
          double sum = 0;
          Meeting how;
          for (const Neighbour& other : neighbours) {
            const Plane theirs = plane_at(before.data(), other.number);
            if (exists(theirs)) sum += meet(plane, other, theirs, &how);
            if (!(sum < least)) return;
          }
          sum += misfit(points, model.truncation, plane);
          if (sum < least) {
            least = sum;
            best = plane;
          }
        };
        if (exists(best)) consider(best);
        for (const Neighbour& other : neighbours) {
          const Plane theirs = plane_at(before.data(), other.number);
          const bool same = theirs.a == best.a && theirs.b == best.b && theirs.c == best.c;
          if (exists(theirs) && !same) consider(theirs);
        }
        if (!exists(best)) continue;
        LeastSquares squares;
        squares.add(points, model.truncation, best);
        for (const Neighbour& other : neighbours) {
          const Plane theirs = plane_at(before.data(), other.number);
          if (!exists(theirs)) continue;
          Meeting how;
          meet(best, other, theirs, &how);
          const Spread& boundary = graph.boundaries[other.boundary];
          if (how == Meeting::coplanar) {
            const Spread& both = graph.both[other.boundary];
            squares.add(both, theirs, model.smoothness * boundary.n / both.n);
          } else if (how == Meeting::hinge) {
            squares.add(boundary, theirs, model.smoothness);
          }
        }
        Plane compromise;
        if (squares.solve(&compromise) && allowed(model, compromise)) consider(compromise);
        put(planes, i, best);
      }
    });
    for (const int i : now) put(before.data(), i, plane_at(planes, i));
  }
}

void render_planes(const int32_t* label, int height, int width, const double* planes, double least, double most,
                   float* disparity, const Workers& workers) {
  parallel_rows(height, workers.threads, workers.interrupted, [&](int begin, int end, const Cancel& cancel) {
    for (int y = begin; y < end && !cancel.load(std::memory_order_relaxed); ++y)
      for (int x = 0; x < width; ++x) {
        const size_t p = static_cast<size_t>(y) * width + x;
        const double value = plane_at(planes, label[p]).at(x, y);
        // In this order NaN stays NaN.
        disparity[p] = static_cast<float>(std::min(std::max(value, least), most));
      }
  });
}

}  // namespace stereopsis
