#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include "parallel.hpp"
#include "stages.hpp"

namespace stereopsis {

namespace {

// The smaller eigenvalue of the window's summed products of gradients, gradients being I(+1) - I(-1).
double cornerness(const uint8_t* image, int width, int x, int y, const HalfWindow& reach) {
  int64_t xx = 0, xy = 0, yy = 0;
  for (int v = y - reach.y; v <= y + reach.y; ++v) {
    const uint8_t* row = image + static_cast<size_t>(v) * width;
    int row_xx = 0, row_xy = 0, row_yy = 0;
    for (int u = x - reach.x; u <= x + reach.x; ++u) {
      const int gx = row[u + 1] - row[u - 1], gy = row[u + width] - row[u - width];
      row_xx += gx * gx;
      row_xy += gx * gy;
      row_yy += gy * gy;
    }
    xx += row_xx;
    xy += row_xy;
    yy += row_yy;
  }
  const double half = 0.5 * static_cast<double>(xx - yy), mixed = static_cast<double>(xy);
  return 0.5 * static_cast<double>(xx + yy) - std::sqrt(half * half + mixed * mixed);
}

constexpr int kWidest = 2 * 127 + 1;
constexpr double kStill = 0.01;  // pixels: a point that moves less has arrived

// A window of the left image about its mean, and its gradients about theirs.
struct Template {
  int width, height;
  float mean = 0;
  std::vector<float> value, gx, gy;
  double squares = 0, x_value = 0, y_value = 0, xx = 0, xy = 0, yy = 0;

  Template(const uint8_t* left, int stride, int x, int y, const HalfWindow& reach)
      : width(2 * reach.x + 1), height(2 * reach.y + 1) {
    const int n = width * height;
    for (auto* side : {&value, &gx, &gy}) side->resize(n);
    int k = 0;
    for (int v = y - reach.y; v <= y + reach.y; ++v)
      for (int u = x - reach.x; u <= x + reach.x; ++u, ++k) {
        const uint8_t* at = left + static_cast<size_t>(v) * stride + u;
        value[k] = at[0];
        gx[k] = 0.5f * static_cast<float>(at[1] - at[-1]);
        gy[k] = 0.5f * static_cast<float>(at[stride] - at[-stride]);
      }
    mean = centred(&value);
    centred(&gx);
    centred(&gy);
    for (k = 0; k < n; ++k) {
      const double t = value[k], a = gx[k], b = gy[k];
      squares += t * t;
      x_value += a * t;
      y_value += b * t;
      xx += a * a;
      xy += a * b;
      yy += b * b;
    }
  }

 private:
  static float centred(std::vector<float>* side) {
    double sum = 0;
    for (const float one : *side) sum += one;
    const float mean = static_cast<float>(sum / static_cast<double>(side->size()));
    for (float& one : *side) one -= mean;
    return mean;
  }
};

// What a step needs of a right window w: its variance times its pixels, and its products with the template and the gradients.
struct Products {
  double squares = 0, value = 0, x = 0, y = 0;
};

// The right window at (x, y), straight lines between pixels; false where it leaves the image.
bool compare(const Template& mine, const uint8_t* right, int height, int width, double x, double y, Products* found) {
  const int reach_x = mine.width / 2, reach_y = mine.height / 2;
  if (!(x >= reach_x && x <= width - 1 - reach_x && y >= reach_y && y <= height - 1 - reach_y)) return false;
  const int left = std::min(static_cast<int>(x), width - 2 - reach_x), top = std::min(static_cast<int>(y), height - 2 - reach_y);
  const float s = static_cast<float>(x - left), t = static_cast<float>(y - top), mean = mine.mean;
  const float w00 = (1 - s) * (1 - t), w01 = s * (1 - t), w10 = (1 - s) * t, w11 = s * t;
  // A sum for each column, so that columns are added side by side.
  float sum[kWidest] = {}, squares[kWidest] = {}, by_value[kWidest] = {}, by_x[kWidest] = {}, by_y[kWidest] = {};
  for (int v = 0; v < mine.height; ++v) {
    const uint8_t* upper = right + static_cast<size_t>(top - reach_y + v) * width + left - reach_x;
    const uint8_t* lower = upper + width;
    const size_t row = static_cast<size_t>(v) * mine.width;
    const float *value = &mine.value[row], *gx = &mine.gx[row], *gy = &mine.gy[row];
    for (int u = 0; u < mine.width; ++u) {
      const float w = (w00 * upper[u] + w01 * upper[u + 1]) + (w10 * lower[u] + w11 * lower[u + 1]) - mean;
      sum[u] += w;
      squares[u] += w * w;
      by_value[u] += w * value[u];
      by_x[u] += w * gx[u];
      by_y[u] += w * gy[u];
    }
  }
  double total = 0;
  *found = {};
  for (int u = 0; u < mine.width; ++u) {
    total += sum[u];
    found->squares += squares[u];
    found->value += by_value[u];
    found->x += by_x[u];
    found->y += by_y[u];
  }
  found->squares -= total * total / (mine.width * mine.height);
  return true;
}

}  // namespace

void corners(const uint8_t* image, int height, int width, int tile, int stride, const HalfWindow& reach, double least, int32_t* found,
             const Workers& workers) {
  const int rows = height / tile, columns = width / tile;
  parallel_rows(rows, workers.threads, workers.interrupted, [&](int begin, int end, const Cancel& cancel) {
    for (int row = begin; row < end && !cancel.load(std::memory_order_relaxed); ++row)
      for (int column = 0; column < columns; ++column) {
        int32_t* best = found + 2 * (static_cast<size_t>(row) * columns + column);
        best[0] = best[1] = -1;
        double most = least;
        for (int y = row * tile; y < (row + 1) * tile; y += stride)
          for (int x = column * tile; x < (column + 1) * tile; x += stride) {
            if (x <= reach.x || x + reach.x + 1 >= width || y <= reach.y || y + reach.y + 1 >= height) continue;
            const double score = cornerness(image, width, x, y, reach);
            if (score <= most) continue;
            most = score;
            best[0] = x;
            best[1] = y;
          }
      }
  });
}

void track(const uint8_t* left, const uint8_t* right, int height, int width, const int32_t* points, int count,
           const HalfWindow& reach, int iterations, double* motion, double* correlation, const Workers& workers) {
  parallel_rows(count, workers.threads, workers.interrupted, [&](int begin, int end, const Cancel& cancel) {
    for (int k = begin; k < end && !cancel.load(std::memory_order_relaxed); ++k) {
      const int x = points[2 * k], y = points[2 * k + 1];
      double u = motion[2 * k], v = motion[2 * k + 1];
      correlation[k] = std::numeric_limits<double>::quiet_NaN();
      if (x <= reach.x || x + reach.x + 1 >= width || y <= reach.y || y + reach.y + 1 >= height) continue;
      const Template mine(left, width, x, y, reach);
      const double determinant = mine.xx * mine.yy - mine.xy * mine.xy;
      if (!(determinant > 1e-9 * mine.xx * mine.yy)) continue;
      double moved = 1;
      for (int step = 0; step <= iterations; ++step) {
        Products seen;
        if (!compare(mine, right, height, width, x + u, y + v, &seen) || !(seen.squares > 0)) break;
        if (step == iterations || moved < kStill) {
          correlation[k] = seen.value / std::sqrt(seen.squares * mine.squares);
          break;
        }
        const double gain = seen.value / seen.squares, ex = mine.x_value - gain * seen.x, ey = mine.y_value - gain * seen.y;
        const double du = std::min(std::max((mine.yy * ex - mine.xy * ey) / determinant, -1.0), 1.0);
        const double dv = std::min(std::max((mine.xx * ey - mine.xy * ex) / determinant, -1.0), 1.0);
        moved = std::max(std::fabs(du), std::fabs(dv));
        u += du;
        v += dv;
      }
      motion[2 * k] = u;
      motion[2 * k + 1] = v;
    }
  });
}

namespace {

// Columns [begin, end) of a row, `part` of the way from row p1 to row p2, which differs from column to column.
template <int C, class T>
void between(const T* const (&rows)[4], const float* part, int begin, int end, T lowest, float range, T* out) {
  const T *p0 = rows[0], *p1 = rows[1], *p2 = rows[2], *p3 = rows[3];
  for (int x = begin; x < end; ++x) {
    const float t = std::min(std::max(part[x], 0.0f), 1.0f);
    const float w0 = t * (t * (2 - t) - 1) * 0.5f, w1 = (t * t * (3 * t - 5) + 2) * 0.5f;
    const float w2 = t * (t * (4 - 3 * t) + 1) * 0.5f, w3 = t * t * (t - 1) * 0.5f;
    for (int i = x * C; i < (x + 1) * C; ++i) {
      // Counted from the lowest value, pixels of up to 24 bits are exact as floats.
      const float a = static_cast<float>(p0[i] - lowest), b = static_cast<float>(p1[i] - lowest);
      const float c = static_cast<float>(p2[i] - lowest), d = static_cast<float>(p3[i] - lowest);
      const float value = w0 * a + w1 * b + w2 * c + w3 * d;
      out[i] = static_cast<T>(static_cast<int32_t>(std::min(std::max(value, 0.0f), range) + 0.5f) + lowest);
    }
  }
}

}  // namespace

template <class T>
void move_rows(const T* image, int height, int width, int channels, const Plane& offset, T lowest, T highest, T* moved,
               const Workers& workers) {
  const float range = static_cast<float>(static_cast<double>(highest) - lowest);
  const auto kernel = channels == 1 ? &between<1, T> : &between<3, T>;
  const int64_t stride = static_cast<int64_t>(width) * channels;
  parallel_rows(height, workers.threads, workers.interrupted, [&](int begin, int end, const Cancel& cancel) {
    std::vector<float> part(width);
    for (int y = begin; y < end && !cancel.load(std::memory_order_relaxed); ++y) {
      // Two rows beyond the image every row that is read is the edge's.
      const auto whole_row = [&](int x) {
        return static_cast<int>(std::floor(std::min(std::max(y + offset.at(x, y), -2.0), height + 1.0)));
      };
      // The offset rises or falls along the row, so columns whose place has the same whole row lie side by side.
      for (int x = 0; x < width;) {
        const int whole = whole_row(x);
        int low = x + 1, high = width;  // the first column of another row is here
        while (low < high) {
          const int middle = low + (high - low) / 2;
          if (whole_row(middle) == whole)
            low = middle + 1;
          else
            high = middle;
        }
        const double start = y + offset.at(0, y) - whole;
        for (int u = x; u < low; ++u) part[u] = static_cast<float>(start + offset.a * u);
        const auto row = [&](int k) { return image + std::min(std::max(whole + k, 0), height - 1) * stride; };
        const T* const rows[4] = {row(-1), row(0), row(1), row(2)};
        kernel(rows, part.data(), x, low, lowest, range, moved + y * stride);
        x = low;
      }
    }
  });
}
template void move_rows(const uint8_t*, int, int, int, const Plane&, uint8_t, uint8_t, uint8_t*, const Workers&);
template void move_rows(const int32_t*, int, int, int, const Plane&, int32_t, int32_t, int32_t*, const Workers&);

}  // namespace stereopsis
