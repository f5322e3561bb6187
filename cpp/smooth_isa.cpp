// One build of edge-aware smoothing along lines, for the instruction set that STEREOPSIS_ISA names; `static` and unnamed for the
// reason given in fused_narrow.hpp.
#include "simd.hpp"
#include "smooth.hpp"

namespace stereopsis {
namespace STEREOPSIS_ISA {
namespace {

static int length_of(const Strip& strip) { return strip.rows ? strip.width : strip.height; }
static int lines_of(const Strip& strip) {
  const int left = (strip.rows ? strip.height : strip.width) - strip.first;
  return left < kLines ? left : kLines;
}

// The strip's lines side by side, sample by sample; beyond the last line, it once more.
static void load(const Strip& strip, const float* STEREOPSIS_RESTRICT plane, float* STEREOPSIS_RESTRICT samples) {
  const int n = length_of(strip), m = lines_of(strip);
  if (strip.rows) {
    const float* lines[kLines];
    for (int k = 0; k < kLines; ++k) lines[k] = plane + static_cast<size_t>(strip.first + (k < m ? k : m - 1)) * strip.width;
    for (int i = 0; i < n; ++i)
      for (int k = 0; k < kLines; ++k) samples[i * kLines + k] = lines[k][i];
    return;
  }
  for (int i = 0; i < n; ++i) {
    const float* STEREOPSIS_RESTRICT line = plane + static_cast<size_t>(i) * strip.width + strip.first;
    if (m == kLines)
      for (int k = 0; k < kLines; ++k) samples[i * kLines + k] = line[k];
    else
      for (int k = 0; k < kLines; ++k) samples[i * kLines + k] = line[k < m ? k : m - 1];
  }
}

// Rows are turned square by square, which the nearest cache holds.
static void store(const Strip& strip, const float* STEREOPSIS_RESTRICT samples, float* STEREOPSIS_RESTRICT plane) {
  const int n = length_of(strip), m = lines_of(strip);
  for (int from = 0; strip.rows && from < n; from += kLines) {
    const int to = from + kLines < n ? from + kLines : n;
    for (int k = 0; k < m; ++k) {
      float* STEREOPSIS_RESTRICT line = plane + static_cast<size_t>(strip.first + k) * strip.width;
      for (int i = from; i < to; ++i) line[i] = samples[i * kLines + k];
    }
  }
  for (int i = 0; !strip.rows && i < n; ++i)
    for (int k = 0; k < m; ++k) plane[static_cast<size_t>(i) * strip.width + strip.first + k] = samples[i * kLines + k];
}

// How high the surface with these slopes stands above each line's first sample.
static void load_heights(const Strip& strip, float* STEREOPSIS_RESTRICT rise) {
  const int n = length_of(strip), m = lines_of(strip);
  float height[kLines] = {}, step[kLines] = {};
  for (int i = 0; i < n; ++i) {
    if (i % kCell == 0)
      for (int k = 0; k < kLines; ++k) {
        const int line = strip.first + (k < m ? k : m - 1), y = strip.rows ? line : i, x = strip.rows ? i : line;
        step[k] = strip.slopes[static_cast<size_t>(y / kCell) * strip.cells_wide + x / kCell];
      }
    for (int k = 0; k < kLines; ++k) {
      rise[i * kLines + k] = height[k];
      height[k] += step[k];
    }
  }
}

// Elimination, from the first sample on: of the matrix it leaves the factors of the way back. Values, counted from `rise` if there
// is one, are weighted on the way. Only sums of positive terms.
static void eliminate(const float* STEREOPSIS_RESTRICT edges, const float* STEREOPSIS_RESTRICT rise, int n, float strength,
                      float* STEREOPSIS_RESTRICT value, float* STEREOPSIS_RESTRICT weight, float* STEREOPSIS_RESTRICT back) {
  float left[kLines] = {}, before[kLines] = {}, last_value[kLines] = {}, last_weight[kLines] = {};
  for (int i = 0; i < n; ++i) {
    const float factor = i + 1 < n ? strength : 0.0f;
    const int from = i * kLines;
    if (rise)
      for (int k = 0; k < kLines; ++k) value[from + k] -= rise[from + k];
    for (int k = 0; k < kLines; ++k) {
      const int at = from + k;
      const float next = factor * edges[at], kept = 1 + left[k], pivot = 1 / (kept + next), own = weight[at];
      back[at] = next * pivot;
      left[k] = next * (kept * pivot);
      value[at] = last_value[k] = (value[at] * own + before[k] * last_value[k]) * pivot;
      weight[at] = last_weight[k] = (own + before[k] * last_weight[k]) * pivot;
      before[k] = next;
    }
  }
}

// The way back, from the last sample; then values are divided by their weights.
static void substitute(const float* STEREOPSIS_RESTRICT rise, const float* STEREOPSIS_RESTRICT back, int n,
                       float* STEREOPSIS_RESTRICT value, float* STEREOPSIS_RESTRICT weight) {
  float last_value[kLines] = {}, last_weight[kLines] = {};
  for (int from = (n - 1) * kLines; from >= 0; from -= kLines) {
    for (int k = 0; k < kLines; ++k) {
      const int at = from + k;
      last_value[k] = value[at] + back[at] * last_value[k];
      weight[at] = last_weight[k] = weight[at] + back[at] * last_weight[k];
      value[at] = last_value[k] / last_weight[k];
    }
    if (rise)
      for (int k = 0; k < kLines; ++k) value[from + k] += rise[from + k];
  }
}

static void smooth_strip(const Strip& strip, float* memory) {
  const int n = length_of(strip);
  const size_t size = static_cast<size_t>(n) * kLines;
  float *edge = memory, *back = edge + size, *value = back + size, *weight = value + size, *rise = strip.slopes ? weight + size : nullptr;
  load(strip, strip.edges, edge);
  if (rise) load_heights(strip, rise);
  for (int k = 0; k < strip.field_count; ++k) {
    const Weighed& field = strip.fields[k];
    load(strip, field.value, value);
    load(strip, field.weight, weight);
    eliminate(edge, rise, n, strip.strength, value, weight, back);
    substitute(rise, back, n, value, weight);
    store(strip, value, field.value);
    store(strip, weight, field.weight);
  }
}

}  // namespace

extern const SmoothKernel smoothing;
const SmoothKernel smoothing = smooth_strip;

}  // namespace STEREOPSIS_ISA
}  // namespace stereopsis
