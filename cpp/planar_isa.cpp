// One build of what is done with planes, for the instruction set that STEREOPSIS_ISA names: plain loops over a block of pixels,
// `static` and unnamed for the reason given in fused_narrow.hpp.
#include "planar.hpp"
#include "simd.hpp"

namespace stereopsis {
namespace STEREOPSIS_ISA {
namespace {

constexpr int N = Simd::lanes;
static_assert(kPlanarBlock % N == 0, "rows can be read a block beyond their end");
// Square pixels added to the samples' spread, so that a slope across a single row or column is 0.
constexpr float kRidge = 0.25f;

struct Moments {
  float n[N], x[N], y[N], xx[N], xy[N], yy[N], z[N], zx[N], zy[N];
};

// Plane through a block of pixels: its value there, and its slopes.
struct Planes {
  float at[N], a[N], b[N];
};

// Sums over the samples near the plane, row by row.
static STEREOPSIS_INLINE void gather(const PlanarRow& row, int first, const Planes& planes, Moments& sums) {
  using F = Simd::F;
  const F zero = Simd::set(0.0f), one = Simd::set(1.0f), limit = Simd::set(row.tolerance * row.tolerance);
  const F at = Simd::load(planes.at), a = Simd::load(planes.a), b = Simd::load(planes.b);
  // Of each column of samples: where it lies, that squared, and how far the plane rises on the way.
  F place[kPlanarColumns], square[kPlanarColumns], climb[kPlanarColumns];
  int columns = 0;
  for (int u = -row.columns.reach; u <= row.columns.reach; u += row.columns.step, ++columns) {
    place[columns] = Simd::set(static_cast<float>(u));
    square[columns] = Simd::mul(place[columns], place[columns]);
    climb[columns] = Simd::mul(a, place[columns]);
  }
  F n = zero, x = zero, y = zero, xx = zero, xy = zero, yy = zero, z = zero, zx = zero, zy = zero;
  for (int v = -row.rows.reach; v <= row.rows.reach; v += row.rows.step) {
    const F down = Simd::set(static_cast<float>(v)), rise = Simd::mul(b, down);
    const float* samples = row.around + v * row.stride + first - row.columns.reach;
    F row_n = zero, row_x = zero, row_xx = zero, row_z = zero, row_zx = zero;
    for (int k = 0; k < columns; ++k, samples += row.columns.step) {
      const F here = Simd::sub(Simd::load(samples), at);
      const F off = Simd::sub(here, Simd::add(climb[k], rise));
      const auto on = Simd::less(Simd::mul(off, off), limit);  // NaN is not
      const auto add = [&](F& sum, F term) { sum = Simd::select(on, Simd::add(sum, term), sum); };
      add(row_n, one);
      add(row_x, place[k]);
      add(row_xx, square[k]);
      add(row_z, here);
      add(row_zx, Simd::mul(here, place[k]));
    }
    n = Simd::add(n, row_n);
    x = Simd::add(x, row_x);
    y = Simd::add(y, Simd::mul(row_n, down));
    xx = Simd::add(xx, row_xx);
    xy = Simd::add(xy, Simd::mul(row_x, down));
    yy = Simd::add(yy, Simd::mul(row_n, Simd::mul(down, down)));
    z = Simd::add(z, row_z);
    zx = Simd::add(zx, row_zx);
    zy = Simd::add(zy, Simd::mul(row_z, down));
  }
  Simd::store(sums.n, n);
  Simd::store(sums.x, x);
  Simd::store(sums.y, y);
  Simd::store(sums.xx, xx);
  Simd::store(sums.xy, xy);
  Simd::store(sums.yy, yy);
  Simd::store(sums.z, z);
  Simd::store(sums.zx, zx);
  Simd::store(sums.zy, zy);
}

static STEREOPSIS_INLINE void fit(const Moments& sums, Planes& planes) {
  for (int i = 0; i < N; ++i) {
    const float n = sums.n[i] < 1 ? 1.0f : sums.n[i];
    const float x = sums.x[i] / n, y = sums.y[i] / n, z = sums.z[i] / n;
    const float xx = sums.xx[i] / n - x * x + kRidge, yy = sums.yy[i] / n - y * y + kRidge, xy = sums.xy[i] / n - x * y;
    const float zx = sums.zx[i] / n - x * z, zy = sums.zy[i] / n - y * z;
    const float det = xx * yy - xy * xy;
    const bool enough = sums.n[i] >= kFewestOnPlane && det > 0;
    const float scale = enough ? 1.0f / det : 0.0f;
    const float a = (zx * yy - zy * xy) * scale, b = (zy * xx - zx * xy) * scale;
    planes.at[i] += enough ? z - (a * x + b * y) : 0.0f;
    planes.a[i] = enough ? a : planes.a[i];
    planes.b[i] = enough ? b : planes.b[i];
  }
}

void row(const PlanarRow& row) {
  for (int first = 0; first < row.width; first += N) {
    Planes planes = {};
    for (int i = 0; i < N; ++i) planes.at[i] = row.start[first + i];
    Moments sums;
    for (int k = 0; k < row.iterations; ++k) {
      gather(row, first, planes, sums);
      fit(sums, planes);
    }
    for (int i = 0; i < N; ++i) row.out[first + i] = planes.at[i];
  }
}

// Each sum waits for itself alone: side by side, they take little longer than one.
void leave(const Points& points, const PlanesTried& planes, double tolerance, double* sums) {
  using D = Simd::D;
  constexpr int lanes = N / 2, vectors = kSideBySide / lanes;
  static_assert(kSideBySide % lanes == 0, "whole vectors");
  D a[vectors], b[vectors], c[vectors], sum[vectors];
  for (int v = 0; v < vectors; ++v) {
    const int from = v * lanes;
    a[v] = Simd::load(planes.a + from), b[v] = Simd::load(planes.b + from), c[v] = Simd::load(planes.c + from);
    sum[v] = Simd::load(sums + from);
  }
  const D most = Simd::set(tolerance);
  for (size_t k = 0; k < points.count; ++k) {
    const D x = Simd::set(points.x[k]), y = Simd::set(points.y[k]), d = Simd::set(points.d[k]);
    for (int v = 0; v < vectors; ++v) {
      const D off = Simd::sub(Simd::add(Simd::mul(a[v], x), Simd::add(Simd::mul(b[v], y), c[v])), d);
      sum[v] = Simd::add(sum[v], Simd::min(Simd::abs(off), most));
    }
  }
  for (int v = 0; v < vectors; ++v) Simd::store(sums + v * lanes, sum[v]);
}

// A vector of the sums at a time, so that all of them stay in registers.
void sum(const Points& points, PlaneSums& sums) {
  using D = Simd::D;
  const D a = Simd::set(sums.a), b = Simd::set(sums.b), c = Simd::set(sums.c), tolerance = Simd::set(sums.tolerance);
  const D middle_x = Simd::set(sums.x), middle_y = Simd::set(sums.y), middle_d = Simd::set(sums.d), one = Simd::set(1.0);
  for (int lane = 0; lane < kSideBySide; lane += N / 2) {
    const D none = Simd::set(0.0);
    D n = none, su = none, sv = none, sw = none, uu = none, uv = none, vv = none, uw = none, vw = none;
    for (size_t k = lane; k < points.count; k += kSideBySide) {
      const D x = Simd::load(points.x + k), y = Simd::load(points.y + k), d = Simd::load(points.d + k);
      const D off = Simd::abs(Simd::sub(Simd::add(Simd::mul(a, x), Simd::add(Simd::mul(b, y), c)), d));
      const auto on = [&](D value) { return Simd::where_at_most(off, tolerance, value); };
      const D u = on(Simd::sub(x, middle_x)), v = on(Simd::sub(y, middle_y)), w = on(Simd::sub(d, middle_d));
      n = Simd::add(n, on(one));
      su = Simd::add(su, u);
      sv = Simd::add(sv, v);
      sw = Simd::add(sw, w);
      uu = Simd::add(uu, Simd::mul(u, u));
      uv = Simd::add(uv, Simd::mul(u, v));
      vv = Simd::add(vv, Simd::mul(v, v));
      uw = Simd::add(uw, Simd::mul(u, w));
      vw = Simd::add(vw, Simd::mul(v, w));
    }
    Simd::store(sums.n + lane, n);
    Simd::store(sums.u + lane, su);
    Simd::store(sums.v + lane, sv);
    Simd::store(sums.w + lane, sw);
    Simd::store(sums.uu + lane, uu);
    Simd::store(sums.uv + lane, uv);
    Simd::store(sums.vv + lane, vv);
    Simd::store(sums.uw + lane, uw);
    Simd::store(sums.vw + lane, vw);
  }
}

}  // namespace

extern const PlanarKernel planar;
const PlanarKernel planar = {row, leave, sum};

}  // namespace STEREOPSIS_ISA
}  // namespace stereopsis
