// One build of the loops over rows, for the instruction set that STEREOPSIS_ISA names: plain loops, `static` and unnamed for
// the reason given in fused_narrow.hpp. Every float operation is a single one in a fixed order, so that all give the same bits.
#include "rows.hpp"

#include <cmath>
#include <cstring>
#include <limits>

#include "simd.hpp"

namespace stereopsis {
namespace STEREOPSIS_ISA {
namespace {

// By minima and maxima alone, which vectorise: in order, what has no value coming last, the median is the mean of places
// (n - 1) / 2 and n / 2.
static void median_of_nine(const float* STEREOPSIS_RESTRICT above, const float* STEREOPSIS_RESTRICT here,
                           const float* STEREOPSIS_RESTRICT below, int width, float* STEREOPSIS_RESTRICT filtered) {
  constexpr float last = std::numeric_limits<float>::infinity();
  for (int x = 0; x < width; ++x) {
    float v[9] = {above[x], above[x + 1], above[x + 2], here[x], here[x + 1], here[x + 2], below[x], below[x + 1], below[x + 2]};
    float n = 0;
    for (float& value : v) {
      n += value == value ? 1.0f : 0.0f;
      value = value == value ? value : last;
    }
    const auto order = [&](int i, int k) STEREOPSIS_INLINE_LAMBDA {
      const float a = v[i], b = v[k];
      v[i] = a < b ? a : b;
      v[k] = a < b ? b : a;
    };
    // Floyd's network, whose 25 exchanges sort nine.
    order(0, 1), order(3, 4), order(6, 7), order(1, 2), order(4, 5), order(7, 8), order(0, 1), order(3, 4), order(6, 7);
    order(0, 3), order(3, 6), order(0, 3), order(1, 4), order(4, 7), order(1, 4), order(2, 5), order(5, 8), order(2, 5);
    order(1, 3), order(5, 7), order(2, 6), order(4, 6), order(2, 4), order(2, 3), order(5, 6);
    float lower = v[4], upper = v[4];
    for (int k = 3; k >= 0; --k) {
      lower = n < static_cast<float>(2 * k + 3) ? v[k] : lower;
      upper = n < static_cast<float>(2 * k + 2) ? v[k] : upper;
    }
    const float middle = here[x + 1], median = lower == upper ? lower : 0.5f * (lower + upper);
    filtered[x] = middle == middle ? median : middle;
  }
}

// Of kRowRoom pairs the lower and the higher ones.
static STEREOPSIS_INLINE void order(float* STEREOPSIS_RESTRICT low, float* STEREOPSIS_RESTRICT high) {
  for (int u = 0; u < kRowRoom; ++u) {
    const float a = low[u], b = high[u];
    low[u] = a < b ? a : b;
    high[u] = a < b ? b : a;
  }
}

// What has no value stands below all and above all in turn; how many there are of these.
static STEREOPSIS_INLINE int take(const float* STEREOPSIS_RESTRICT from, float* STEREOPSIS_RESTRICT turn, float* STEREOPSIS_RESTRICT to) {
  int holes = 0;
  for (int u = 0; u < kRowRoom; ++u) {
    const float value = from[u], end = turn[u];
    to[u] = value == value ? value : end;
    turn[u] = value == value ? end : -end;
    holes += value == value ? 0 : 1;
  }
  return holes;
}

// The median of 25: of 14 the least and the greatest cannot be it, nor of the 13 that the next one makes of the others, and so on.
static void median_of_25(const float* const* rows, int width, float* STEREOPSIS_RESTRICT filtered) {
  constexpr float far = std::numeric_limits<float>::infinity();
  constexpr int wide = kRowRoom, all = 25, kept = 14;
  for (int x = 0; x < width; x += wide) {
    float median[2][wide];
    int holes = 0;
    for (int side = 0; side < 2; ++side) {
      // Of an odd number of holes the last one stands once below, once above: the two middle ones of what there is.
      float value[kept][wide], turn[wide];
      for (int u = 0; u < wide; ++u) turn[u] = side ? far : -far;
      for (int k = 0; k < kept; ++k) holes += take(rows[k / 5] + x + k % 5, turn, value[k]);
      for (int m = kept, next = kept;; --m) {
        for (int i = 0; i < m / 2; ++i) order(value[i], value[m - 1 - i]);
        for (int i = 1; i <= (m - 1) / 2; ++i) order(value[0], value[i]);
        for (int i = m / 2; i < m - 1; ++i) order(value[i], value[m - 1]);
        if (next == all) break;
        holes += take(rows[next / 5] + x + next % 5, turn, value[0]);
        ++next;
      }
      for (int u = 0; u < wide; ++u) median[side][u] = value[1][u];
      if (holes == 0) {
        for (int u = 0; u < wide; ++u) median[1][u] = value[1][u];
        break;
      }
    }
    const float* const here = rows[2] + x + 2;
    const int here_wide = width - x < wide ? width - x : wide;
    for (int u = 0; u < here_wide; ++u) {
      const float lower = median[0][u], upper = median[1][u], both = lower == upper ? lower : 0.5f * (lower + upper);
      filtered[x + u] = here[u] == here[u] ? both : here[u];
    }
  }
}

// ---- windows of the usual width: kWide columns side by side, of which the last few count for nothing ---------------------

constexpr int kWide = 16;
constexpr double kStill = 0.01;  // pixels: a point that moves less has arrived

// So many bytes of an image from a place on; beyond its end, nothing.
struct Bytes {
  const uint8_t* at;
  uint8_t copy[kWide + 1];

  // `room` says whether all of them are inside the image.
  STEREOPSIS_INLINE Bytes(const uint8_t* from, const uint8_t* end, bool room) : at(from) {
    if (room) return;
    const ptrdiff_t left = end - from;
    for (int u = 0; u <= kWide; ++u) copy[u] = u < left ? from[u] : 0;
    at = copy;
  }
};

template <class T>
static STEREOPSIS_INLINE double total(const T* column) {
  double sum = 0;
  for (int u = 0; u < kUsualColumns; ++u) sum += static_cast<double>(column[u]);
  return sum;
}

static double cornerness(const Windows& windows, int x, int y) {
  const int stride = windows.width, reach = kUsualColumns / 2, above = windows.rows / 2;
  const uint8_t* const end = windows.left + static_cast<size_t>(windows.height) * stride;
  int32_t xx[kWide] = {}, xy[kWide] = {}, yy[kWide] = {};
  for (int v = y - above; v <= y + above; ++v) {
    const uint8_t* const row = windows.left + static_cast<size_t>(v) * stride + x - reach;
    const bool room = end - (row + stride) > kWide;
    const Bytes before(row - 1, end, room), after(row + 1, end, room), higher(row - stride, end, room), lower(row + stride, end, room);
    for (int u = 0; u < kWide; ++u) {
      const int32_t gx = after.at[u] - before.at[u], gy = lower.at[u] - higher.at[u];
      xx[u] += gx * gx;
      xy[u] += gx * gy;
      yy[u] += gy * gy;
    }
  }
  // Whole numbers below 2^53: exact in any order.
  const double sum_xx = total(xx), sum_xy = total(xy), sum_yy = total(yy), half = 0.5 * (sum_xx - sum_yy);
  return 0.5 * (sum_xx + sum_yy) - std::sqrt(half * half + sum_xy * sum_xy);
}

// What a step needs of a right window w: its variance times its pixels, and its products with the template and the gradients.
struct Products {
  double squares, value, x, y;
};

// A window of the left image about its mean, and its gradients about theirs.
struct Template {
  int rows;
  float mean;
  double squares, x_value, y_value, xx, xy, yy;
  float value[kTallestUsual][kWide], gx[kTallestUsual][kWide], gy[kTallestUsual][kWide];
};

static void take(const Windows& windows, int x, int y, Template& mine) {
  const int stride = windows.width, reach = kUsualColumns / 2;
  const uint8_t* const end = windows.left + static_cast<size_t>(windows.height) * stride;
  float value[kWide] = {}, gx[kWide] = {}, gy[kWide] = {};
  mine.rows = windows.rows;
  for (int v = 0; v < mine.rows; ++v) {
    const uint8_t* const at = windows.left + static_cast<size_t>(y - mine.rows / 2 + v) * stride + x - reach;
    const bool room = end - (at + stride) > kWide;
    const Bytes here(at, end, room), before(at - 1, end, room), after(at + 1, end, room);
    const Bytes higher(at - stride, end, room), lower(at + stride, end, room);
    for (int u = 0; u < kWide; ++u) {
      const float t = here.at[u];
      const float a = 0.5f * static_cast<float>(after.at[u] - before.at[u]);
      const float b = 0.5f * static_cast<float>(lower.at[u] - higher.at[u]);
      mine.value[v][u] = t;
      mine.gx[v][u] = a;
      mine.gy[v][u] = b;
      value[u] += t;
      gx[u] += a;
      gy[u] += b;
    }
  }
  const double pixels = static_cast<double>(kUsualColumns) * mine.rows;
  mine.mean = static_cast<float>(total(value) / pixels);
  const float mean = mine.mean, mean_x = static_cast<float>(total(gx) / pixels), mean_y = static_cast<float>(total(gy) / pixels);
  float sums[6][kWide] = {};
  for (int v = 0; v < mine.rows; ++v)
    for (int u = 0; u < kWide; ++u) {
      const float t = mine.value[v][u] -= mean, a = mine.gx[v][u] -= mean_x, b = mine.gy[v][u] -= mean_y;
      sums[0][u] += t * t;
      sums[1][u] += a * t;
      sums[2][u] += b * t;
      sums[3][u] += a * a;
      sums[4][u] += a * b;
      sums[5][u] += b * b;
    }
  mine.squares = total(sums[0]);
  mine.x_value = total(sums[1]);
  mine.y_value = total(sums[2]);
  mine.xx = total(sums[3]);
  mine.xy = total(sums[4]);
  mine.yy = total(sums[5]);
}

// The right window at (x, y), straight lines between pixels; false where it leaves the image.
static bool compare(const Windows& windows, const Template& mine, double x, double y, Products& found) {
  const int reach = kUsualColumns / 2, above = mine.rows / 2, width = windows.width, height = windows.height;
  if (!(x >= reach && x <= width - 1 - reach && y >= above && y <= height - 1 - above)) return false;
  const int last_left = width - 2 - reach, last_top = height - 2 - above;
  const int left = static_cast<int>(x) < last_left ? static_cast<int>(x) : last_left;
  const int top = static_cast<int>(y) < last_top ? static_cast<int>(y) : last_top;
  const float s = static_cast<float>(x - left), t = static_cast<float>(y - top), mean = mine.mean;
  const float w00 = (1 - s) * (1 - t), w01 = s * (1 - t), w10 = (1 - s) * t, w11 = s * t;
  const uint8_t* const end = windows.right + static_cast<size_t>(height) * width;
  float sum[kWide] = {}, squares[kWide] = {}, by_value[kWide] = {}, by_x[kWide] = {}, by_y[kWide] = {};
  for (int v = 0; v < mine.rows; ++v) {
    const uint8_t* const row = windows.right + static_cast<size_t>(top - above + v) * width + left - reach;
    const bool room = end - (row + width) > kWide;
    const Bytes upper(row, end, room), lower(row + width, end, room);
    for (int u = 0; u < kWide; ++u) {
      const float w = (w00 * static_cast<float>(upper.at[u]) + w01 * static_cast<float>(upper.at[u + 1])) +
                      (w10 * static_cast<float>(lower.at[u]) + w11 * static_cast<float>(lower.at[u + 1])) - mean;
      sum[u] += w;
      squares[u] += w * w;
      by_value[u] += w * mine.value[v][u];
      by_x[u] += w * mine.gx[v][u];
      by_y[u] += w * mine.gy[v][u];
    }
  }
  const double all = total(sum);
  found = {total(squares) - all * all / (static_cast<double>(kUsualColumns) * mine.rows), total(by_value), total(by_x),
           total(by_y)};
  return true;
}

static STEREOPSIS_INLINE double at_most_one(double step) {
  const double least = step < -1.0 ? -1.0 : step;
  return least > 1.0 ? 1.0 : least;
}

static void track(const Windows& windows, int x, int y, int iterations, double* motion, double* correlation) {
  Template mine;
  take(windows, x, y, mine);
  const double determinant = mine.xx * mine.yy - mine.xy * mine.xy;
  if (!(determinant > 1e-9 * mine.xx * mine.yy)) return;
  double u = motion[0], v = motion[1], moved = 1;
  for (int step = 0; step <= iterations; ++step) {
    Products seen;
    if (!compare(windows, mine, x + u, y + v, seen) || !(seen.squares > 0)) break;
    if (step == iterations || moved < kStill) {
      *correlation = seen.value / std::sqrt(seen.squares * mine.squares);
      break;
    }
    const double gain = seen.value / seen.squares, ex = mine.x_value - gain * seen.x, ey = mine.y_value - gain * seen.y;
    const double du = at_most_one((mine.yy * ex - mine.xy * ey) / determinant);
    const double dv = at_most_one((mine.xx * ey - mine.xy * ex) / determinant);
    moved = std::fabs(du) < std::fabs(dv) ? std::fabs(dv) : std::fabs(du);
    u += du;
    v += dv;
  }
  motion[0] = u;
  motion[1] = v;
}

}  // namespace

extern const RowKernels rows;
const RowKernels rows = {median_of_nine, median_of_25, cornerness, track};

}  // namespace STEREOPSIS_ISA
}  // namespace stereopsis
