#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include "parallel.hpp"
#include "planar.hpp"
#include "stages.hpp"
#include "winners.hpp"

namespace stereopsis {

namespace {

// A generator of its own, so that every machine draws the same samples.
struct Draws {
  uint64_t state;
  int below(size_t n) {
    state = state * 6364136223846793005u + 1442695040888963407u;
    return static_cast<int>((state >> 33) % n);
  }
};

double distance(const Plane& p, const Point& at) { return std::fabs(p.at(at.x, at.y) - at.d); }

// The plane through three points; false where they lie too close to a line for its slopes to mean anything.
bool through(const Point& p, const Point& q, const Point& r, Plane* plane) {
  const double px = p.x, py = p.y, pd = p.d;
  const double ux = q.x - px, uy = q.y - py, ud = q.d - pd, vx = r.x - px, vy = r.y - py, vd = r.d - pd;
  const double twice_area = ux * vy - uy * vx;
  if (std::fabs(twice_area) < 64) return false;
  plane->a = (ud * vy - uy * vd) / twice_area;
  plane->b = (ux * vd - ud * vx) / twice_area;
  plane->c = pd - plane->a * px - plane->b * py;
  return true;
}

// Sums over the sample of what each of `count` planes leaves; all stop early once none of them is below `least`.
void leave(const std::vector<Point>& sample, const Plane* planes, int count, double tolerance, double least,
           const PlanarKernel& kernel, double* sums) {
  constexpr size_t kStretch = 64;
  PlanesTried tried{};
  double sum[kSideBySide] = {};
  for (int i = 0; i < count; ++i) tried.a[i] = planes[i].a, tried.b[i] = planes[i].b, tried.c[i] = planes[i].c;
  for (size_t from = 0; from < sample.size() && *std::min_element(sum, sum + count) < least; from += kStretch)
    kernel.leave(sample.data() + from, std::min(kStretch, sample.size() - from), tried, tolerance, sum);
  std::copy_n(sum, count, sums);
}

// Least squares over the points within `tolerance` of the plane, about their mean, which keeps the sums small. Others count 0
// times, as a processor guesses badly which these are.
void polish(const std::vector<Point>& points, double tolerance, Plane* plane) {
  double n = 0, x = 0, y = 0, d = 0;
  for (const Point& at : points) {
    const double on = distance(*plane, at) <= tolerance ? 1 : 0;
    n += on;
    x += on * at.x;
    y += on * at.y;
    d += on * at.d;
  }
  if (n < 3) return;
  x /= n;
  y /= n;
  d /= n;
  double xx = 0, xy = 0, yy = 0, xd = 0, yd = 0;
  for (const Point& at : points) {
    const double on = distance(*plane, at) <= tolerance ? 1 : 0;
    const double u = at.x - x, v = at.y - y, w = at.d - d;
    xx += on * (u * u);
    xy += on * (u * v);
    yy += on * (v * v);
    xd += on * (u * w);
    yd += on * (v * w);
  }
  const double determinant = xx * yy - xy * xy;
  if (!(determinant > 1e-9 * xx * yy)) return;
  plane->a = (xd * yy - yd * xy) / determinant;
  plane->b = (yd * xx - xd * xy) / determinant;
  plane->c = d - plane->a * x - plane->b * y;
}

// What remains of the left window once the right one has explained what it can, up to a factor that all candidates share:
// the sum of squares that a regression on the right window leaves, or the window's squared difference.
double misfit(CostKind kind, double cost) {
  if (is_correlation(kind)) return 1 + cost * std::fabs(cost);
  return kind == CostKind::sad || kind == CostKind::zsad ? cost * cost : cost;
}

}  // namespace

constexpr size_t kPolished = 1 << 16;  // places that the least squares look at
constexpr int kTries = 16;  // places that are tried for one with a value

int find_plane(const float* disparity, int height, int width, const PlaneSearch& search, Plane* plane,
               const PlanarKernel& kernel, const Workers& workers) {
  const size_t places = static_cast<size_t>(std::max(height - search.top, 0)) * width;
  const float* const from = disparity + static_cast<size_t>(search.top) * width;
  const auto point_at = [&](size_t place) -> Point {
    return {static_cast<float>(place % width), static_cast<float>(search.top + static_cast<int>(place / width)), from[place]};
  };
  size_t known = 0;
  for (size_t place = 0; place < places; ++place) known += from[place] == from[place];
  if (known < 3) return 0;
  // Samples are drawn by their places, so that a pixel more or less changes no more than the trials that meet it. Where few
  // pixels have a value, places lie closer, and more of them are tried.
  int sparse = 0;
  while (sparse < 6 && known << (sparse + 1) <= places) ++sparse;
  const size_t step = std::max<size_t>(1, (places + search.sample - 1) / search.sample >> sparse);
  const auto every = [&](size_t apart) {
    std::vector<Point> points;
    points.reserve(std::min(known, places / apart + 1));
    size_t x = 0;
    int y = search.top;
    for (size_t place = 0; place < places; place += apart, x += apart) {
      for (; x >= static_cast<size_t>(width); x -= width) ++y;
      if (!std::isnan(from[place])) points.push_back({static_cast<float>(x), static_cast<float>(y), from[place]});
    }
    return points;
  };
  const std::vector<Point> sample = every(step);

  Draws draws{1};
  const size_t choices = (places + step - 1) / step;
  const auto any = [&]() -> Point {
    size_t place = 0;
    for (int tries = 0; tries < kTries << sparse; ++tries) {
      place = draws.below(choices) * step;
      if (!std::isnan(from[place])) break;
    }
    return point_at(place);
  };
  std::vector<Plane> tried;
  for (int trial = 0; trial < search.trials; ++trial) {
    const Point first = any();
    const auto another = [&]() -> Point {
      if (search.radius == 0) return any();
      const int side = 2 * search.radius + 1;
      const int x = static_cast<int>(first.x) + draws.below(side) - search.radius;
      const int y = static_cast<int>(first.y) + draws.below(side) - search.radius;
      const bool inside = x >= 0 && x < width && y >= search.top && y < height;
      // A point without a disparity spoils every comparison below, and so the trial.
      return {static_cast<float>(x), static_cast<float>(y),
              inside ? disparity[static_cast<size_t>(y) * width + x] : std::numeric_limits<float>::quiet_NaN()};
    };
    const Point second = another(), third = another();
    Plane through_them;
    if (!through(first, second, third, &through_them)) continue;
    if (std::fabs(through_them.a) <= search.most_a && through_them.b >= search.least_b && through_them.b <= search.most_b)
      tried.push_back(through_them);
  }
  if (tried.empty()) return 0;
  // Of equally good ones the first; each thread stops by the best of its own, which changes the time alone.
  const int count = static_cast<int>(tried.size());
  std::vector<double> left(tried.size());
  parallel_rows((count + kSideBySide - 1) / kSideBySide, workers.threads, workers.interrupted,
                [&](int begin, int end, const Cancel& cancel) {
    double least = std::numeric_limits<double>::infinity();
    for (int i = begin * kSideBySide; i < std::min(count, end * kSideBySide) && !cancel.load(std::memory_order_relaxed);
         i += kSideBySide) {
      const int some = std::min(kSideBySide, count - i);
      leave(sample, tried.data() + i, some, search.tolerance, least, kernel, left.data() + i);
      least = std::min(least, *std::min_element(left.begin() + i, left.begin() + i + some));
    }
  });
  *plane = tried[std::min_element(left.begin(), left.end()) - left.begin()];
  const std::vector<Point> points = every(std::max<size_t>(1, places / kPolished >> sparse));
  for (const double reach : {2.0, 1.0, 1.0}) polish(points, reach * search.tolerance, plane);
  int inliers = 0;
  for (int y = search.top; y < height; ++y) {
    const float* const row = disparity + static_cast<size_t>(y) * width;
    for (int x = 0; x < width; ++x) inliers += std::fabs(plane->at(x, y) - row[x]) <= search.tolerance;
  }
  return inliers;
}

template <class T>
void warp(const T* image, int height, int width, int channels, const Surface& surface, int margin, T lowest, T highest, T* warped,
          const Workers& workers) {
  const int wide = width + 2 * margin;
  const double range = static_cast<double>(highest) - lowest;
  parallel_rows(height, workers.threads, workers.interrupted, [&](int begin, int end, const Cancel& cancel) {
    for (int y = begin; y < end && !cancel.load(std::memory_order_relaxed); ++y) {
      const T* row = image + static_cast<size_t>(y) * width * channels;
      T* out = warped + static_cast<size_t>(y) * wide * channels;
      for (int x = -margin; x < width + margin; ++x, out += channels) {
        // Beyond these bounds all four pixels are the edge's. Positive numbers are truncated, which is quicker than floor.
        const double there = std::min(std::max(x - surface.at(x, y), -2.0), width + 1.0);
        const int whole = static_cast<int>(there + 2) - 2;
        const double t = there - whole;
        const double w0 = t * (t * (2 - t) - 1) * 0.5, w1 = (t * t * (3 * t - 5) + 2) * 0.5;
        const double w2 = t * (t * (4 - 3 * t) + 1) * 0.5, w3 = t * t * (t - 1) * 0.5;
        const auto column = [&](int k) { return row + std::min(std::max(whole + k, 0), width - 1) * channels; };
        const T *p0 = column(-1), *p1 = column(0), *p2 = column(1), *p3 = column(2);
        for (int c = 0; c < channels; ++c) {
          const double value = w0 * p0[c] + w1 * p1[c] + w2 * p2[c] + w3 * p3[c] - lowest;
          out[c] = static_cast<T>(static_cast<int64_t>(std::min(std::max(value, 0.0), range) + 0.5) + lowest);
        }
      }
    }
  });
}
template void warp(const uint8_t*, int, int, int, const Surface&, int, uint8_t, uint8_t, uint8_t*, const Workers&);
template void warp(const int32_t*, int, int, int, const Surface&, int, int32_t, int32_t, int32_t*, const Workers&);

void merge_pass(const Pass& pass, int height, int width, const Hypothesis& best, const Workers& workers) {
  const int wide = width + 2 * pass.margin;
  parallel_rows(height, workers.threads, workers.interrupted, [&](int begin, int end, const Cancel& cancel) {
    for (int y = begin; y < end && !cancel.load(std::memory_order_relaxed); ++y)
      for (int x = 0; x < width; ++x) {
        const size_t from = static_cast<size_t>(y) * wide + pass.margin + x, to = static_cast<size_t>(y) * width + x;
        const float left_over = static_cast<float>(misfit(pass.kind, pass.cost[from]) * pass.handicap);
        if (!(left_over < best.misfit[to])) continue;
        // The warped column that the residual leads to says how far the warp had moved it.
        const double rest = pass.disparity[from], d = rest + pass.surface.at(x - rest, y);
        const bool inside = x - d >= 0 && x - d <= width - 1;
        if (!(d >= pass.least && d <= pass.most && (inside || pass.beyond))) continue;
        best.disparity[to] = static_cast<float>(d);
        best.confidence[to] = inside ? pass.confidence[from] : 0;
        best.misfit[to] = left_over;
        best.cost[to] = pass.cost[from];
        best.flags[to] = inside ? pass.flags[from] : static_cast<uint8_t>(kOutOfView);
        best.plane[to] = pass.number;
      }
  });
}

void merge_window(const Hypothesis& other, CostKind kind, int height, int width, const Hypothesis& best,
                  float* variance, const Workers& workers) {
  parallel_rows(height, workers.threads, workers.interrupted, [&](int begin, int end, const Cancel&) {
    for (size_t at = static_cast<size_t>(begin) * width; at < static_cast<size_t>(end) * width; ++at) {
      if (std::isinf(other.cost[at])) continue;
      // Curvature of the log-likelihood at the winner, from its depth below its neighbours: both bounded away from 0.
      const double depth = std::max(static_cast<double>(other.confidence[at]), 1e-4);
      const double correlation = is_correlation(kind) ? std::max(-static_cast<double>(other.cost[at]), 0.01) : 1;
      const float v = static_cast<float>((1 + correlation) / (2 * correlation) * (1 - depth) / depth);
      if (!(v < variance[at])) continue;
      variance[at] = v;
      best.disparity[at] = other.disparity[at];
      best.confidence[at] = other.confidence[at];
      best.misfit[at] = other.misfit[at];
      best.cost[at] = other.cost[at];
      best.flags[at] = other.flags[at];
      best.plane[at] = other.plane[at];
    }
  });
}

}  // namespace stereopsis
