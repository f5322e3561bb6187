// The stages, in the order in which data goes through them. Arrays are contiguous; a cost volume is (H, W, D) with the
// candidates innermost, lower is better, `worst` where the candidate lies outside the right image.
#pragma once

#include <cstdint>
#include <functional>

#include "fused.hpp"
#include "gaussian.hpp"
#include "score.hpp"

namespace stereopsis {

// How many threads work, and whom to ask whether they should stop.
struct Workers {
  int threads;
  std::function<bool()> interrupted;
};

// ---- cost: one grey channel of three, (299 R + 587 G + 114 B) / 1000 in 15-bit fixed point, as OpenCV rounds it -------
template <class T>
void grey(const T* rgb, int height, int width, T* grey, const Workers& workers);

// ---- cost: what a support window sums, for every pixel of the image widened by the window's reach ------------------
// `pair` holds int32 pixels. `terms` is (H + window.height - 1, W + window.width - 1, D): products l r, or |l - r|.
enum class Term : int { product, absolute_difference };
void terms(const Pair& pair, const Window& window, Term term, int64_t* terms, const Workers& workers);

// ---- aggregate: sums over the window, (H, W, D) ---------------------------------------------------------------------
void box(const int64_t* terms, int height, int width, int count, const Window& window, int64_t* sums, const Workers& workers);

// ---- cost again: from window sums to costs. `narrow` says which arithmetic the streaming path would use -------------
void score(const Pair& pair, const Window& window, CostKind cost, bool narrow, const int64_t* sums, int64_t* costs,
           const Workers& workers);
void score(const Pair& pair, const Window& window, CostKind cost, bool narrow, const int64_t* sums, float* costs,
           const Workers& workers);
// ZSAD has no sums to start from.
void score_zsad(const Pair& pair, const Window& window, float* costs, const Workers& workers);

// ---- select: winner-take-all for the left and for the right view ----------------------------------------------------
// (H, W) each. The winner's index (-1 where nothing is in view), its cost, its two neighbours' costs (its own where
// there is none), and the least cost apart from these three (`worst` where there is none).
template <class T>
struct Winners {
  int32_t* index;
  T *cost, *before, *after, *second;
};
template <class T>
void select_left(const T* volume, int height, int width, int count, int first, const Winners<T>& winners,
                 const Workers& workers);
template <class T>
void select_right(const T* volume, int height, int width, int count, int first, int32_t* index, const Workers& workers);

// ---- the same three stages at once, streaming ------------------------------------------------------------------------
void match(const Pair& pair, const FusedSettings& settings, bool narrow, const FusedKernel& kernel, const FusedOutput& out,
           const Workers& workers);

// 8-bit pixels, windows weighted by a Gaussian, any cost but ZSAD.
void match_gaussian(const Pair& pair, const FusedSettings& settings, const GaussianFilter& filter, const FusedKernel& kernel,
                    const FusedOutput& out, const Workers& workers);

// ---- validate --------------------------------------------------------------------------------------------------------
// Mean over the window, and over the channels, of |I(x + 1) - I(x - 1)| / 2, edge pixels repeated.
void texture(const int32_t* image, int height, int width, int channels, const Window& window, float* mean,
             const Workers& workers);
// Sets `speckle` where a 4-connected region, in which neighbours differ by at most `difference`, has fewer than `area` pixels.
void speckle(const float* disparity, int height, int width, int area, float difference, uint8_t* speckle,
             const Workers& workers);

// ---- refine ----------------------------------------------------------------------------------------------------------
// Median over a size x size window of the pixels that have a value; pixels without one stay without.
void median(const float* disparity, int height, int width, int size, float* filtered, const Workers& workers);

}  // namespace stereopsis
