#include "sgm.hpp"

#include <algorithm>
#include <cstring>
#include <memory>
#include <stdexcept>
#include <vector>

#include "parallel.hpp"
#include "scratch.hpp"
#include "stages.hpp"
#include "winners.hpp"

#if defined(__linux__)
#include <sys/mman.h>
#endif

namespace stereopsis {

namespace {

// Aligned, and of large pages where that helps: the kernel hands those out many times as fast. Not by an aligned `new`: what
// that leaves over makes the next such block too large for the place that this one leaves, and the kernel is asked anew.
template <class T>
class Block {
 public:
  explicit Block(size_t count) {
    constexpr size_t page = size_t{1} << 21;
    const size_t bytes = count * sizeof(T), alignment = bytes >= 2 * page ? page : 64;
    taken_ = ::operator new(bytes + 64 + alignment);
    memory_ = reinterpret_cast<T*>((reinterpret_cast<uintptr_t>(taken_) + alignment - 1) / alignment * alignment);
#if defined(__linux__)
    if (alignment == page) madvise(memory_, bytes / page * page, MADV_HUGEPAGE);
#endif
  }
  ~Block() { ::operator delete(taken_); }
  Block(const Block&) = delete;
  Block& operator=(const Block&) = delete;
  T* get() const { return memory_; }
  void fill(size_t count, T value) { std::fill_n(memory_, count, value); }

 private:
  void* taken_;
  T* memory_;
};

struct SgmJob {
  Pair pair;
  SgmSettings settings;
  const CensusCosts* census;
  const uint16_t* volume;  // where there is no census
  const SgmKernels* kernels;
  size_t room;
  // P1; beyond the largest P2 it makes no difference.
  int first() const { return std::min(settings.p1, settings.largest_p2()); }
  // Calls visit(x) for all columns but those whose candidates are all in view, whatever the row.
  template <class Visit>
  void each_partly_in_view(Visit visit) const {
    const bool unsure = census && census->shift;
    const int begin = unsure ? pair.width : std::clamp(pair.first + pair.count - 1, 0, pair.width);
    const int end = std::clamp(pair.first + pair.width, begin, pair.width);
    for (int x = 0; x < begin; ++x) visit(x);
    for (int x = end; x < pair.width; ++x) visit(x);
  }
  // Candidates lo ... hi - 1 of pixel (x, y) are in view.
  void in_view(int x, int y, int* lo, int* hi) const {
    const int shift = census && census->shift ? census->shift[static_cast<size_t>(y) * pair.width + x] : 0;
    const int highest = x - pair.first - shift;
    *lo = std::clamp(highest - (pair.width - 1), 0, pair.count);
    *hi = std::clamp(highest + 1, 0, pair.count);
  }
};

// The costs of one row after the other, up or down; what is out of view costs what a match by chance does.
template <class Lane>
class CostRows {
 public:
  explicit CostRows(const SgmJob& job)
      : job_(job),
        kept_(job.census ? (aggregated() ? 3 : 1) * distances() : 0),
        scratch_(job.census ? hamming_scratch(job.pair.width, job.room) : 0) {}

  // Row y into (width, room), what is beyond the candidates being anything.
  void make(int y, Lane* row) {
    const int W = job_.pair.width, H = job_.pair.height, D = job_.pair.count;
    const size_t room = job_.room, size = W * room;
    if (!job_.census) {
      const uint16_t* from = job_.volume + static_cast<size_t>(y) * W * D;
      for (size_t x = 0; x < static_cast<size_t>(W); ++x) {
        for (int i = 0; i < D; ++i) row[x * room + i] = static_cast<Lane>(from[x * D + i]);
        std::fill(row + x * room + D, row + (x + 1) * room, Lane{0});
      }
      return;
    }
    const CensusCosts& census = *job_.census;
    if (aggregated()) {
      const AggregateRow sums{kept(std::max(y - 1, 0)), kept(y), kept(std::min(y + 1, H - 1)), W, census.unit, room, row};
      (sizeof(Lane) == 1 ? job_.kernels->aggregate8 : job_.kernels->aggregate16)(sums);
    } else if (sizeof(Lane) == 1 && !census.unit) {
      hamming(y, reinterpret_cast<uint8_t*>(row));
    } else {
      const uint8_t* distances = kept(y);
      const int rounding = 1 << census.unit >> 1;
      for (size_t k = 0; k < size; ++k) row[k] = static_cast<Lane>((distances[k] + rounding) >> census.unit);
    }
    const Lane by_chance = static_cast<Lane>(cost_by_chance(job_.settings.most));
    job_.each_partly_in_view([&](int x) {
      int lo, hi;
      job_.in_view(x, y, &lo, &hi);
      std::fill_n(row + x * room, lo, by_chance);
      std::fill_n(row + x * room + hi, D - hi, by_chance);
    });
  }

 private:
  bool aggregated() const { return job_.census->aggregated; }
  size_t distances() const { return (job_.pair.width + 2) * job_.room; }

  const uint8_t* kept(int y) {
    const int slot = aggregated() ? y % 3 : 0;
    uint8_t* row = kept_.get() + slot * distances();
    if (row_of_[slot] != y) hamming(y, row);
    row_of_[slot] = y;
    return row;
  }
  void hamming(int y, uint8_t* row) {
    const size_t W = job_.pair.width, at = static_cast<size_t>(y) * W;
    const CensusCosts& census = *job_.census;
    job_.kernels->hamming({census.left + at, census.right + at, census.shift ? census.shift + at : nullptr,
                           W * job_.pair.height, census.bits, job_.pair.width, job_.pair.first, job_.room, aggregated() ? 1 : 0,
                           scratch_.get(), row});
  }

  const SgmJob& job_;
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

// Rows that are followed again at a time: their sums stay in the cache, and what is kept of the others is little.
constexpr int kStretch = 8;

// Where a sweep notes, every kStretch rows, what the next row will look back at.
struct Notes {
  char* memory = nullptr;
  size_t stride = 0;
  int count = 0;
};

// The state of one group: of every path the costs and the least of them, of as many rows as it looks back, and the new one.
template <class Lane>
class GroupState {
 public:
  GroupState(const SgmJob& job, const Group& group, bool down)
      : job_(job),
        group_(group),
        down_(down),
        in_pairs_((job.settings.paths == 4 || job.settings.paths == 8) && 2 * job.settings.largest_p2() <= 255),
        columns_(job.pair.width + 2 * kMargin),
        least_(depth() * columns_ * kPathsAtOnce),
        second_((group.above.size() + 1) * job.pair.width),
        line_(2 * job.room + 64),
        no_candidate_(job.room) {
    const size_t room = job.room, row = columns_ * room;
    for (size_t i = 0; i < room; ++i) no_candidate_.get()[i] = i < static_cast<size_t>(job.pair.count) ? 0 : static_cast<Lane>(static_cast<Lane>(~Lane{0}) - job.first());
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

  // What the `turn`th row will look back at.
  size_t saved() const {
    size_t rows = 0;
    for (const Offset& offset : group_.above) rows += offset.dy;
    return (rows * costs_row() * sizeof(Lane) + (depth() - 1) * least_row() * sizeof(uint32_t) + 63) / 64 * 64;
  }
  // Rows that are noted are written to the notes, and read from there, where they are no further back than one.
  void note_in(const Notes& notes, bool fresh) {
    if (depth() != 2) return;
    notes_ = notes;
    noting_ = fresh;
    if (fresh) begin_row(-1, 0);
  }
  char* save(int turn, char* to) const {
    char* const next = to + saved();
    if (!notes_.memory) each_saved(turn, [&](void* from, size_t bytes) { std::memcpy(to, from, bytes), to += bytes; });
    return next;
  }
  const char* restore(int turn, const char* from) {
    const char* const next = from + saved();
    if (!notes_.memory) each_saved(turn, [&](void* to, size_t bytes) { std::memcpy(to, from, bytes), from += bytes; });
    return next;
  }

  // Row y, the `turn`th of the sweep.
  void row(int turn, int y, const Lane* costs, const uint16_t* before, uint16_t* sums, const char* soon) {
    const int W = job_.pair.width, above = static_cast<int>(group_.above.size());
    const size_t room = job_.room;
    PathRow<Lane> row{};
    row.width = W;
    row.step = group_.along < 0 ? -1 : 1;
    row.count = job_.pair.count;
    row.room = room;
    row.along = group_.along != 0 && sums;  // which leaves nothing to other rows
    row.guided = job_.settings.guide != nullptr;
    row.above = above;
    row.costs = costs;
    row.no_candidate = no_candidate_.get();
    for (int k = 0; k < above; ++k) {
      const Offset& offset = group_.above[k];
      row.from[k] = costs_at(k, turn - offset.dy) + offset.dx * static_cast<ptrdiff_t>(room);
      row.to[k] = noting_ ? costs_at(k, turn) : slot_at(k, turn);
      row.least[k] = least_at(turn - offset.dy) + offset.dx * kPathsAtOnce + k;
    }
    row.least_to = noting_ ? least_at(turn) : least_slot_at(turn);
    if (noting_ && note_of(turn)) begin_row(turn, job_.pair.width);
    row.first = static_cast<Lane>(job_.first());
    for (int k = 0; k < above + row.along; ++k) row.second[k] = second_.get() + static_cast<size_t>(k) * W;
    if (job_.settings.guide) {
      for (int k = 0; k < above; ++k) second_penalties(k, y, group_.above[k].dx, group_.above[k].dy);
      if (row.along) second_penalties(above, y, -row.step, 0);
    }
    row.line = line_.get();
    row.sums_before = before;
    row.sums = sums;
    row.in_pairs = in_pairs_;
    row.soon = soon;
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
  // What is looked back at where no pixel is: beside the `width` that a row of the turn will write. Of a note, when its turn
  // comes: it is the first that takes the memory, which by all at once would keep a call for a second that nothing can stop.
  void begin_row(int turn, int width) {
    const size_t room = job_.room, wide = kMargin + width;
    for (int k = 0; k < static_cast<int>(group_.above.size()); ++k)
      for (size_t column = 0; column < columns_; ++column)
        if (column < kMargin || column >= wide) std::copy_n(no_candidate_.get(), room, costs_at(k, turn) + column * room - kMargin * room);
    std::fill_n(least_at(turn) - kMargin * kPathsAtOnce, least_row(), 0u);
  }
  size_t costs_row() const { return columns_ * job_.room; }
  size_t least_row() const { return columns_ * kPathsAtOnce; }
  char* note_of(int turn) const {
    const int next = turn + 1;
    return notes_.memory && next % kStretch == 0 && next / kStretch < notes_.count
               ? notes_.memory + next / kStretch * notes_.stride
               : nullptr;
  }
  Lane* costs_at(int k, int turn) const {
    if (char* note = note_of(turn)) return reinterpret_cast<Lane*>(note) + k * costs_row() + kMargin * job_.room;
    return slot_at(k, turn);
  }
  Lane* slot_at(int k, int turn) const {
    const int slots = group_.above[k].dy + 1;
    return costs_[k]->get() + 64 + ((turn + slots) % slots * columns_ + kMargin) * job_.room;
  }
  uint32_t* least_at(int turn) const {
    if (char* note = note_of(turn))
      return reinterpret_cast<uint32_t*>(note + group_.above.size() * costs_row() * sizeof(Lane)) + kMargin * kPathsAtOnce;
    return least_slot_at(turn);
  }
  uint32_t* least_slot_at(int turn) const {
    return least_.get() + ((turn + depth()) % depth() * columns_ + kMargin) * kPathsAtOnce;
  }
  template <class Visit>
  void each_saved(int turn, Visit visit) const {
    for (int k = 0; k < static_cast<int>(group_.above.size()); ++k)
      for (int back = 1; back <= group_.above[k].dy; ++back) visit(costs_at(k, turn - back) - kMargin * job_.room, costs_row() * sizeof(Lane));
    for (int back = 1; back < depth(); ++back)
      visit(least_at(turn - back) - kMargin * kPathsAtOnce, least_row() * sizeof(uint32_t));
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
  const bool down_, in_pairs_;
  const size_t columns_;
  Notes notes_;
  bool noting_ = false;  // or what is noted is looked back at alone
  std::vector<std::unique_ptr<Block<Lane>>> costs_;
  Block<uint32_t> least_;
  Block<Lane> second_, line_, no_candidate_;
};

// What becomes of a row's complete sums.
struct Ends {
  uint16_t* volume = nullptr;  // (H, W, D): kept as they are
  const FusedSettings* settings = nullptr;
  const FusedOutput* out = nullptr;
  int least_shift = 0, largest_shift = 0;
};

// All paths that come from above, or from below, row by row.
template <class Lane>
class Sweep {
 public:
  Sweep(const SgmJob& job, bool down) {
    for (const Group& group : groups_of(job.settings.paths, down)) groups_.push_back(std::make_unique<GroupState<Lane>>(job, group, down));
  }
  // Adds to the sums `before`, or to nothing; the costs alone go on where there are no `sums`. From `soon` on, 64 bytes a
  // pixel are fetched meanwhile.
  void row(int y, const Lane* costs, const uint16_t* before, uint16_t* sums, const char* soon = nullptr) {
    for (auto& group : groups_) {
      group->row(turn_, y, costs, before, sums, soon);
      before = sums;
      soon = nullptr;
    }
    ++turn_;
  }
  size_t saved() const {
    size_t bytes = 0;
    for (const auto& group : groups_) bytes += group->saved();
    return bytes;
  }
  void note_in(Notes notes, bool fresh) {
    for (auto& group : groups_) {
      group->note_in(notes, fresh);
      notes.memory += group->saved();
    }
  }
  void save(char* to) const {
    for (const auto& group : groups_) to = group->save(turn_, to);
  }
  void restore(int turn, const char* from) {
    turn_ = turn;
    for (auto& group : groups_) from = group->restore(turn, from);
  }

 private:
  std::vector<std::unique_ptr<GroupState<Lane>>> groups_;
  int turn_ = 0;
};

// Makes of a row of complete sums what is asked for.
class RowEnd {
 public:
  RowEnd(const SgmJob& job, const Ends& ends)
      : job_(job),
        ends_(ends),
        all_(all(job, ends)),
        right_(right_scratch(all(job, ends), job.room)),
        scratch_(winner_scratch(job.pair.width)) {}

  void row(int y, uint16_t* sums) {
    const int W = job_.pair.width, D = job_.pair.count;
    const size_t room = job_.room, at = static_cast<size_t>(y) * W;
    if (ends_.volume)
      for (int x = 0; x < W; ++x) std::copy_n(sums + x * room, D, ends_.volume + (at + x) * D);
    if (!ends_.out) return;
    beyond_.clear();
    if (room > static_cast<size_t>(D))
      for (int x = 0; x < W; ++x) std::fill(sums + x * room + D, sums + (x + 1) * room, uint16_t{65535});
    job_.each_partly_in_view([&](int x) {
      int lo, hi;
      job_.in_view(x, y, &lo, &hi);
      const Beyond found = job_.kernels->hide(sums + x * room, lo, hi, D);
      if (found.index >= 0) beyond_.push_back({x, found});
    });
    const int16_t* shift = job_.census && job_.census->shift ? job_.census->shift + at : nullptr;
    job_.kernels->winners({&all_, ends_.settings, D, shift, ends_.least_shift, room, sums, right_.get(), scratch_.get(), ends_.out, y});
    for (const auto& [x, winner] : beyond_) {
      const FusedOutput& out = *ends_.out;
      const int disparity = job_.pair.first + (shift ? shift[x] : 0) + winner.index;
      out.disparity[at + x] = out.cost ? static_cast<float>(disparity) : std::numeric_limits<float>::quiet_NaN();
      out.confidence[at + x] = 0;
      out.flags[at + x] = kOutOfView;
      if (out.cost) out.cost[at + x] = winner.sum;
    }
  }

 private:
  // All disparities that some pixel's candidates mean.
  static Pair all(const SgmJob& job, const Ends& ends) {
    Pair pair = job.pair;
    pair.first += ends.least_shift;
    pair.count += ends.largest_shift - ends.least_shift;
    return pair;
  }

  const SgmJob& job_;
  const Ends& ends_;
  const Pair all_;
  Block<int32_t> right_;
  Block<int32_t> scratch_;
  std::vector<std::pair<int, Beyond>> beyond_;  // by columns
};

// Two sweeps, one down and one up, meet in the middle. Over its first half of the rows each only notes what it looks back
// at, every kStretch rows. Over its second half it ends each row, with the sums of the other sweep's paths, which are
// followed again from what was noted. So two threads are busy all the time, and no volume of sums is needed.
template <class Lane>
class Meeting {
 public:
  Meeting(const SgmJob& job, const Ends& ends)
      : job_(job), ends_(ends), down_(job, true), up_(job, false), noted_(notes(false) + notes(true)) {
    down_.note_in(notes_of(0), true);
    up_.note_in(notes_of(1), true);
  }

  void run(const Workers& workers) {
    for (const bool first : {true, false})
      parallel_rows(2, workers.threads, workers.interrupted, [&](int begin, int end, const Cancel& cancel) {
        for (int which = begin; which < end; ++which) first ? note(which, cancel) : finish(which, cancel);
      });
  }

 private:
  int middle() const { return (job_.pair.height + 1) / 2; }
  // Of the sweep down (0) or up (1): how many rows its first half has, and the turn-th of all its rows.
  int half(int which) const { return which == 0 ? middle() : job_.pair.height - middle(); }
  int row_of(int which, int turn) const { return which == 0 ? turn : job_.pair.height - 1 - turn; }
  size_t notes(bool up) const { return stretches(up) * down_.saved(); }
  int stretches(int which) const { return (half(which) + kStretch - 1) / kStretch; }
  Notes notes_of(int which) { return {noted(which), down_.saved(), stretches(which)}; }
  char* noted(int which) { return noted_.get() + (which == 0 ? 0 : notes(false)); }
  // The k-th part of what is noted before stretch n, of which a row of pixels fetches one; or null where there is no more.
  const char* part_of(int which, int n, int k) {
    const size_t begin = k * static_cast<size_t>(job_.pair.width) * 64;
    return n < stretches(which) && begin < down_.saved() ? noted(which) + n * down_.saved() + begin : nullptr;
  }
  size_t row_size() const { return job_.pair.width * job_.room; }

  void note(int which, const Cancel& cancel) {
    Sweep<Lane>& sweep = which == 0 ? down_ : up_;
    CostRows<Lane> rows(job_);
    Block<Lane> costs(row_size());
    for (int turn = 0; turn < half(which) && !cancel.load(std::memory_order_relaxed); ++turn) {
      if (turn % kStretch == 0) sweep.save(noted(which) + turn / kStretch * sweep.saved());
      rows.make(row_of(which, turn), costs.get());
      sweep.row(row_of(which, turn), costs.get(), nullptr, nullptr, part_of(which, turn / kStretch + 1, turn % kStretch));
    }
  }

  void finish(int which, const Cancel& cancel) {
    const int other = 1 - which;
    Sweep<Lane>& sweep = which == 0 ? down_ : up_;
    Sweep<Lane> again(job_, other == 0);
    again.note_in(notes_of(other), false);
    CostRows<Lane> rows(job_);
    RowEnd row_end(job_, ends_);
    Block<Lane> costs(kStretch * row_size());
    Block<uint16_t> sums(kStretch * row_size() + 2 * kSgmBlock);
    // The other's stretches, from the last one back to its first.
    for (int stretch = stretches(other) - 1; stretch >= 0; --stretch) {
      const int begin = stretch * kStretch, end = std::min(begin + kStretch, half(other));
      again.restore(begin, noted(other) + stretch * again.saved());
      for (int turn = begin; turn < end; ++turn) {
        if (cancel.load(std::memory_order_relaxed)) return;
        const size_t slot = (turn - begin) * row_size();
        rows.make(row_of(other, turn), costs.get() + slot);
        again.row(row_of(other, turn), costs.get() + slot, nullptr, sums.get() + kSgmBlock + slot);
      }
      for (int turn = end - 1; turn >= begin; --turn) {
        if (cancel.load(std::memory_order_relaxed)) return;
        const size_t slot = (turn - begin) * row_size();
        uint16_t* const row = sums.get() + kSgmBlock + slot;
        sweep.row(row_of(other, turn), costs.get() + slot, row, row);
        row_end.row(row_of(other, turn), row);
      }
    }
  }

  const SgmJob& job_;
  const Ends& ends_;
  Sweep<Lane> down_, up_;
  Block<char> noted_;  // of both: in one piece the system gives it once for many calls
};

template <class Lane>
void sweep(const SgmJob& job, const Ends& ends, const Workers& workers) {
  if (both_ways(job.settings.paths)) return Meeting<Lane>(job, ends).run(workers);
  // Paths along the rows know nothing of other rows.
  const int bands = job.settings.paths == 2 ? workers.threads : 1;
  parallel_rows(job.pair.height, bands, workers.interrupted, [&](int begin, int end, const Cancel& cancel) {
    Sweep<Lane> down(job, true);
    CostRows<Lane> rows(job);
    RowEnd row_end(job, ends);
    Block<Lane> costs(job.pair.width * job.room);
    Block<uint16_t> sums(job.pair.width * job.room + 2 * kSgmBlock);
    for (int y = begin; y < end && !cancel.load(std::memory_order_relaxed); ++y) {
      rows.make(y, costs.get());
      down.row(y, costs.get(), nullptr, sums.get() + kSgmBlock);
      row_end.row(y, sums.get() + kSgmBlock);
    }
  });
}

void run(const SgmJob& job, const Ends& ends, const Workers& workers) {
  const int highest = job.settings.most + job.settings.largest_p2();
  if (static_cast<int64_t>(job.settings.paths) * highest > kLargestSum) throw std::invalid_argument("sums would not fit 16 bits");
  if (highest + job.first() <= 255)
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

void mgm_sums(const Pair& pair, const uint16_t* costs, const SgmSettings& settings, uint16_t* sums, const Workers& workers) {
  const int H = pair.height, W = pair.width, D = pair.count;
  const size_t pixels = static_cast<size_t>(H) * W;
  parallel_rows(1, 1, workers.interrupted, [&](int, int, const Cancel& cancel) {
    // One direction's costs, with a candidate on either side that nothing steps from.
    const size_t slot = static_cast<size_t>(D) + 2;
    const Block<int32_t> line(pixels * slot), least(pixels);
    std::vector<int32_t> told(D);
    for (int y = 0; y < H && !cancel.load(std::memory_order_relaxed); ++y) {
      std::fill_n(line.get() + static_cast<size_t>(y) * W * slot, W * slot, 1 << 29);
      std::fill_n(sums + static_cast<size_t>(y) * W * D, static_cast<size_t>(W) * D, uint16_t{0});
    }
    int dx = 1, dy = 0;
    for (int turn = 0; turn < settings.paths; ++turn) {
      const Offset before[2] = {{-dx, -dy}, {dy, -dx}};
      // The order in which both pixels before come before: by the rows, or where these do not tell, by the columns.
      const int down = dy + dx, right = dx - dy;
      const bool rows_first = down != 0;
      const int outer = rows_first ? H : W, inner = rows_first ? W : H;
      for (int o = 0; o < outer && !cancel.load(std::memory_order_relaxed); ++o)
        for (int n = 0; n < inner; ++n) {
          const int y = rows_first ? (down > 0 ? o : H - 1 - o) : n;
          const int x = rows_first ? (right >= 0 ? n : W - 1 - n) : (right > 0 ? o : W - 1 - o);
          const size_t at = static_cast<size_t>(y) * W + x;
          int32_t* const here = line.get() + at * slot + 1;
          int tellers = 0;
          for (const Offset& offset : before) {
            const int v = y + offset.dy, u = x + offset.dx;
            if (v < 0 || v >= H || u < 0 || u >= W) continue;
            const size_t there = static_cast<size_t>(v) * W + u;
            const int32_t* const from = line.get() + there * slot + 1;
            const int32_t m = least.get()[there], first = settings.p1;
            const int32_t limit = m + settings.p2[settings.guide ? std::abs(settings.guide[at] - settings.guide[there]) : 0];
            for (int i = 0; i < D; ++i) {
              const int32_t best = std::min(std::min(from[i], std::min(from[i - 1], from[i + 1]) + first), limit) - m;
              told[i] = tellers ? told[i] + best : best;
            }
            ++tellers;
          }
          int32_t lowest = 1 << 29;
          for (int i = 0; i < D; ++i) {
            here[i] = costs[at * D + i] + (tellers == 2 ? told[i] >> 1 : tellers ? told[i] : 0);
            lowest = std::min(lowest, here[i]);
            sums[at * D + i] = static_cast<uint16_t>(sums[at * D + i] + here[i]);
          }
          least.get()[at] = lowest;
        }
      // A quarter turn; after four of them, on to the diagonals.
      const int turned = dx;
      dx = -dy, dy = turned;
      if (turn == 3) dx = 1, dy = 1;
    }
  });
}

void hide_out_of_view(const Pair& pair, uint16_t* sums, int32_t* beyond, const SgmKernels& kernels, const Workers& workers) {
  parallel_rows(pair.height, workers.threads, workers.interrupted, [&](int begin, int end, const Cancel& cancel) {
    for (int y = begin; y < end && !cancel.load(std::memory_order_relaxed); ++y)
      for (int x = 0; x < pair.width; ++x) {
        const size_t at = static_cast<size_t>(y) * pair.width + x;
        const int highest = x - pair.first;
        const int lo = std::clamp(highest - (pair.width - 1), 0, pair.count), hi = std::clamp(highest + 1, 0, pair.count);
        beyond[at] = kernels.hide(sums + at * pair.count, lo, hi, pair.count).index;
      }
  });
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
