// Streaming matching: cost, aggregation and selection in one pass over the rows, with no cost volume in memory.
#pragma once

#include <atomic>
#include <cstddef>
#include <cstdint>

namespace stereopsis {

enum class CostKind : int { sad, ssd, zsad, zssd, ncc, zncc };
enum class Subpixel : int { none, parabola, equiangular };

// A support window: full size, and how far it reaches before its anchor. Of an even size the longer half comes first.
struct Window {
  int width, height;
  int left() const { return width / 2; }
  int right() const { return width - 1 - left(); }
  int above() const { return height / 2; }
  int below() const { return height - 1 - above(); }
  // From its anchor to the last row in the direction of `step`, 1 or -1.
  int ahead(int step) const { return step > 0 ? below() : -above(); }
  int64_t area() const { return static_cast<int64_t>(width) * height; }
};

// A pair as the kernels take it: rows without gaps, channels interleaved, and only candidates that some pixel can see.
struct Pair {
  const void* left;
  const void* right;
  int height, width, channels;
  int first;  // smallest candidate disparity
  int count;  // number of candidates
};

// The pixels of both images lie between these; unknown where there is none between.
struct Range {
  int32_t least = 0, most = -1;
  bool known() const { return least <= most; }
  // From the middle, which may be the upper one of two, no pixel is further.
  int64_t reach() const { return (int64_t{most} - least + 1) / 2; }
  int32_t middle() const { return static_cast<int32_t>(least + reach()); }
};

struct FusedSettings {
  CostKind cost;
  Window window;
  Subpixel subpixel;
  bool left_right;
  double tolerance;  // pixels
  bool uniqueness;
  double ratio;  // 1 + margin
  Range range = {};  // of images that are not bytes
};

struct FusedOutput {
  float* disparity;
  float* confidence;
  uint8_t* flags;
  // The winner's, infinite where none is in view. Who asks for it gets every winner as it was found, beside its flags.
  float* cost = nullptr;
  // (H, W, D): every candidate's cost, from the 32-bit kernels whose costs are floats alone.
  float* volume = nullptr;
};

// The widest sums that the 32-bit kernels form, over window and channels: squared differences of 8-bit pixels,
// 255 * 255 * 32896 = 2 139 062 400 < 2^31; and pixels, 255 * 32896 = 8 388 480 < 2^23, so that such a sum splits into a
// byte and a signed 16-bit number.
constexpr int64_t narrow_limit = 32896;
inline bool narrow_fits(const Window& window, int channels) { return window.area() * channels <= narrow_limit; }

// What is summed of 16-bit and float images of one channel counts from the middle of their range. Then these bound covariances and what means
// leave over of them, window sums to be split into a byte and a signed 16-bit number, and pixels and window sizes:
inline bool words_fit(const Range& range, const Window& window) {
  const int64_t reach = range.reach(), area = window.area();
  return range.known() && reach < 1 << 15 && area < 1 << 15 && area * reach < 1 << 23 && area * (reach * reach + 1) < int64_t{1} << 31;
}
// 4 times as much is still exact as a double.
inline bool doubles_fit(const Range& range, const Window& window) {
  const int64_t reach = range.reach();
  return range.known() && reach < 1 << 22 && window.area() * (reach * reach + 1) <= int64_t{1} << 51;
}

// Whether to stop early, as whoever works asks before each row: a flag that all threads share. Whom Python waits for finds out
// by it as well whether an answer is still wanted.
class Cancel {
 public:
  using Ask = bool (*)(void*);
  explicit Cancel(bool cancelled) : cancelled_(cancelled) {}
  explicit Cancel(const std::atomic<bool>& shared, Ask ask = nullptr, void* whom = nullptr)
      : shared_(&shared), ask_(ask), whom_(whom) {}
  bool load(std::memory_order order) const { return shared_ ? shared_->load(order) || (ask_ && ask_(whom_)) : cancelled_; }

 private:
  bool cancelled_ = false;
  const std::atomic<bool>* shared_ = nullptr;
  Ask ask_ = nullptr;
  void* whom_ = nullptr;
};

// Rows [begin, end) as a thread takes them, one after another: alone, from the top; or with a second one that starts at the
// bottom, until they meet. So neither waits for the other, whenever it could start and however often its core was lent away.
class RowsToTake {
 public:
  RowsToTake(int begin, int end) : alone_(end - begin), left_(&alone_), first_(begin), step_(1) {}
  // `left` of them nobody has taken: all, before the first of the two takes one.
  RowsToTake(int begin, int end, std::atomic<int>& left, bool upwards)
      : alone_(0), left_(&left), first_(upwards ? end - 1 : begin), step_(upwards ? -1 : 1) {}
  RowsToTake(const RowsToTake&) = delete;
  RowsToTake& operator=(const RowsToTake&) = delete;

  int first() const { return first_; }
  int step() const { return step_; }
  bool any() const { return left_->load(std::memory_order_relaxed) > 0; }
  // Whether the next one is the caller's.
  bool take() { return left_->fetch_sub(1, std::memory_order_relaxed) > 0; }

 private:
  std::atomic<int> alone_;
  std::atomic<int>* left_;
  int first_, step_;
};

// int32 images where `deep_fits`: as FusedKernel has it.
struct DeepKernel {
  size_t (*scratch_bytes)(const Pair&, const FusedSettings&);
  void (*rows)(const Pair&, const FusedSettings&, const FusedOutput&, RowsToTake& rows, void* scratch, const Cancel& cancel);
};

struct SupportKernels;

// What one build of the kernels offers. `rows` matches the rows that it can take: of uint8 images where `narrow`, of int32
// ones (16-bit pixels, or 21-bit fixed point) where not; `scratch` is 64-byte aligned and holds `scratch_bytes`; it stops
// early when `cancel` is set.
struct GaussianKernel;  // see gaussian.hpp
struct FusedKernel {
  const char* name;
  size_t (*scratch_bytes)(const Pair&, const FusedSettings&, bool narrow);
  void (*rows)(const Pair&, const FusedSettings&, bool narrow, const FusedOutput&, RowsToTake& rows, void* scratch,
               const Cancel& cancel);
  const SupportKernels* supports;  // costs over weighted supports: supports.hpp
  const GaussianKernel* gaussian;
};

}  // namespace stereopsis
