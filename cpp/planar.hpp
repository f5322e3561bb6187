// Planes through disparities: a map drawn to those that its pixels' surroundings lie on, and points held against planes on trial.
#pragma once

#include <cstddef>
#include <string>

namespace stereopsis {

// Samples of a window, at most.
constexpr int kPlanarColumns = 9, kPlanarRows = 7;

// Where a pixel's surroundings are looked at: columns and rows -reach, ..., -step, 0, step, ..., reach from it.
struct Samples {
  int reach, step;
};

// One row. `around` is a map with a margin of NaN, `stride` from row to row, at the row's first pixel; it can be read for
// kPlanarBlock pixels more than there are, as `start` can, and `out` written.
struct PlanarRow {
  const float* around;
  ptrdiff_t stride;
  int width;
  Samples columns, rows;
  float tolerance;
  int iterations;
  const float* start;
  float* out;
};
constexpr int kPlanarBlock = 16;
// With fewer samples on the plane than this a pixel stays as it is.
constexpr int kFewestOnPlane = 6;

// Planes a x + (b y + c) that are held against a map side by side.
constexpr int kSideBySide = 8;
struct PlanesTried {
  double a[kSideBySide], b[kSideBySide], c[kSideBySide];
};
// Places and the disparities there.
struct Points {
  const double *x, *y, *d;
  size_t count;
};
// What least squares sum of the points within `tolerance` of a plane, about a middle: 1, u, v, w and their products uu, uv, vv,
// uw, vw. Each sum is one of kSideBySide, the k-th point's being k % kSideBySide.
struct PlaneSums {
  double a, b, c, tolerance, x, y, d;
  double n[kSideBySide], u[kSideBySide], v[kSideBySide], w[kSideBySide];
  double uu[kSideBySide], uv[kSideBySide], vv[kSideBySide], uw[kSideBySide], vw[kSideBySide];
};

struct PlanarKernel {
  void (*row)(const PlanarRow&);
  // Adds to each plane's sum how far the points lie off it, each `tolerance` at most.
  void (*leave)(const Points& points, const PlanesTried& planes, double tolerance, double* sums);
  // Of a number of points that kSideBySide divides.
  void (*sum)(const Points& points, PlaneSums& sums);
};
// The build that goes with the named instruction set, or with the best one for an empty name.
const PlanarKernel& choose_planar(const std::string& name);

}  // namespace stereopsis
