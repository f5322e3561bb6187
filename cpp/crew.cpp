#include "crew.hpp"

#include <utility>

namespace stereopsis {

namespace {

thread_local Crew* at_hand = nullptr;

template <class Condition>
void wait_awake(Condition condition) {
  const auto soon = std::chrono::steady_clock::now() + kSoon;
  while (!condition() && std::chrono::steady_clock::now() < soon) std::this_thread::yield();
}

}  // namespace

Crew::~Crew() {
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    ended_ = true;
  }
  wanted_.notify_all();
  for (auto& helper : helpers_) helper.join();
}

void Crew::run(int bands, const Band& band, const std::function<void()>& ask) {
  while (static_cast<int>(helpers_.size()) + 1 < bands) helpers_.emplace_back([this] { help(); });
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    band_ = &band;
    first_ = 0;
    end_ = running_ = bands;
  }
  wanted_.notify_all();
  {
    std::unique_lock<std::mutex> lock(mutex_);
    while (any_open()) take(lock, true);
  }
  wait_awake([&] { return running_ == 0; });
  std::unique_lock<std::mutex> lock(mutex_);
  while (!done_.wait_for(lock, kPatience, [&] { return running_ == 0; })) {
    lock.unlock();
    ask();
    lock.lock();
  }
}

void Crew::help() {
  for (;;) {
    wait_awake([&] { return any_open() || ended_; });
    std::unique_lock<std::mutex> lock(mutex_);
    wanted_.wait(lock, [&] { return any_open() || ended_; });
    if (ended_) return;
    take(lock, false);
  }
}

void Crew::take(std::unique_lock<std::mutex>& lock, bool own) {
  const int k = own ? --end_ : first_++;
  const Band& band = *band_;
  lock.unlock();
  band(k, own);
  lock.lock();
  if (--running_ == 0) done_.notify_one();
}

Crew* crew_at_hand() { return at_hand; }

AtHand::AtHand(Crew* crew) : before_(std::exchange(at_hand, crew)) {}
AtHand::~AtHand() { at_hand = before_; }

}  // namespace stereopsis
