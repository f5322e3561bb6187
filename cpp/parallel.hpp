// Splits rows over threads, and lets the calling thread stop them.
#pragma once

#include <algorithm>
#include <atomic>
#include <exception>
#include <mutex>
#include <thread>
#include <vector>

#include "crew.hpp"
#include "fused.hpp"

namespace stereopsis {

struct Interrupted : std::exception {
  const char* what() const noexcept override { return "interrupted"; }
};

inline int resolve_threads(int threads) {
  if (threads > 0) return threads;
  const unsigned cores = std::thread::hardware_concurrency();
  return cores ? static_cast<int>(cores) : 1;
}

// Asks `interrupted`, which says itself how often it looks, and cancels all work once it says so.
template <class Asked>
class Asking {
 public:
  Asking(Asked& interrupted, std::atomic<bool>& cancelled) : interrupted_(interrupted), cancelled_(cancelled) {}
  bool ask() {
    if (stopped_) return true;
    stopped_ = interrupted_();
    if (stopped_) cancelled_.store(true);
    return stopped_;
  }
  bool stopped() const { return stopped_; }
  Cancel cancel() {
    return Cancel(cancelled_, [](void* self) { return static_cast<Asking*>(self)->ask(); }, this);
  }

 private:
  Asked& interrupted_;
  std::atomic<bool>& cancelled_;
  bool stopped_ = false;
};

// Calls work(begin, end, cancel) for `threads` bands of [0, rows), one thread a band, of which this is one. It asks
// `interrupted` when a band of its own asks `cancel`, and while it waits for the others. The threads are those of the crew at
// hand, or start and end here. Throws what a band threw, or Interrupted.
template <class Work, class Asked>
void parallel_rows(int rows, int threads, Asked interrupted, Work work) {
  const int bands = std::max(1, std::min(threads, rows));
  std::atomic<bool> cancelled{false};
  Asking asking(interrupted, cancelled);
  std::mutex mutex;
  std::exception_ptr error;
  const auto band = [&](int k, bool own) {
    const int begin = static_cast<int>(static_cast<int64_t>(rows) * k / bands);
    const int end = static_cast<int>(static_cast<int64_t>(rows) * (k + 1) / bands);
    try {
      if (!cancelled) work(begin, end, own ? asking.cancel() : Cancel(cancelled));
    } catch (...) {
      const std::lock_guard<std::mutex> lock(mutex);
      if (!error) error = std::current_exception();
      cancelled.store(true);
    }
  };
  Crew* const crew = crew_at_hand();
  const AtHand busy(nullptr);  // what a band has done by several threads needs others
  if (bands == 1)
    band(0, true);
  else if (crew)
    crew->run(bands, band, [&] { asking.ask(); });
  else
    Crew().run(bands, band, [&] { asking.ask(); });
  if (asking.stopped()) throw Interrupted();
  if (error) std::rethrow_exception(error);
}

// The same in bands of so many rows, which whatever thread is free takes: for rows that take unequal time.
template <class Work, class Asked>
void parallel_bands(int rows, int band, int threads, Asked interrupted, Work work) {
  const int bands = (rows + band - 1) / band;
  std::atomic<int> next{0};
  parallel_rows(std::min(threads, bands), threads, interrupted, [&](int, int, const Cancel& cancel) {
    for (int k = next++; k < bands && !cancel.load(std::memory_order_relaxed); k = next++)
      work(k * band, std::min(rows, (k + 1) * band), cancel);
  });
}

// How many threads pay for work that takes about a fifth of a millisecond for every `grain` of its `pixels`. With a crew at hand
// a sixteenth of what pays for threads that have to start does.
inline int paying_threads(int64_t pixels, int64_t grain, int threads) {
  const int64_t paying = pixels / (crew_at_hand() ? std::max<int64_t>(1, grain / 16) : grain);
  return static_cast<int>(std::max<int64_t>(1, std::min<int64_t>(threads, paying)));
}

// The same as `parallel_rows`, and as `parallel_bands` of a quarter of a thread's rows, with only as many threads as pay.
template <class Asked, class Work>
void quick_rows(int rows, int64_t pixels, int64_t grain, int threads, Asked interrupted, Work work) {
  parallel_rows(rows, paying_threads(pixels, grain, threads), interrupted, work);
}
template <class Asked, class Work>
void quick_bands(int rows, int64_t pixels, int64_t grain, int threads, Asked interrupted, Work work) {
  const int paying = paying_threads(pixels, grain, threads);
  parallel_bands(rows, std::max(1, rows / (4 * paying)), paying, interrupted, work);
}

}  // namespace stereopsis
