#include <limits>

#include "parallel.hpp"
#include "stages.hpp"

namespace stereopsis {

namespace {

// What is flagged has no answer. By bits and without a branch, so that it goes as fast as memory does.
void accept_row(const float* disparity, const float* confidence, const uint8_t* flags, int width, float* accepted, float* trust) {
  constexpr float none = std::numeric_limits<float>::quiet_NaN();
  for (int x = 0; x < width; ++x) {
    accepted[x] = flags[x] ? none : disparity[x];
    trust[x] = flags[x] ? 0.0f : confidence[x];
  }
}

}  // namespace

void accept(const float* disparity, const float* confidence, const uint8_t* flags, int height, int width, float* accepted,
            float* trust, const Workers& workers) {
  parallel_rows(height, workers.threads, workers.interrupted, [&](int begin, int end, const Cancel&) {
    for (int y = begin; y < end; ++y) {
      const size_t at = static_cast<size_t>(y) * width;
      accept_row(disparity + at, confidence + at, flags + at, width, accepted + at, trust + at);
    }
  });
}

void judge(const Evidence& seen, const Verdict& verdict, int height, int width, float* smooth, uint8_t* flags, float* accepted,
           float* trust, const Workers& workers) {
  parallel_rows(height, workers.threads, workers.interrupted, [&](int begin, int end, const Cancel&) {
    for (int y = begin; y < end; ++y) {
      const size_t row = static_cast<size_t>(y) * width;
      for (size_t at = row; at < row + width; ++at)
        smooth[at] = smooth[at] < verdict.least ? verdict.least : smooth[at] > verdict.most ? verdict.most : smooth[at];
      for (size_t at = row; seen.winners && at < row + width; ++at) {
        const float off = seen.winners[at] - smooth[at];
        const bool near = (off < verdict.near) & (-off < verdict.near);  // NaN is not
        const uint8_t flag = flags[at], revoked = flag & ~verdict.revocable ? flag : 0, wrong = flag ? flag : verdict.wrong;
        flags[at] = near ? revoked : wrong;
      }
      accept_row(smooth + row, seen.confidence + row, flags + row, width, accepted + row, trust + row);
    }
  });
}

}  // namespace stereopsis
