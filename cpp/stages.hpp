// The stages, in the order in which data goes through them. Arrays are contiguous; a cost volume is (H, W, D) with the
// candidates innermost, lower is better, `worst` where the candidate lies outside the right image.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <functional>

#include "fused.hpp"
#include "gaussian.hpp"
#include "pixelwise.hpp"
#include "score.hpp"
#include "supports.hpp"

namespace stereopsis {

// How many threads work, and whom to ask whether they should stop.
struct Workers {
  int threads;
  std::function<bool()> interrupted;
};

// ---- cost: one grey channel of three, (299 R + 587 G + 114 B) / 1000 in 15-bit fixed point, as OpenCV rounds it -------
struct RowKernels;
struct PhotometricKernel;
template <class T>
void grey(const T* rgb, int height, int width, T* grey, const RowKernels& kernels, const Workers& workers);

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

// ---- cost and aggregate: whole numbers of single pixels, summed over a box: pixelwise.hpp ------------------------------
// Where a comparison looks, from the pixel.
struct CensusPoint {
  int32_t dy, dx;
};
// Bit k of a pixel's string says whether its point 2 k is darker than its point 2 k + 1, edge pixels repeated: (P, H, W), bits
// 0 to 63 in the first plane.
template <class T>
void census(const T* image, int height, int width, const CensusPoint* points, int count, uint64_t* strings,
            const PixelwiseKernels& kernels, const Workers& workers);
// costs = (costs * factor + other * other_factor) / 2^16, rounded; what is out of view stays so. Factors are such that neither
// product, nor the sum, passes 2^31.
void combine(uint16_t* costs, const uint16_t* other, int rows, size_t in_row, uint32_t factor, uint32_t other_factor,
             const Workers& workers);
void pixel_costs(const PixelJob& job, const PixelwiseKernels& kernels, const Workers& workers);

// ---- cost, aggregate, score at once over supports beyond the box: mean costs, (H / step, W / step, D) ----------------
// Weights taps[j + radius] taps[i + radius], which sum to 1.
void separable_costs(const Pair& pair, CostKind cost, const Sampling& sampling, const double* taps, int radius, float* costs,
                     const SupportKernels& kernels, const Workers& workers);
// Rectangles that reach as far as each pixel's `reach` says, edge pixels repeated; or crosses, which stay inside the image.
void reach_costs(const Pair& pair, CostKind cost, const Sampling& sampling, bool cross, const Reach* reach, float* costs,
                 const SupportKernels& kernels, const Workers& workers);
void bilateral_costs(const Pair& pair, CostKind cost, const Sampling& sampling, const Window& window, double sigma_space,
                     double sigma_colour, float* costs, const SupportKernels& kernels, const Workers& workers);
// How far each pixel's arms go until a channel differs by more than `threshold`, at most `arm`, at least 1 inside the image.
void cross_arms(const int32_t* image, int height, int width, int channels, int arm, double threshold, Reach* reach,
                const Workers& workers);

// ---- optimize: labels that agree with their neighbours --------------------------------------------------------------
// V(a) = weight * min(|a|, truncation)^power, power 1 or 2.
struct Smoothness {
  int power;
  double weight, truncation;
};
// Costs (H, W, D), each pixel's least one 0, infinity where a label is not possible. A pixel without a possible label is -1
// in all labels, and takes no part: the edges to it do not count.
struct Grid {
  const float* costs;
  int height, width, count;
};
// Costs counted from each pixel's least one, and that one, (H, W); 0 where nothing is possible.
template <class T>
void relative_costs(const T* volume, int height, int width, int count, float* costs, double* least, const Workers& workers);
// The volume of the right view: at (x - d, y) what the left one holds at (x, y).
template <class T>
void right_volume(const T* left, int height, int width, int count, int first, T* right, const Workers& workers);
// scale * cost + weight * mean over the window of V(guide - label), V from `penalties`: 2 D - 1 of them, from 1 - D to D - 1.
// A pixel whose guide is -1 does not count. `total` may be the volume itself.
template <class T>
void second_pass(const T* volume, int height, int width, int count, const int32_t* guide, const Window& window,
                 const int64_t* penalties, double scale, double weight, float* total, const Workers& workers);
// best[l] = min over k of h[k] + V(l - k), for each of the rows; one entry of a row is finite at least.
void distance_transform(const float* h, int rows, int count, const Smoothness& smoothness, float* best);
// Each takes labels (only the first starts from them; -1 says which pixels take no part) and leaves its own.
void iterated_conditional_modes(const Grid& grid, const Smoothness& smoothness, int iterations, int32_t* labels,
                                const Workers& workers);
// Returns a lower bound of the energy.
double tree_reweighted(const Grid& grid, const Smoothness& smoothness, int iterations, int32_t* labels, const Workers& workers);
void belief_propagation(const Grid& grid, const Smoothness& smoothness, int iterations, int levels, int32_t* labels,
                        const Workers& workers);

// ---- select: winner-take-all for the left and for the right view ----------------------------------------------------
// (H, W) each. The winner's index (-1 where nothing is in view), its cost, its two neighbours' costs (its own where
// there is none), and the least cost apart from these three (`worst` where there is none).
template <class T>
struct Winners {
  int32_t* index;
  T *cost, *before, *after, *second;
};
// What of the image a volume holds: columns 0, step, 2 step, ... of `width`, and candidates `disparity_step` apart.
struct Lattice {
  int width, step, disparity_step;
  Lattice(int width, int step = 1, int disparity_step = 1) : width(width), step(step), disparity_step(disparity_step) {}
};
template <class T>
void select_left(const T* volume, int height, const Lattice& lattice, int count, int first, const Winners<T>& winners,
                 const Workers& workers);
// The same of labels that were chosen otherwise.
template <class T>
void select_at(const T* volume, int height, int width, int count, int first, const Winners<T>& winners, const Workers& workers);
// `index` is (H, width): of the right image every column.
template <class T>
void select_right(const T* volume, int height, const Lattice& lattice, int count, int first, int32_t* index,
                  const Workers& workers);

// ---- the same three stages at once, streaming ------------------------------------------------------------------------
// Of a pair of int32 images.
Range range_of(const Pair& pair);
void match(const Pair& pair, const FusedSettings& settings, bool narrow, const FusedKernel& kernel, const FusedOutput& out,
           const Workers& workers);

// ---- slant: planes in disparity, and the passes that are matched along them -----------------------------------------
struct Plane {
  double a, b, c;
  double at(double x, double y) const { return a * x + (b * y + c); }
};
// A plane, and how much steeper along x it is with every row.
struct TwistedPlane {
  double a, b, c, twist;
  double slope(double y) const { return a + twist * y; }
  double at(double x, double y) const { return slope(y) * x + (b * y + c); }
};
// A plane that goes on level where it would fall below `floor`.
struct Surface {
  Plane plane;
  double floor;
  double at(double x, double y) const {
    const double d = plane.at(x, y);
    return d < floor ? floor : d;
  }
};
struct PlaneSearch {
  int top;     // the first row that counts
  int radius;  // how far the three points of a trial may lie apart in x and y; 0: anywhere
  double most_a, least_b, most_b;
  double tolerance;  // pixels of disparity
  int trials, sample;
};
// The plane that most pixels of a map lie on (RANSAC, then least squares), and how many; 0 where there is none.
struct PlanarKernel;
int find_plane(const float* disparity, int height, int width, const PlaneSearch& search, Plane* plane, const PlanarKernel& kernel,
               const Workers& workers);
// The right image at (x - surface(x, y), y) for x from -margin to width + margin - 1, by cubic convolution.
template <class T>
void warp(const T* image, int height, int width, int channels, const Surface& surface, int margin, T lowest, T highest, T* warped,
          const Workers& workers);
// What matching along one surface gave, every array `margin` columns wider on either side than the image.
struct Pass {
  const float *disparity, *confidence, *cost;
  const uint8_t* flags;
  CostKind kind;
  int margin;
  Surface surface;
  double handicap;     // factor on what the pass leaves unexplained
  double least, most;  // disparities that may be answered
  bool beyond;         // whether a winner out of the right image's view counts as one, with that flag
  uint8_t number;
};
// The best so far, (H, W) each.
struct Hypothesis {
  float *disparity, *confidence, *cost, *misfit;
  uint8_t *flags, *plane;
};
void merge_pass(const Pass& pass, int height, int width, const Hypothesis& best, const Workers& workers);
// Takes over from `other`, matched with another window, where it expects the smaller variance.
void merge_window(const Hypothesis& other, CostKind kind, int height, int width, const Hypothesis& best, float* variance,
                  const Workers& workers);

// ---- rectify: what the right image lies too low or too high ----------------------------------------------------------
// The rounded means of 2 x 2 pixels each; an odd last row or column is left out.
void halve(const uint8_t* image, int height, int width, uint8_t* means, const RowKernels& kernels, const Workers& workers);
// (pixel - low) times the factor, rounded to even, within 0 and 255.
void stretch(const int32_t* image, int height, int width, double low, double factor, uint8_t* bytes, const RowKernels& kernels,
             const Workers& workers);
// In each whole tile the column and row, every `stride` pixels, whose window has the largest smaller eigenvalue of its
// summed products of gradients; of equal ones the first. -1, -1 where none exceeds `least`. `found` is (rows, columns, 2).
// Windows have kTrackedColumns columns here, and 2 `reach` + 1 rows.
void corners(const uint8_t* image, int height, int width, int tile, int stride, int reach, double least, int32_t* found,
             const RowKernels& kernels, const Workers& workers);
// Where points (x, y) of the left image went, in columns and rows: Lucas and Kanade's iterations from the motion that is
// given, with each window's mean and gain removed. The correlation is NaN where a window leaves its image or is flat.
void track(const uint8_t* left, const uint8_t* right, int height, int width, const int32_t* points, int count, int reach,
           int iterations, double* motion, double* correlation, const RowKernels& kernels, const Workers& workers);
// The field f0 + f1 across + f2 down + f3 across down that most of `rows` agree on: weights (1 + r^2 / 4 s^2)^-2, s the robust deviation of the
// residuals r, iterated from the median until nothing changes by `settled`; each slope is drawn towards 0 as if seen once with
// a deviation of `slope`, and f3 with one of `keystone`. Returns the variance of the field, on average over coordinates from -1/2 to 1/2.
double fit_rows(const double* across, const double* down, const double* rows, int count, double slope, double keystone,
                double settled, double* field);
// The image at (x, y + offset(x, y)), by cubic convolution along the column.
template <class T>
void move_rows(const T* image, int height, int width, int channels, const TwistedPlane& offset, T lowest, T highest, T* moved,
               const RowKernels& kernels, const Workers& workers);

// Adds bow (x - middle)^2 to disparities, in place, x being the column of the right image: the one that a left pixel matches, or in the
// right view's map a pixel's own. What lies within [least, most] stays there.
struct Bow {
  float bow, middle, least, most;
  bool of_right;
};
void unbow(float* disparity, int height, int width, const Bow& bow, const Workers& workers);

// Pixels further off the mean around them, 5 x 5 by binomial weights, by `amount` 64ths; bytes stay bytes.
template <class T>
void sharpen(const T* image, int height, int width, int channels, int amount, T* sharp, const Workers& workers);

// 8-bit pixels, windows weighted by a Gaussian, any cost but ZSAD.
void match_gaussian(const Pair& pair, const FusedSettings& settings, const GaussianFilter& filter, const FusedKernel& kernel,
                    const FusedOutput& out, const Workers& workers);

// ---- blank -----------------------------------------------------------------------------------------------------------
// What an image shows of each row, and of each column: from the first place on, before the second; 0, 0 where it shows nothing.
struct Shown {
  const int32_t *rows, *columns;
  int height, width;
};
// The pixels, `size` bytes each, at both ends of what rows and columns show.
struct BorderEdge {
  const uint8_t *rows, *columns;
  size_t size;
};
// Where a part of an image lies in it.
struct Patch {
  int top, left, height, width;
};
// In a part of an image, in place of what shows nothing, the nearest pixel of its row or else column that is shown; in corners, where
// neither shows anything, that of the nearest row which does. What is left by both stays as it is.
void continue_over(const Shown& image, const BorderEdge& edge, const Patch& part, uint8_t* pixels, const Workers& workers);
// Where a part of `here` shows nothing, or `there` does where its disparity points, `sign` times as far to the left; either may be null.
void find_hidden(const float* disparity, float sign, const Shown* here, const Shown* there, const Patch& part, uint8_t* hidden,
                 const Workers& workers);

// ---- validate --------------------------------------------------------------------------------------------------------
// Mean over the window, and over the channels, of |I(x + 1) - I(x - 1)| / 2, edge pixels repeated.
template <class T>
void texture(const T* image, int height, int width, int channels, const Window& window, float* mean, const Workers& workers);
// A map's pixels that are refused lose their value and their confidence, and get one more bit.
struct Refusal {
  float *disparity, *confidence;
  uint8_t* flags;
  uint8_t bit;
};
// Refuses where the texture is below `least`.
template <class T>
void refuse_dull(const T* image, int height, int width, int channels, const Window& window, float least, const Refusal& refused,
                 const RowKernels& kernels, const Workers& workers);
// Maps of both views, whose disparities lie between the candidates least ... most as well. Flags each left pixel whose match
// differs by more than `tolerance`, or lies outside: mismatched where a right pixel claims it, else occluded.
void left_right_maps(const float* left, const float* right, int height, int width, int least, int most, double tolerance,
                     uint8_t* flags, const Workers& workers);

// Sets `speckle` where a 4-connected region, in which neighbours differ by at most `difference`, has fewer than `area` pixels.
void speckle(const float* disparity, int height, int width, int area, float difference, uint8_t* speckle,
             const RowKernels& kernels, const Workers& workers);
// Refuses these regions.
void refuse_speckle(int height, int width, int area, float difference, const Refusal& refused, const RowKernels& kernels,
                    const Workers& workers);
// Sets `cut_off` in such regions where, at half of the places at least at which they end in a row, the next answer to the right
// is nearer by more than `nearer` and would lie left of the right image there; what is cut off is no answer to what lies left of
// it. The first column is the image's column `left`.
void cut_off(const float* disparity, int height, int width, int left, int area, float difference, float nearer,
             uint8_t* cut_off, const RowKernels& kernels, const Workers& workers);
// The largest gradient of any channel, along rows or columns, after two blurs by binomial weights of 3 x 3, edges repeated, less
// `calm`, in `unit`s, from 0 to 255.
void relief(const float* planes, int channels, int height, int width, float calm, float unit, uint8_t* relief,
            const RowKernels& kernels, const Workers& workers);
// How high a flood from above the first row has to rise to reach each pixel: over all 4-connected paths from the first row,
// the least of the path's highest relief.
void flood(const uint8_t* relief, int height, int width, uint8_t* level, const Workers& workers);
// Keeps those 4-connected regions of `inside` of which more than this share is marked, or the others; all are 0 or 1.
void keep_regions(const uint8_t* inside, const uint8_t* marked, int height, int width, double share, bool others, uint8_t* kept,
                  const Workers& workers);
// Mean magnitude of the response to (1, -2, 1; -2, 4, -2; 1, -2, 1) in each block, of each channel.
struct NoiseBlocks {
  int rows, columns, height, width;
};
void noise_means(const float* image, int width, int channels, const NoiseBlocks& blocks, double* means, const Workers& workers);
// NaN and 0 where there is a flag, else the map and its confidence.
void accept(const float* disparity, const float* confidence, const uint8_t* flags, int height, int width, float* accepted,
            float* trust, const Workers& workers);
// Keeps a map within [least, most], and judges by it what was matched: with a winner less than `near` from it, flags are taken
// back where all of them are `revocable`; with none so near, a pixel without a flag gets `wrong`. Then accepts the rest.
struct Evidence {
  const float *winners, *confidence;  // no winners: flags stay as they are
};
struct Verdict {
  float least, most, near;
  uint8_t revocable, wrong;
};
void judge(const Evidence& seen, const Verdict& verdict, int height, int width, float* smooth, uint8_t* flags, float* accepted,
           float* trust, const Workers& workers);

// ---- refine ----------------------------------------------------------------------------------------------------------
// Median over a size x size window of the pixels that have a value; pixels without one stay without. `filtered` may be the map.
void median(const float* disparity, int height, int width, int size, float* filtered, const RowKernels& kernels,
            const Workers& workers);

// The value at each pixel of the plane through what its window holds within `tolerance` of that plane: truncated least
// squares, from the map as it is, fronto-parallel, in `iterations` steps. Of a window at most kPlanarColumns x kPlanarRows pixels count.
struct PlanarKernel;
void planar(const float* disparity, int height, int width, const Window& window, float tolerance, int iterations, float* smooth,
            const PlanarKernel& kernel, const Workers& workers);
// A guide image of int32 pixels (H, W, channels), and how alike two pixels are by the largest difference k of their channels:
// fine[k] where disparities are smoothed, coarse[k] where slopes are; the last of `length` entries for all beyond.
struct SurfaceGuide {
  const int32_t* image;
  int channels;
  const float *fine, *coarse;
  int length;
  float strength;
};
// Median over a size x size window, size up to 11, of those pixels that have a value, each weighted by how much it looks like
// the middle one: ((255 - slope difference / 16)+)^2 / 256, at least 1. Values count in steps of 2^-k, the finest in which the
// map fits 15 bits; of those in the median's step the middle pixel stands for it, else the first of the window.
void weighted_median(const float* disparity, const uint8_t* guide, int height, int width, int channels, int size, int slope,
                     float* filtered, const Workers& workers);
// Weighted least squares along the guide's edges, from slanted surfaces; pixels without a value stay without.
void edge_aware(const float* disparity, const SurfaceGuide& guide, int height, int width, int iterations, float* smoothed,
                const Workers& workers);
// How probable it is that each answer is right, from the map around it. The logistic function from -8 to 8 in steps of 1/16.
struct LogisticModel {
  static constexpr int kFeatures = 10;
  const float *answered, *filled, *logistic;
};
// A map without holes; where it was matched; how sharp the winners' minima are, where they lay before any filter (NaN: none),
// and the image's mean gradient.
struct AnsweredMap {
  const float* surface;
  const uint8_t* answered;
  const float *sharpness, *winners, *texture;
  int height, width;
};
void probability(const AnsweredMap& map, const LogisticModel& model, float* confidence, const Workers& workers);

// ---- refine from the images -------------------------------------------------------------------------------------------
// A pair of int32 pixels. `start` and `disparity` are (H, W); where `start` is NaN, or nothing better is found, so it stays.
struct AlignedPair {
  const int32_t* left;
  const int32_t* right;
  int height, width, channels;
};
// The shift of the right window, whole in itself, that correlates best with the left one: with straight lines between
// pixels, in closed form; or with cubics, by Gauss-Newton. `centred`: each window's mean removed. `bytes`: pixels fit 8 bits.
enum class Alignment : int { correlation, lucas_kanade };
void align(const AlignedPair& pair, const Window& window, Alignment alignment, bool centred, bool bytes, const float* start,
           float* disparity, const Workers& workers);
// The same of a window that is slanted: disparity d + a u + b v at its column u and row v. `slopes` is (H, W, 2): a and b.
void align_planes(const AlignedPair& pair, const Window& window, const float* start, float* disparity, float* slopes,
                  const Workers& workers);
// The candidate, in steps of 1 / steps and within a pixel of the winner, at which the intervals that both lines span within
// half a step of each place lie least apart, summed over window and pixel; and a parabola through its neighbours.
void align_intervals(const AlignedPair& pair, const Window& window, int steps, const float* start, float* disparity,
                     const Workers& workers);

// ---- fill ------------------------------------------------------------------------------------------------------------
// Each row's holes with the lower of their two neighbours on it; rows without any answer above all others and below all others
// like the nearest one.
template <class T>
void background(const T* disparity, int height, int width, T* filled, const Workers& workers);
// From the nearest answers in eight directions: the second lowest where `occluded`, else their median.
void interpolate(const float* disparity, const uint8_t* occluded, int height, int width, float* filled, const Workers& workers);
// Surfaces go on into holes: what surrounds a hole, smoothed along the guide's edges, where it agrees; else the lower side.
void fill_surfaces(const float* disparity, const uint8_t* occluded, const SurfaceGuide& guide, int height, int width, float least,
                   float most, float* filled, const Workers& workers);
// Of what is doubtful the greater of `disparity` and `again`, the latter kept between the ends of the hole on its row.
void nearer(const float* disparity, const uint8_t* doubtful, const float* again, int height, int width, float* found, const Workers& workers);
// What is doubtful beside a jump goes to the nearer surface where more of what looks like it, and is not doubtful, lies on it.
// `alike`: the weight of a vote by the largest difference of the image's channels, 256 of them.
void outlines(const float* disparity, const uint8_t* doubtful, const uint8_t* image, int channels, const int32_t* alike, int height,
              int width, float* moved, const Workers& workers);

// 256 grey levels of either view.
struct GreyPair {
  const uint8_t *left, *right;
};

// A disparity in whole parts of a pixel: the same at every column, and so in every part of an image.
inline int parts_of(float disparity, int unit) {
  constexpr float far = 1 << 29;
  return static_cast<int>(std::min(std::max(std::rint(static_cast<float>(unit) * disparity), -far), far));
}

// What lies on the nearer side of a jump goes to the farther one where it matches better there, with what looks like it around;
// what is not doubtful, and lies farther off, votes by where it lies.
void unfatten(const float* disparity, const uint8_t* doubtful, const GreyPair& grey, const uint8_t* image, int channels,
              const int32_t* alike, int height, int width, float* moved, const Workers& workers);

// What is not doubtful moves by up to half a pixel, within [least, most], to where the grey levels around are most alike.
void photometric(const float* disparity, const uint8_t* doubtful, const GreyPair& grey, int height, int width, float least, float most,
                 float* moved, const PhotometricKernel& kernel, const Workers& workers);

}  // namespace stereopsis
