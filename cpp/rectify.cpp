#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include "parallel.hpp"
#include "rows.hpp"
#include "stages.hpp"

namespace stereopsis {

namespace {

bool inside(const Windows& windows, int x, int y) {
  const int columns = kTrackedColumns / 2, rows = windows.rows / 2;
  return x > columns && x + columns + 1 < windows.width && y > rows && y + rows + 1 < windows.height;
}

// The mean of places (n - 1) / 2 and n / 2 in order; changes the order.
double median(std::vector<double>& values) {
  const auto middle = values.begin() + values.size() / 2;
  std::nth_element(values.begin(), middle, values.end());
  return values.size() % 2 ? *middle : 0.5 * (*std::max_element(values.begin(), middle) + *middle);
}

// The inverse of a symmetric matrix, given as 00, 01, 02, 11, 12, 22.
void invert(const double (&m)[6], double (&inverse)[6]) {
  const double a = m[3] * m[5] - m[4] * m[4], b = m[2] * m[4] - m[1] * m[5], c = m[1] * m[4] - m[2] * m[3];
  const double determinant = m[0] * a + m[1] * b + m[2] * c;
  const double adjoint[] = {a, b, c, m[0] * m[5] - m[2] * m[2], m[1] * m[2] - m[0] * m[4], m[0] * m[3] - m[1] * m[1]};
  for (int k = 0; k < 6; ++k) inverse[k] = adjoint[k] / determinant;
}

}  // namespace

void halve(const uint8_t* image, int height, int width, uint8_t* means, const RowKernels& kernels, const Workers& workers) {
  const int rows = height / 2, columns = width / 2;
  const int64_t pixels = static_cast<int64_t>(rows) * columns;
  quick_bands(rows, pixels, 1 << 19, workers.threads, workers.interrupted, [&](int begin, int end, const Cancel& cancel) {
    for (int y = begin; y < end && !cancel.load(std::memory_order_relaxed); ++y) {
      const uint8_t* const above = image + 2 * static_cast<size_t>(y) * width;
      kernels.halve(above, above + width, columns, means + static_cast<size_t>(y) * columns);
    }
  });
}

void stretch(const int32_t* image, int height, int width, double low, double factor, uint8_t* bytes, const RowKernels& kernels,
             const Workers& workers) {
  const int64_t pixels = static_cast<int64_t>(height) * width;
  quick_rows(height, pixels, 1 << 19, workers.threads, workers.interrupted, [&](int begin, int end, const Cancel& cancel) {
    for (int y = begin; y < end && !cancel.load(std::memory_order_relaxed); ++y) {
      const size_t at = static_cast<size_t>(y) * width;
      kernels.stretch(image + at, width, low, factor, bytes + at);
    }
  });
}

void corners(const uint8_t* image, int height, int width, int tile, int stride, int reach, double least, int32_t* found,
             const RowKernels& kernels, const Workers& workers) {
  const Windows windows{image, image, height, width, 2 * reach + 1};
  const int rows = height / tile, columns = width / tile;
  const int64_t pixels = static_cast<int64_t>(height) * width;
  quick_bands(rows, pixels, 1 << 17, workers.threads, workers.interrupted, [&](int begin, int end, const Cancel& cancel) {
    for (int row = begin; row < end && !cancel.load(std::memory_order_relaxed); ++row)
      for (int column = 0; column < columns; ++column) {
        int32_t* best = found + 2 * (static_cast<size_t>(row) * columns + column);
        best[0] = best[1] = -1;
        double most = least;
        for (int y = row * tile; y < (row + 1) * tile; y += stride)
          for (int x = column * tile; x < (column + 1) * tile; x += stride) {
            if (!inside(windows, x, y)) continue;
            const double score = kernels.cornerness(windows, x, y);
            if (score <= most) continue;
            most = score;
            best[0] = x;
            best[1] = y;
          }
      }
  });
}

void track(const uint8_t* left, const uint8_t* right, int height, int width, const int32_t* points, int count, int reach,
           int iterations, double* motion, double* correlation, const RowKernels& kernels, const Workers& workers) {
  const Windows windows{left, right, height, width, 2 * reach + 1};
  quick_bands(count, count, 1 << 7, workers.threads, workers.interrupted, [&](int begin, int end, const Cancel& cancel) {
    for (int k = begin; k < end && !cancel.load(std::memory_order_relaxed); ++k) {
      correlation[k] = std::numeric_limits<double>::quiet_NaN();
      const int x = points[2 * k], y = points[2 * k + 1];
      if (inside(windows, x, y)) kernels.track(windows, x, y, iterations, motion + 2 * k, correlation + k);
    }
  });
}

double fit_rows(const double* across, const double* down, const double* rows, int count, double slope, double settled,
                double* field) {
  std::vector<double> rest(rows, rows + count);
  field[0] = median(rest);
  field[1] = field[2] = 0;
  double scale = 0, inverse[6] = {};
  for (int iteration = 0; iteration < 20; ++iteration) {
    const auto residual = [&](int k) { return rows[k] - (field[0] + field[1] * across[k] + field[2] * down[k]); };
    for (int k = 0; k < count; ++k) rest[k] = std::fabs(residual(k));
    scale = std::max(1.4826 * median(rest), 0.01);
    const double prior = scale * scale / (slope * slope);
    double normal[6] = {0, 0, 0, prior, 0, prior}, right[3] = {};
    for (int k = 0; k < count; ++k) {
      const double part = residual(k) / (2 * scale), decay = 1 + part * part, weight = 1 / (decay * decay);
      const double x = weight * across[k], y = weight * down[k];
      normal[0] += weight;
      normal[1] += x;
      normal[2] += y;
      normal[3] += x * across[k];
      normal[4] += x * down[k];
      normal[5] += y * down[k];
      right[0] += weight * rows[k];
      right[1] += x * rows[k];
      right[2] += y * rows[k];
    }
    invert(normal, inverse);
    const double next[] = {inverse[0] * right[0] + inverse[1] * right[1] + inverse[2] * right[2],
                           inverse[1] * right[0] + inverse[3] * right[1] + inverse[4] * right[2],
                           inverse[2] * right[0] + inverse[4] * right[1] + inverse[5] * right[2]};
    double change = 0;
    for (int i = 0; i < 3; ++i) {
      change = std::max(change, std::fabs(next[i] - field[i]));
      field[i] = next[i];
    }
    if (change < settled) break;
  }
  // Weights like these use the points about half as well as least squares would; neighbours err alike.
  // Over the image a coordinate from -1/2 to 1/2 has a mean square of 1/12.
  return 4 * scale * scale * (inverse[0] + (inverse[3] + inverse[5]) / 12);
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
  quick_bands(height, pixels, 1 << 17, workers.threads, workers.interrupted, [&](int begin, int end, const Cancel& cancel) {
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
        const auto row = [&](int k) { return image + std::min(std::max(whole + k, 0), height - 1) * stride; };
        const T* const rows[4] = {row(-1), row(0), row(1), row(2)};
        kernel(rows, start, offset.a, x, low, channels, lowest, range, moved + y * stride);
        x = low;
      }
    }
  });
}
template void move_rows(const uint8_t*, int, int, int, const Plane&, uint8_t, uint8_t, uint8_t*, const RowKernels&, const Workers&);
template void move_rows(const int32_t*, int, int, int, const Plane&, int32_t, int32_t, int32_t*, const RowKernels&,
                        const Workers&);

}  // namespace stereopsis
