// One build of the planar filter, for the instruction set that STEREOPSIS_ISA names: plain loops over a block of pixels,
// `static` and unnamed for the reason given in fused_narrow.hpp.
#include "planar.hpp"
#include "simd.hpp"

namespace stereopsis {
namespace STEREOPSIS_ISA {
namespace {

constexpr int N = kPlanarBlock;
// Square pixels added to the samples' spread, so that a slope across a single row or column is 0.
constexpr float kRidge = 0.25f;

struct Moments {
  float n[N], x[N], y[N], xx[N], xy[N], yy[N], z[N], zx[N], zy[N];
};

// Plane through a block of pixels: its value there, and its slopes.
struct Planes {
  float at[N], a[N], b[N];
};

static STEREOPSIS_INLINE void gather(const PlanarRow& row, int first, const Planes& planes, Moments& sums) {
  sums = {};
  for (int v = -row.rows.reach; v <= row.rows.reach; v += row.rows.step)
    for (int u = -row.columns.reach; u <= row.columns.reach; u += row.columns.step) {
      const float* STEREOPSIS_RESTRICT d = row.around + v * row.stride + first + u;
      const float x = static_cast<float>(u), y = static_cast<float>(v), xx = x * x, xy = x * y, yy = y * y;
      for (int i = 0; i < N; ++i) {
        const float z = d[i] - planes.at[i], off = z - (planes.a[i] * x + planes.b[i] * y);
        const bool on = (off < 0 ? -off : off) < row.tolerance;  // NaN is not
        const float one = on ? 1.0f : 0.0f, rise = on ? z : 0.0f;
        sums.n[i] += one;
        sums.x[i] += one * x;
        sums.y[i] += one * y;
        sums.xx[i] += one * xx;
        sums.xy[i] += one * xy;
        sums.yy[i] += one * yy;
        sums.z[i] += rise;
        sums.zx[i] += rise * x;
        sums.zy[i] += rise * y;
      }
    }
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

}  // namespace

extern const PlanarKernel planar;
const PlanarKernel planar = {row};

}  // namespace STEREOPSIS_ISA
}  // namespace stereopsis
