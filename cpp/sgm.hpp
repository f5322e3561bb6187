// Semi-global matching (Hirschmueller 2008, doi:10.1109/TPAMI.2007.1166): along each path r over the image
//
//   L_r(p, i) = C(p, i) + min(L_r(q, i), L_r(q, i - 1) + P1, L_r(q, i + 1) + P1, m + P2) - m,   m = min_k L_r(q, k)
//
// with q the path's pixel before p, or L_r(p, i) = C(p, i) where that lies outside the image; and S(p, i) the sum over the
// paths. Costs are whole numbers of at most `most`, so that m <= most, L_r <= most + P2, S <= paths (most + P2).
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>

#include "fused.hpp"

namespace stereopsis {

// The largest sum; one more says that a candidate is out of view.
constexpr int kLargestSum = 65534;

// Where a pixel's candidates have room for whole vectors, of any instruction set.
constexpr int kSgmBlock = 64;
inline size_t sgm_room(int count) { return (static_cast<size_t>(count) + kSgmBlock - 1) / kSgmBlock * kSgmBlock; }

// The Hamming distances of a row: of left pixel x and candidate i, which is right pixel x - first - shift[x] - i, at
// [(x + margin) * room + i], for x from -margin to width - 1 + margin. Edge pixels are repeated.
struct HammingRow {
  const uint64_t *left, *right;  // (planes, ..) strings, `plane` elements from plane to plane
  const int16_t* shift;          // or null
  size_t plane;
  int bits, width, first;
  size_t room;
  int margin;
  uint8_t* scratch;  // hamming_scratch(width, room)
  uint8_t* costs;
};
// Places of a row of right strings that some candidate means, and others that are read with them.
inline size_t hamming_reach(int width, size_t room) { return sgm_room(width) + 2 * room + kSgmBlock; }
// From plane to plane of the parts of these strings; not of 4 KiB, which would all want the same place in the cache.
constexpr int kPlaneStride = 4096 + 64;
inline size_t hamming_stride(int width, size_t room) {
  const size_t reach = hamming_reach(width, room);
  return reach < kPlaneStride ? kPlaneStride : reach;
}
// The strings of a row, the parts of one word of the left ones in 32 bits each, and planes of the right ones', parts being of at
// least four bits.
inline size_t hamming_scratch(int width, size_t room) {
  return 8 * hamming_reach(width, room) + 64 * static_cast<size_t>(width) + 16 * hamming_stride(width, room);
}

// Sums of 3 x 3 of such distances, whose margin is 1, rounded to units of 2^unit.
struct AggregateRow {
  const uint8_t *above, *here, *below;
  int width, unit;
  size_t room;
  void* costs;  // (width, room)
};

constexpr int kPathsAtOnce = 4;

// One row of up to four paths: the last one along the row where `along`, the others from rows above or below.
template <class Lane>
struct PathRow {
  int width, step;  // +1: from left to right
  int count;        // candidates
  size_t room;
  bool along, guided;               // whether P2 differs from pixel to pixel
  int above;                        // paths that come from other rows
  const Lane* costs;                // (width, room)
  const Lane* no_candidate;         // (room): 0, but the largest number less P1 where there is no candidate
  const Lane* from[kPathsAtOnce];   // path k's costs at the pixel before pixel x, at [x * room]
  Lane* to[kPathsAtOnce];           // its costs at pixel x, at [x * room]
  const uint32_t* least[kPathsAtOnce];  // the least of those at `from`, at [x * kPathsAtOnce]
  uint32_t* least_to;                   // of those at `to`, in every lane of the word at [x * kPathsAtOnce + k]
  const Lane* second[kPathsAtOnce];     // P2 at pixel x
  Lane first;                           // P1; no cost and P1 sum to more than a lane holds
  Lane* line;                           // scratch, 2 * room
  const uint16_t* sums_before;          // (width, room), or null for none
  uint16_t* sums;                       // (width, room), or null; beyond the candidates anything
  // P2 twice is no more than a lane holds, and a pixel's paths are this row's and those of `sums_before`, as many: sums without
  // any before them may have a form of the build's own, in the same memory, which it understands where they are these.
  bool in_pairs;
  const char* soon;                     // 64 bytes a pixel that are asked for soon, or null
};

// The winners of a row of sums, (width, room), in which whatever is out of view is 65535.
struct WinnerRow {
  const Pair* pair;  // all disparities that some pixel's candidates mean
  const FusedSettings* settings;
  int count;             // a pixel's candidates
  const int16_t* shift;  // candidate i of pixel x means disparity pair->first + shift[x] - least_shift + i; or null
  int least_shift;
  size_t room;
  uint16_t* sums;    // with kSgmBlock before and after that may be read
  int32_t* right;    // right_scratch(*pair, room); with the left-right check alone
  int32_t* scratch;  // winner_scratch(width)
  const FusedOutput* out;
  int y;
};
inline size_t winner_scratch(int width) { return 8 * static_cast<size_t>(width) + 64; }
// Places of the right pixels that candidates mean, and others that are written with them.
inline size_t winner_reach(const Pair& pair, size_t room) { return static_cast<size_t>(pair.width) + pair.count + room + kSgmBlock; }
inline size_t right_scratch(const Pair& pair, size_t room) { return 2 * winner_reach(pair, room) + room + kSgmBlock; }

// A winner out of view, by its number and its sum; or -1.
struct Beyond {
  int index;
  uint16_t sum;
};

struct SgmKernels {
  void (*hamming)(const HammingRow&);
  void (*aggregate8)(const AggregateRow&);
  void (*aggregate16)(const AggregateRow&);
  void (*paths8)(const PathRow<uint8_t>&);
  void (*paths16)(const PathRow<uint16_t>&);
  void (*winners)(const WinnerRow&);
  // Sums of a pixel's candidates but lo ... hi - 1 become 65535. The least of all, should it be one of these.
  Beyond (*hide)(uint16_t* sums, int lo, int hi, int count);
};

// The build that goes with the named instruction set, or with the best one for an empty name.
const SgmKernels& choose_sgm(const std::string& name);

// ---- the whole of it -----------------------------------------------------------------------------------------------------

struct SgmSettings {
  int paths;             // 2, 4, 5, 8 or 16
  int most, p1;          // of costs in units; P1
  const int32_t* p2;     // (256): P2 by the absolute difference of the guide between a pixel and the one before it
  const uint8_t* guide;  // (H, W), or null: p2[0] everywhere
  int largest_p2() const {
    int largest = p2[0];
    for (int k = 1; guide && k < 256; ++k) largest = p2[k] > largest ? p2[k] : largest;
    return largest;
  }
};

// Costs from census strings, (planes, H, W) of `bits` bits.
struct CensusCosts {
  const uint64_t *left, *right;
  int bits;
  bool aggregated;       // over 3 x 3
  int unit;              // rounded to units of 2^unit
  const int16_t* shift;  // (H, W), or null: candidate i of pixel p means the disparity first + shift[p] + i
};
// The sums over 3 x 3 have to pass through bytes, three at a time.
constexpr int kMostAggregatedBits = 85;

// What a candidate out of view costs: unrelated strings differ in half of their bits, unrelated windows do not correlate.
constexpr int cost_by_chance(int most) { return (most + 1) / 2; }

// Sums of a volume of costs in units, (H, W, D).
struct Workers;
void sgm_sums(const Pair& pair, const uint16_t* costs, const SgmSettings& settings, uint16_t* sums, const SgmKernels& kernels,
              const Workers& workers);
// Sums out of view become 65535; `beyond` (H, W) is the number of a pixel's least sum where that is one of them, else -1.
void hide_out_of_view(const Pair& pair, uint16_t* sums, int32_t* beyond, const SgmKernels& kernels, const Workers& workers);
// More-global matching (Facciolo, de Franchis, Meinhardt 2015, doi:10.5244/C.29.90), 4 or 8 directions: a pixel takes the mean,
// rounded down, of what two pixels tell it, one step back and one step back at right angles, a quarter turn on; or what one
// does where the other lies outside.
void mgm_sums(const Pair& pair, const uint16_t* costs, const SgmSettings& settings, uint16_t* sums, const Workers& workers);
// The winners of the sums of census costs, with no more in memory than one volume of sums.
void sgm_census(const Pair& pair, const CensusCosts& costs, const SgmSettings& settings, const FusedSettings& select,
                const FusedOutput& out, const SgmKernels& kernels, const Workers& workers);

}  // namespace stereopsis
