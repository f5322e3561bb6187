#include "sgm.hpp"

#include <algorithm>
#include <cstring>
#include <memory>
#include <stdexcept>
#include <vector>

#include "dispatch.hpp"
#include "parallel.hpp"
#include "scratch.hpp"
#include "stages.hpp"

#if defined(__linux__)
#include <sys/mman.h>
#endif

namespace stereopsis {

namespace generic {
extern const SgmKernels sgm;
}
#if defined(STEREOPSIS_X86)
namespace avx2 {
extern const SgmKernels sgm;
}
namespace avx512 {
extern const SgmKernels sgm;
}
#endif

const SgmKernels& choose_sgm(const std::string& name) {
  const std::string chosen = choose_kernel(name).name;
#if defined(STEREOPSIS_X86)
  if (chosen == "avx512vnni" || chosen == "avx512") return avx512::sgm;  // which has nothing to gain from VNNI
  if (chosen == "avx2") return avx2::sgm;
#endif
  return generic::sgm;
}

namespace {

// Aligned, and of large pages where that helps: the kernel hands those out many times as fast.
template <class T>
class Block {
 public:
  explicit Block(size_t count) {
    constexpr size_t page = size_t{1} << 21;
    const size_t bytes = count * sizeof(T), alignment = bytes >= 4 * page ? page : 64;
    alignment_ = std::align_val_t{alignment};
    memory_ = static_cast<T*>(::operator new(bytes + 64, alignment_));
#if defined(__linux__)
    if (alignment == page) madvise(memory_, bytes / page * page, MADV_HUGEPAGE);
#endif
  }
  ~Block() { ::operator delete(memory_, alignment_); }
  Block(const Block&) = delete;
  Block& operator=(const Block&) = delete;
  T* get() const { return memory_; }
  void fill(size_t count, T value) { std::fill_n(memory_, count, value); }

 private:
  std::align_val_t alignment_;
  T* memory_;
};

struct SgmJob {
  Pair pair;
  SgmSettings settings;
  const CensusCosts* census;
  const uint16_t* volume;  // where there is no census
  const SgmKernels* kernels;
  size_t room;
  // Candidates lo ... hi - 1 of pixel (x, y) are in view.
  void in_view(int x, int y, int* lo, int* hi) const {
    const int shift = census && census->shift ? census->shift[static_cast<size_t>(y) * pair.width + x] : 0;
    const int highest = x - pair.first - shift;
    *lo = std::clamp(highest - (pair.width - 1), 0, pair.count);
    *hi = std::clamp(highest + 1, 0, pair.count);
  }
};

// The costs of one row after the other, up or down; what is out of view costs as much as anything can.
template <class Lane>
class CostRows {
 public:
  explicit CostRows(const SgmJob& job)
      : job_(job),
        row_(job.pair.width * job.room),
        kept_(job.census ? (aggregated() ? 3 : 1) * distances() : 0),
        scratch_(job.census ? hamming_scratch(job.census->bits, job.pair.width, job.room) : 0) {
    row_.fill(job.pair.width * job.room, 0);
  }

  const Lane* at(int y) {
    const int W = job_.pair.width, H = job_.pair.height;
    const size_t room = job_.room, size = W * room;
    Lane* row = row_.get();
    if (!job_.census) {
      const uint16_t* from = job_.volume + static_cast<size_t>(y) * W * job_.pair.count;
      for (int x = 0; x < W; ++x)
        for (int i = 0; i < job_.pair.count; ++i) row[x * room + i] = static_cast<Lane>(*from++);
      return row;
    }
    const CensusCosts& census = *job_.census;
    if (aggregated()) {
      const AggregateRow sums{hamming(std::max(y - 1, 0)), hamming(y), hamming(std::min(y + 1, H - 1)), W, census.unit, room, row};
      (sizeof(Lane) == 1 ? job_.kernels->aggregate8 : job_.kernels->aggregate16)(sums);
    } else {
      const uint8_t* distances = hamming(y);
      const int rounding = 1 << census.unit >> 1;
      if (sizeof(Lane) == 1 && !census.unit)
        std::memcpy(row, distances, size);
      else
        for (size_t k = 0; k < size; ++k) row[k] = static_cast<Lane>((distances[k] + rounding) >> census.unit);
    }
    for (int x = 0; x < W; ++x) {
      int lo, hi;
      job_.in_view(x, y, &lo, &hi);
      const Lane most = static_cast<Lane>(job_.settings.most);
      std::fill_n(row + x * room, lo, most);
      std::fill_n(row + x * room + hi, job_.pair.count - hi, most);
    }
    return row;
  }

 private:
  bool aggregated() const { return job_.census->aggregated; }
  size_t distances() const { return (job_.pair.width + 2) * job_.room; }

  const uint8_t* hamming(int y) {
    const int slot = aggregated() ? y % 3 : 0;
    uint8_t* row = kept_.get() + slot * distances();
    if (row_of_[slot] == y) return row;
    const size_t W = job_.pair.width, at = static_cast<size_t>(y) * W;
    const CensusCosts& census = *job_.census;
    job_.kernels->hamming({census.left + at, census.right + at, census.shift ? census.shift + at : nullptr,
                           W * job_.pair.height, census.bits, job_.pair.width, job_.pair.first, job_.room, aggregated() ? 1 : 0,
                           scratch_.get(), row});
    row_of_[slot] = y;
    return row;
  }

  const SgmJob& job_;
  Block<Lane> row_;
  Block<uint8_t> kept_, scratch_;
  int row_of_[3] = {-1, -1, -1};
};

// Paths that are followed together: from pixel (x + dx, y - dy), with dy counted in the sweep's direction.
struct Offset {
  int dx, dy;
};
struct Group {
  int along;  // the step of a path along the row, +1 or -1, or 0 for none
  std::vector<Offset> above;
};
constexpr int kMargin = 2;  // the largest |dx|

std::vector<Group> groups_of(int paths, bool down) {
  const int step = down ? 1 : -1;
  const std::vector<Offset> around{{-1, 1}, {0, 1}, {1, 1}};
  switch (paths) {
    case 2:
      return {{1, {}}, {-1, {}}};
    case 4:
      return {{step, {{0, 1}}}};
    case 5:
      return {{1, around}, {-1, {}}};
    case 8:
      return {{step, around}};
    default:
      return {{step, around}, {0, {{-1, 2}, {1, 2}, {-2, 1}, {2, 1}}}};
  }
}
bool both_ways(int paths) { return paths == 4 || paths > 5; }

// The state of one group: of every path the costs and the least of them, of as many rows as it looks back, and the new one.
template <class Lane>
class GroupState {
 public:
  GroupState(const SgmJob& job, const Group& group, bool down)
      : job_(job),
        group_(group),
        down_(down),
        columns_(job.pair.width + 2 * kMargin),
        least_(depth() * columns_ * kPathsAtOnce),
        second_((group.above.size() + 1) * job.pair.width),
        line_(2 * job.room + 64),
        no_candidate_(job.room) {
    const size_t room = job.room, row = columns_ * room;
    for (size_t i = 0; i < room; ++i) no_candidate_.get()[i] = i < static_cast<size_t>(job.pair.count) ? Lane{0} : static_cast<Lane>(~Lane{0});
    for (const Offset& offset : group.above) {
      // One lane before and after: what is read there does not count.
      const size_t size = (offset.dy + 1) * row + 128;
      costs_.push_back(std::make_unique<Block<Lane>>(size));
      costs_.back()->fill(size, 0);
      Lane* costs = costs_.back()->get() + 64;
      if (room > static_cast<size_t>(job.pair.count))
        for (size_t at = 0; at < (offset.dy + 1) * row; at += room) std::copy_n(no_candidate_.get(), room, costs + at);
    }
    least_.fill(depth() * columns_ * kPathsAtOnce, 0);
    std::fill_n(second_.get(), (group.above.size() + 1) * job.pair.width, static_cast<Lane>(job.settings.p2[0]));
  }

  // Row y, the `turn`th of the sweep.
  void row(int turn, int y, const Lane* costs, const uint16_t* before, uint16_t* sums) {
    const int W = job_.pair.width, above = static_cast<int>(group_.above.size());
    const size_t room = job_.room;
    PathRow<Lane> row{};
    row.width = W;
    row.step = group_.along < 0 ? -1 : 1;
    row.count = job_.pair.count;
    row.room = room;
    row.along = group_.along != 0;
    row.above = above;
    row.costs = costs;
    row.no_candidate = no_candidate_.get();
    for (int k = 0; k < above; ++k) {
      const Offset& offset = group_.above[k];
      const int slots = offset.dy + 1;
      const auto costs_at = [&](int t) { return costs_[k]->get() + 64 + ((t + slots) % slots * columns_ + kMargin) * room; };
      row.from[k] = costs_at(turn - offset.dy) + offset.dx * static_cast<ptrdiff_t>(room);
      row.to[k] = costs_at(turn);
      row.least[k] = least_at(turn - offset.dy) + offset.dx * kPathsAtOnce + k;
    }
    row.least_to = least_at(turn);
    const Lane most = static_cast<Lane>(~Lane{0});
    row.first = static_cast<Lane>(std::min<int>(job_.settings.p1, most));
    for (int k = 0; k <= above; ++k) row.second[k] = second_.get() + static_cast<size_t>(k) * W;
    if (job_.settings.guide) {
      for (int k = 0; k < above; ++k) second_penalties(k, y, group_.above[k].dx, group_.above[k].dy);
      if (row.along) second_penalties(above, y, -row.step, 0);
    }
    row.line = line_.get();
    row.sums_before = before;
    row.sums = sums;
    if constexpr (sizeof(Lane) == 1)
      job_.kernels->paths8(row);
    else
      job_.kernels->paths16(row);
  }

 private:
  int depth() const {
    int deepest = 0;
    for (const Offset& offset : group_.above) deepest = std::max(deepest, offset.dy);
    return deepest + 1;
  }
  uint32_t* least_at(int turn) {
    return least_.get() + ((turn + depth()) % depth() * columns_ + kMargin) * kPathsAtOnce;
  }
  void second_penalties(int k, int y, int dx, int dy) {
    const int W = job_.pair.width, before = down_ ? y - dy : y + dy;
    if (before < 0 || before >= job_.pair.height) return;  // where a path begins, none counts
    const uint8_t* here = job_.settings.guide + static_cast<size_t>(y) * W;
    const uint8_t* there = job_.settings.guide + static_cast<size_t>(before) * W + dx;
    Lane* second = second_.get() + static_cast<size_t>(k) * W;
    for (int x = std::max(0, -dx); x < std::min(W, W - dx); ++x)
      second[x] = static_cast<Lane>(job_.settings.p2[std::abs(here[x] - there[x])]);
  }

  const SgmJob& job_;
  const Group group_;
  const bool down_;
  const size_t columns_;
  std::vector<std::unique_ptr<Block<Lane>>> costs_;
  Block<uint32_t> least_;
  Block<Lane> second_, line_, no_candidate_;
};

// What becomes of a row's complete sums.
struct Ends {
  uint16_t* volume = nullptr;  // (H, W, D): kept, 65535 where out of view
  const FusedSettings* settings = nullptr;
  const FusedOutput* out = nullptr;
  int least_shift = 0, largest_shift = 0;
};

// All paths that come from above, or from below.
template <class Lane>
class Sweep {
 public:
  Sweep(const SgmJob& job, const Ends& ends, bool down)
      : job_(job),
        ends_(ends),
        costs_(job),
        sums_(job.pair.width * job.room),
        all_{job.pair},
        right_(job.pair.width + job.pair.count + (ends.largest_shift - ends.least_shift) + job.room),
        scratch_(winner_scratch(job.pair.width, job.room)) {
    all_.first += ends.least_shift;
    all_.count += ends.largest_shift - ends.least_shift;
    for (const Group& group : groups_of(job.settings.paths, down)) groups_.push_back(std::make_unique<GroupState<Lane>>(job, group, down));
  }

  // The sums of this sweep's paths alone, into `volume`.
  void keep(int y, uint16_t* volume) { add(y, nullptr, row_of(volume, y), false); }
  // With those of the other sweep, which `volume` holds, or without another: the result.
  void complete(int y, const uint16_t* volume) {
    add(y, volume ? row_of(const_cast<uint16_t*>(volume), y) : nullptr, nullptr, true);
    end(y);
  }

 private:
  uint16_t* row_of(uint16_t* volume, int y) const { return volume + static_cast<size_t>(y) * job_.pair.width * job_.pair.count; }

  void add(int y, const uint16_t* before, uint16_t* to, bool) {
    const int W = job_.pair.width, D = job_.pair.count;
    const size_t room = job_.room;
    const bool whole = room == static_cast<size_t>(D);
    uint16_t* sums = to && whole ? to : sums_.get();
    if (before && !whole) {
      for (int x = 0; x < W; ++x) std::copy_n(before + static_cast<size_t>(x) * D, D, sums + x * room);
      before = sums;
    }
    const Lane* costs = costs_.at(y);
    for (auto& group : groups_) {
      group->row(turn_, y, costs, before, sums);
      before = sums;
    }
    ++turn_;
    if (to && !whole)
      for (int x = 0; x < W; ++x) std::copy_n(sums + x * room, D, to + static_cast<size_t>(x) * D);
  }

  void end(int y) {
    const int W = job_.pair.width, D = job_.pair.count;
    const size_t room = job_.room;
    uint16_t* sums = sums_.get();
    for (int x = 0; x < W; ++x) {
      int lo, hi;
      job_.in_view(x, y, &lo, &hi);
      std::fill_n(sums + x * room, lo, uint16_t{65535});
      std::fill(sums + x * room + hi, sums + (x + 1) * room, uint16_t{65535});
    }
    if (ends_.volume)
      for (int x = 0; x < W; ++x) std::copy_n(sums + x * room, D, row_of(ends_.volume, y) + static_cast<size_t>(x) * D);
    if (!ends_.out) return;
    const int16_t* shift = job_.census && job_.census->shift ? job_.census->shift + static_cast<size_t>(y) * W : nullptr;
    job_.kernels->winners({&all_, ends_.settings, D, shift, ends_.least_shift, room, sums, right_.get(), scratch_.get(), ends_.out, y});
  }

  const SgmJob& job_;
  const Ends& ends_;
  CostRows<Lane> costs_;
  Block<uint16_t> sums_;
  Pair all_;
  Block<uint32_t> right_;
  Block<int32_t> scratch_;
  std::vector<std::unique_ptr<GroupState<Lane>>> groups_;
  int turn_ = 0;
};

// Two sweeps meet in the middle: each keeps its sums over its first half of the rows, and completes those of the other over
// its second. So two threads are busy all the time, and one volume of sums is enough.
template <class Lane>
void sweep(const SgmJob& job, const Ends& ends, const Workers& workers) {
  const int H = job.pair.height, middle = (H + 1) / 2;
  const auto stopped = [](const Cancel& cancel) { return cancel.load(std::memory_order_relaxed); };
  if (!both_ways(job.settings.paths)) {
    // Paths along the rows know nothing of other rows.
    const int bands = job.settings.paths == 2 ? workers.threads : 1;
    parallel_rows(H, bands, workers.interrupted, [&](int begin, int end, const Cancel& cancel) {
      Sweep<Lane> down(job, ends, true);
      for (int y = begin; y < end && !stopped(cancel); ++y) down.complete(y, nullptr);
    });
    return;
  }
  std::unique_ptr<Block<uint16_t>> own;
  if (!ends.volume) own = std::make_unique<Block<uint16_t>>(static_cast<size_t>(H) * job.pair.width * job.pair.count);
  uint16_t* const volume = own ? own->get() : ends.volume;
  Sweep<Lane> down(job, ends, true), up(job, ends, false);
  for (const bool first : {true, false})
    parallel_rows(2, workers.threads, workers.interrupted, [&](int begin, int end, const Cancel& cancel) {
      for (int which = begin; which < end; ++which) {
        if (which == 0)
          for (int y = first ? 0 : middle; y < (first ? middle : H) && !stopped(cancel); ++y)
            first ? down.keep(y, volume) : down.complete(y, volume);
        else
          for (int y = (first ? H : middle) - 1; y >= (first ? middle : 0) && !stopped(cancel); --y)
            first ? up.keep(y, volume) : up.complete(y, volume);
      }
    });
}

void run(const SgmJob& job, const Ends& ends, const Workers& workers) {
  const int highest = job.settings.most + job.settings.largest_p2();
  if (static_cast<int64_t>(job.settings.paths) * highest > kLargestSum) throw std::invalid_argument("sums would not fit 16 bits");
  if (highest <= 255)
    sweep<uint8_t>(job, ends, workers);
  else
    sweep<uint16_t>(job, ends, workers);
}

}  // namespace

void sgm_sums(const Pair& pair, const uint16_t* costs, const SgmSettings& settings, uint16_t* sums, const SgmKernels& kernels,
              const Workers& workers) {
  const SgmJob job{pair, settings, nullptr, costs, &kernels, sgm_room(pair.count)};
  Ends ends;
  ends.volume = sums;
  run(job, ends, workers);
}

void sgm_census(const Pair& pair, const CensusCosts& costs, const SgmSettings& settings, const FusedSettings& select,
                const FusedOutput& out, const SgmKernels& kernels, const Workers& workers) {
  const SgmJob job{pair, settings, &costs, nullptr, &kernels, sgm_room(pair.count)};
  Ends ends;
  ends.settings = &select;
  ends.out = &out;
  if (costs.shift) {
    const auto range = std::minmax_element(costs.shift, costs.shift + static_cast<size_t>(pair.height) * pair.width);
    ends.least_shift = *range.first;
    ends.largest_shift = *range.second;
  }
  run(job, ends, workers);
}

}  // namespace stereopsis
