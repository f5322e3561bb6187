#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include "parallel.hpp"
#include "rows.hpp"
#include "stages.hpp"

namespace stereopsis {

namespace {

// Windows of the usual width are taken by the kernels of rows_isa.cpp; these here are for all others.
constexpr int kWidest = 2 * 127 + 1;
bool usual(const HalfWindow& reach) { return 2 * reach.x + 1 == kUsualColumns && 2 * reach.y + 1 <= kTallestUsual; }

// The smaller eigenvalue of the window's summed products of gradients, gradients being I(+1) - I(-1).
double cornerness(const uint8_t* image, int stride, int x, int y, const HalfWindow& reach) {
  const int columns = 2 * reach.x + 1;
  int64_t xx = 0, xy = 0, yy = 0;
  for (int v = y - reach.y; v <= y + reach.y; ++v) {
    const uint8_t* row = image + static_cast<size_t>(v) * stride + x - reach.x;
    int row_xx = 0, row_xy = 0, row_yy = 0;
    for (int u = 0; u < columns; ++u) {
      const int gx = row[u + 1] - row[u - 1], gy = row[u + stride] - row[u - stride];
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

constexpr double kStill = 0.01;  // pixels: a point that moves less has arrived

// Sums are of columns first, side by side, and then of these.
double total(const float* column, int columns) {
  double sum = 0;
  for (int u = 0; u < columns; ++u) sum += column[u];
  return sum;
}

// What a step needs of a right window w: its variance times its pixels, and its products with the template and the gradients.
struct Products {
  double squares = 0, value = 0, x = 0, y = 0;
};

// A window of the left image about its mean, and its gradients about theirs.
class Template {
 public:
  explicit Template(const HalfWindow& reach)
      : reach_(reach), columns_(2 * reach.x + 1), rows_(2 * reach.y + 1),
        value_(static_cast<size_t>(columns_) * rows_), gx_(value_.size()), gy_(value_.size()) {}
  double squares, x_value, y_value, xx, xy, yy;

  void take(const uint8_t* left, int stride, int x, int y) {
    const int columns = columns_;
    float value[kMost] = {}, gx[kMost] = {}, gy[kMost] = {};
    for (int v = 0; v < rows_; ++v) {
      const uint8_t* at = left + static_cast<size_t>(y - reach_.y + v) * stride + x - reach_.x;
      float *values = &value_[v * columns], *slopes = &gx_[v * columns], *rises = &gy_[v * columns];
      for (int u = 0; u < columns; ++u) {
        values[u] = at[u];
        slopes[u] = 0.5f * static_cast<float>(at[u + 1] - at[u - 1]);
        rises[u] = 0.5f * static_cast<float>(at[u + stride] - at[u - stride]);
      }
      for (int u = 0; u < columns; ++u) value[u] += values[u], gx[u] += slopes[u], gy[u] += rises[u];
    }
    const double pixels = static_cast<double>(columns) * rows_;
    const auto mean = [&](const float* sums) { return static_cast<float>(total(sums, columns) / pixels); };
    mean_ = mean(value);
    const float mean_x = mean(gx), mean_y = mean(gy);
    float sums[6][kMost] = {};
    for (int v = 0; v < rows_; ++v) {
      float *values = &value_[v * columns], *slopes = &gx_[v * columns], *rises = &gy_[v * columns];
      for (int u = 0; u < columns; ++u) {
        const float t = values[u] -= mean_, a = slopes[u] -= mean_x, b = rises[u] -= mean_y;
        sums[0][u] += t * t;
        sums[1][u] += a * t;
        sums[2][u] += b * t;
        sums[3][u] += a * a;
        sums[4][u] += a * b;
        sums[5][u] += b * b;
      }
    }
    double* const totals[] = {&squares, &x_value, &y_value, &xx, &xy, &yy};
    for (int k = 0; k < 6; ++k) *totals[k] = total(sums[k], columns);
  }

  // The right window at (x, y), straight lines between pixels; false where it leaves the image.
  bool compare(const uint8_t* right, int height, int width, double x, double y, Products* found) const {
    if (!(x >= reach_.x && x <= width - 1 - reach_.x && y >= reach_.y && y <= height - 1 - reach_.y)) return false;
    const int columns = columns_;
    const int left = std::min(static_cast<int>(x), width - 2 - reach_.x);
    const int top = std::min(static_cast<int>(y), height - 2 - reach_.y);
    const float s = static_cast<float>(x - left), t = static_cast<float>(y - top), mean = mean_;
    const float w00 = (1 - s) * (1 - t), w01 = s * (1 - t), w10 = (1 - s) * t, w11 = s * t;
    float sum[kMost] = {}, squares_of[kMost] = {}, by_value[kMost] = {}, by_x[kMost] = {}, by_y[kMost] = {};
    for (int v = 0; v < rows_; ++v) {
      const uint8_t* upper = right + static_cast<size_t>(top - reach_.y + v) * width + left - reach_.x;
      const uint8_t* lower = upper + width;
      const float *value = &value_[v * columns], *gx = &gx_[v * columns], *gy = &gy_[v * columns];
      for (int u = 0; u < columns; ++u) {
        const float w = (w00 * upper[u] + w01 * upper[u + 1]) + (w10 * lower[u] + w11 * lower[u + 1]) - mean;
        sum[u] += w;
        squares_of[u] += w * w;
        by_value[u] += w * value[u];
        by_x[u] += w * gx[u];
        by_y[u] += w * gy[u];
      }
    }
    const double all = total(sum, columns);
    *found = {total(squares_of, columns) - all * all / (static_cast<double>(columns) * rows_),
              total(by_value, columns), total(by_x, columns), total(by_y, columns)};
    return true;
  }

 private:
  static constexpr int kMost = kWidest;
  const HalfWindow reach_;
  const int columns_, rows_;
  float mean_ = 0;
  std::vector<float> value_, gx_, gy_;
};

}  // namespace

void halve(const uint8_t* image, int height, int width, uint8_t* means, const RowKernels& kernels, const Workers& workers) {
  const int rows = height / 2, columns = width / 2;
  const int64_t pixels = static_cast<int64_t>(rows) * columns;
  quick_rows(rows, pixels, 1 << 19, workers.threads, workers.interrupted, [&](int begin, int end, const Cancel& cancel) {
    for (int y = begin; y < end && !cancel.load(std::memory_order_relaxed); ++y) {
      const uint8_t* const above = image + 2 * static_cast<size_t>(y) * width;
      kernels.halve(above, above + width, columns, means + static_cast<size_t>(y) * columns);
    }
  });
}

void corners(const uint8_t* image, int height, int width, int tile, int stride, const HalfWindow& reach, double least, int32_t* found,
             const RowKernels& kernels, const Workers& workers) {
  const Windows windows{image, image, height, width, 2 * reach.y + 1};
  const bool as_usual = usual(reach);
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
            const double score = as_usual ? kernels.cornerness(windows, x, y) : cornerness(image, width, x, y, reach);
            if (score <= most) continue;
            most = score;
            best[0] = x;
            best[1] = y;
          }
      }
  });
}

void track(const uint8_t* left, const uint8_t* right, int height, int width, const int32_t* points, int count,
           const HalfWindow& reach, int iterations, double* motion, double* correlation, const RowKernels& kernels,
           const Workers& workers) {
  const Windows windows{left, right, height, width, 2 * reach.y + 1};
  const bool as_usual = usual(reach);
  parallel_rows(count, workers.threads, workers.interrupted, [&](int begin, int end, const Cancel& cancel) {
    Template mine(reach);
    for (int k = begin; k < end && !cancel.load(std::memory_order_relaxed); ++k) {
      const int x = points[2 * k], y = points[2 * k + 1];
      double u = motion[2 * k], v = motion[2 * k + 1];
      correlation[k] = std::numeric_limits<double>::quiet_NaN();
      if (x <= reach.x || x + reach.x + 1 >= width || y <= reach.y || y + reach.y + 1 >= height) continue;
      if (as_usual) {
        kernels.track(windows, x, y, iterations, motion + 2 * k, correlation + k);
        continue;
      }
      mine.take(left, width, x, y);
      const double determinant = mine.xx * mine.yy - mine.xy * mine.xy;
      if (!(determinant > 1e-9 * mine.xx * mine.yy)) continue;
      double moved = 1;
      for (int step = 0; step <= iterations; ++step) {
        Products seen;
        if (!mine.compare(right, height, width, x + u, y + v, &seen) || !(seen.squares > 0)) break;
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

template <class T>
void move_rows(const T* image, int height, int width, int channels, const Plane& offset, T lowest, T highest, T* moved,
               const RowKernels& kernels, const Workers& workers) {
  const float range = static_cast<float>(static_cast<double>(highest) - lowest);
  const auto kernel = [&] {
    if constexpr (sizeof(T) == 1)
      return kernels.between_bytes;
    else
      return kernels.between_words;
  }();
  const int64_t stride = static_cast<int64_t>(width) * channels;
  const int64_t pixels = height * stride;
  quick_rows(height, pixels, 1 << 18, workers.threads, workers.interrupted, [&](int begin, int end, const Cancel& cancel) {
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
        kernel(rows, part.data(), x, low, channels, lowest, range, moved + y * stride);
        x = low;
      }
    }
  });
}
template void move_rows(const uint8_t*, int, int, int, const Plane&, uint8_t, uint8_t, uint8_t*, const RowKernels&, const Workers&);
template void move_rows(const int32_t*, int, int, int, const Plane&, int32_t, int32_t, int32_t*, const RowKernels&,
                        const Workers&);

}  // namespace stereopsis
