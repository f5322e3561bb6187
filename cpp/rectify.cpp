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

constexpr int kTerms = 4;

// The inverse of a symmetric, positive definite matrix, by Gauss-Jordan elimination.
void invert(double (&m)[kTerms][kTerms], double (&inverse)[kTerms][kTerms]) {
  for (int i = 0; i < kTerms; ++i)
    for (int j = 0; j < kTerms; ++j) inverse[i][j] = i == j;
  for (int k = 0; k < kTerms; ++k) {
    const double pivot = m[k][k];
    for (int j = 0; j < kTerms; ++j) {
      m[k][j] /= pivot;
      inverse[k][j] /= pivot;
    }
    for (int i = 0; i < kTerms; ++i) {
      if (i == k) continue;
      const double factor = m[i][k];
      for (int j = 0; j < kTerms; ++j) {
        m[i][j] -= factor * m[k][j];
        inverse[i][j] -= factor * inverse[k][j];
      }
    }
  }
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

double fit_rows(const double* across, const double* down, const double* rows, int count, double slope, double keystone,
                double settled, double* field) {
  std::vector<double> rest(rows, rows + count);
  field[0] = median(rest);
  field[1] = field[2] = field[3] = 0;
  double scale = 0, inverse[kTerms][kTerms] = {};
  for (int iteration = 0; iteration < 20; ++iteration) {
    const auto residual = [&](int k) {
      return rows[k] - (field[0] + field[1] * across[k] + field[2] * down[k] + field[3] * (across[k] * down[k]));
    };
    for (int k = 0; k < count; ++k) rest[k] = std::fabs(residual(k));
    scale = std::max(1.4826 * median(rest), 0.01);
    double normal[kTerms][kTerms] = {}, right[kTerms] = {};
    normal[1][1] = normal[2][2] = scale * scale / (slope * slope);
    normal[3][3] = scale * scale / (keystone * keystone);
    for (int k = 0; k < count; ++k) {
      const double part = residual(k) / (2 * scale), decay = 1 + part * part, weight = 1 / (decay * decay);
      const double term[kTerms] = {1, across[k], down[k], across[k] * down[k]};
      for (int i = 0; i < kTerms; ++i) {
        for (int j = 0; j < kTerms; ++j) normal[i][j] += weight * term[i] * term[j];
        right[i] += weight * term[i] * rows[k];
      }
    }
    invert(normal, inverse);
    double change = 0;
    for (int i = 0; i < kTerms; ++i) {
      double next = 0;
      for (int j = 0; j < kTerms; ++j) next += inverse[i][j] * right[j];
      change = std::max(change, std::fabs(next - field[i]));
      field[i] = next;
    }
    if (change < settled) break;
  }
  // Weights like these use the points about half as well as least squares would; neighbours err alike.
  // Over the image a coordinate from -1/2 to 1/2 has a mean square of 1/12.
  return 4 * scale * scale * (inverse[0][0] + (inverse[1][1] + inverse[2][2]) / 12 + inverse[3][3] / 144);
}

template <class T>
void move_rows(const T* image, int height, int width, int channels, const TwistedPlane& offset, T lowest, T highest, T* moved,
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
        kernel(rows, start, offset.slope(y), x, low, channels, lowest, range, moved + y * stride);
        x = low;
      }
    }
  });
}
template void move_rows(const uint8_t*, int, int, int, const TwistedPlane&, uint8_t, uint8_t, uint8_t*, const RowKernels&, const Workers&);
template void move_rows(const int32_t*, int, int, int, const TwistedPlane&, int32_t, int32_t, int32_t*, const RowKernels&,
                        const Workers&);

void unbow(float* disparity, int height, int width, const Bow& bow, const Workers& workers) {
  const int64_t pixels = static_cast<int64_t>(height) * width;
  quick_bands(height, pixels, 1 << 19, workers.threads, workers.interrupted, [&](int begin, int end, const Cancel& cancel) {
    for (int y = begin; y < end && !cancel.load(std::memory_order_relaxed); ++y) {
      float* const row = disparity + static_cast<size_t>(y) * width;
      for (int x = 0; x < width; ++x) {
        const float before = row[x];
        const float off = static_cast<float>(x) - bow.middle - (bow.of_right ? 0.0f : before);
        const float after = before + bow.bow * (off * off);
        const float low = before < bow.least ? before : bow.least, high = before > bow.most ? before : bow.most;
        row[x] = after < low ? low : after > high ? high : after;
      }
    }
  });
}

}  // namespace stereopsis
