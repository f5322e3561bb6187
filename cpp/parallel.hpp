// Splits rows over threads, and lets the calling thread stop them.
#pragma once

#include <algorithm>
#include <atomic>
#include <chrono>
#include <condition_variable>
#include <exception>
#include <mutex>
#include <thread>
#include <vector>

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

constexpr std::chrono::milliseconds kPatience{50};
constexpr std::chrono::microseconds kSoon{200};

// Asks `interrupted` twenty times a second, and cancels all work once it says so.
template <class Asked>
class Asking {
 public:
  Asking(Asked& interrupted, std::atomic<bool>& cancelled) : interrupted_(interrupted), cancelled_(cancelled) {}
  bool ask() {
    if (stopped_ || Clock::now() < next_) return stopped_;
    stopped_ = interrupted_();
    if (stopped_) cancelled_.store(true);
    next_ = Clock::now() + kPatience;
    return stopped_;
  }
  bool stopped() const { return stopped_; }
  Cancel cancel() {
    return Cancel(cancelled_, [](void* self) { return static_cast<Asking*>(self)->ask(); }, this);
  }

 private:
  using Clock = std::chrono::steady_clock;
  Asked& interrupted_;
  std::atomic<bool>& cancelled_;
  Clock::time_point next_ = Clock::now() + kPatience;
  bool stopped_ = false;
};

// Calls work(begin, end, cancel) for `threads` bands of [0, rows), one thread a band; the last is this one's, as to start a
// thread takes as long as many a band. It asks `interrupted` when its band asks `cancel`, and while it waits for the others.
// Throws what a band threw, or Interrupted.
template <class Work, class Asked>
void parallel_rows(int rows, int threads, Asked interrupted, Work work) {
  const int bands = std::max(1, std::min(threads, rows));
  std::atomic<bool> cancelled{false};
  Asking asking(interrupted, cancelled);
  std::mutex mutex;
  std::condition_variable finished;
  std::atomic<int> running{bands};
  std::exception_ptr error;
  const auto band = [&](int k, const Cancel& cancel) {
    const int begin = static_cast<int>(static_cast<int64_t>(rows) * k / bands);
    const int end = static_cast<int>(static_cast<int64_t>(rows) * (k + 1) / bands);
    std::exception_ptr thrown;
    try {
      work(begin, end, cancel);
    } catch (...) {
      thrown = std::current_exception();
      cancelled.store(true);
    }
    const std::lock_guard<std::mutex> lock(mutex);
    if (thrown && !error) error = thrown;
    if (--running == 0) finished.notify_one();
  };
  std::vector<std::thread> workers;
  workers.reserve(bands - 1);
  try {
    for (int k = 0; k + 1 < bands; ++k) workers.emplace_back([&band, &cancelled, k] { band(k, Cancel(cancelled)); });
  } catch (...) {
    // No more threads to be had: end those that started, then say so.
    cancelled.store(true);
    for (auto& worker : workers) worker.join();
    throw;
  }
  band(bands - 1, asking.cancel());
  // The others are about to end as well: to sleep, and to be woken, takes longer than most waits.
  const auto soon = std::chrono::steady_clock::now() + kSoon;
  while (running > 0 && std::chrono::steady_clock::now() < soon) std::this_thread::yield();
  {
    std::unique_lock<std::mutex> lock(mutex);
    while (!finished.wait_for(lock, kPatience, [&] { return running == 0; })) {
      lock.unlock();
      asking.ask();
      lock.lock();
    }
  }
  for (auto& worker : workers) worker.join();
  if (asking.stopped()) throw Interrupted();
  if (error) std::rethrow_exception(error);
}

// The same of work that takes about a fifth of a millisecond for every `grain` of its `pixels`: with only as many threads as pay.
template <class Asked, class Work>
void quick_rows(int rows, int64_t pixels, int64_t grain, int threads, Asked interrupted, Work work) {
  const int64_t paying = std::min<int64_t>(threads, pixels / grain);
  parallel_rows(rows, static_cast<int>(std::max<int64_t>(1, paying)), interrupted, work);
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

}  // namespace stereopsis
