// Threads that wait for the next piece of work, as to start one takes as long as many a piece.
#pragma once

#include <atomic>
#include <chrono>
#include <condition_variable>
#include <functional>
#include <mutex>
#include <thread>
#include <vector>

namespace stereopsis {

// How often whoever waits for others asks whether the answer is still wanted.
constexpr std::chrono::milliseconds kPatience{50};
// For how long a thread waits awake: to sleep, and to be woken, takes longer than most waits.
constexpr std::chrono::microseconds kSoon{500};

// The helpers of one thread, which alone may use it; they end with it. What all of them share is changed under `mutex_` alone.
class Crew {
 public:
  // Does the k-th band; `own` on the thread whose crew it is. Throws nothing.
  using Band = std::function<void(int k, bool own)>;

  Crew() = default;
  ~Crew();
  Crew(const Crew&) = delete;
  Crew& operator=(const Crew&) = delete;

  // Has every band done once, and returns when all have ended; meanwhile calls `ask` every kPatience, if it has to wait for
  // long, which throws nothing either. There is a thread for each band, this one included, so that bands may wait for one
  // another; whoever is free does the next. Throws where the system has no more threads, before any band has begun.
  void run(int bands, const Band& band, const std::function<void()>& ask);

 private:
  void help();
  bool any_open() const { return first_ < end_; }
  // Does a band that nobody has begun: the owner the last one, a helper the first one, so that in piece after piece of work
  // each finds what it has in its cache. `lock` is open meanwhile.
  void take(std::unique_lock<std::mutex>& lock, bool own);

  std::mutex mutex_;
  std::condition_variable wanted_, done_;
  const Band* band_ = nullptr;
  // Bands from first_ to end_ - 1 nobody has begun; so many have not ended. Read without the lock only to wait awake.
  std::atomic<int> first_{0}, end_{0}, running_{0};
  std::atomic<bool> ended_{false};
  std::vector<std::thread> helpers_;
};

// The crew that the calling thread has at hand, or null.
Crew* crew_at_hand();

// While it exists the calling thread has another one, or none, at hand.
class AtHand {
 public:
  explicit AtHand(Crew* crew);
  ~AtHand();
  AtHand(const AtHand&) = delete;
  AtHand& operator=(const AtHand&) = delete;

 private:
  Crew* const before_;
};

}  // namespace stereopsis
