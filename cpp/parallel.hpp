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

// Calls work(begin, end, cancel) for `threads` bands of [0, rows), one thread a band, while this thread asks
// `interrupted` every few hundredths of a second. Throws what a band threw, or Interrupted.
template <class Work, class Asked>
void parallel_rows(int rows, int threads, Asked interrupted, Work work) {
  const int bands = std::max(1, std::min(threads, rows));
  Cancel cancel{false};
  std::mutex mutex;
  std::condition_variable finished;
  int running = bands;
  std::exception_ptr error;
  const auto band = [&](int k) {
    const int begin = static_cast<int>(static_cast<int64_t>(rows) * k / bands);
    const int end = static_cast<int>(static_cast<int64_t>(rows) * (k + 1) / bands);
    std::exception_ptr thrown;
    try {
      work(begin, end, cancel);
    } catch (...) {
      thrown = std::current_exception();
      cancel.store(true);
    }
    const std::lock_guard<std::mutex> lock(mutex);
    if (thrown && !error) error = thrown;
    if (--running == 0) finished.notify_one();
  };
  std::vector<std::thread> workers;
  workers.reserve(bands);
  try {
    for (int k = 0; k < bands; ++k) workers.emplace_back(band, k);
  } catch (...) {
    // No more threads to be had: end those that started, then say so.
    cancel.store(true);
    for (auto& worker : workers) worker.join();
    throw;
  }
  bool stop = false;
  {
    std::unique_lock<std::mutex> lock(mutex);
    while (!finished.wait_for(lock, std::chrono::milliseconds(50), [&] { return running == 0; })) {
      lock.unlock();
      if (!stop && interrupted()) {
        stop = true;
        cancel.store(true);
      }
      lock.lock();
    }
  }
  for (auto& worker : workers) worker.join();
  if (stop) throw Interrupted();
  if (error) std::rethrow_exception(error);
}

// The same of work that takes about a fifth of a millisecond for every `grain` of its `pixels`: with only as many threads as
// pay, and at once where one is enough for so little that nobody would want to stop it.
template <class Asked, class Work>
void quick_rows(int rows, int64_t pixels, int64_t grain, int threads, Asked interrupted, Work work) {
  const auto paying = static_cast<int>(std::min<int64_t>(threads, pixels / grain));
  if (paying > 1 || pixels >= 50 * grain) return parallel_rows(rows, std::max(1, paying), interrupted, work);
  const Cancel never{false};
  work(0, rows, never);
}

}  // namespace stereopsis
