// Hands the runs of a loop to the threads of a parallel region. In every loop and step a thread begins with the same
// share, which its cache then holds; who has none left takes runs from the end of another's, since one thread does the
// contact beside its share and a zone of one metal costs more than one of another.
#pragma once

#include <omp.h>

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <vector>

namespace shearbus::lagrange {

class Shares {
 public:
  // Divides `count` runs, fewer than 2^32, among the threads that a region may have. Not inside a region.
  void hand_out(std::size_t count) {
    const auto threads = static_cast<std::size_t>(omp_get_max_threads());
    if (shares_.size() != threads) shares_ = std::vector<Share>(threads);
    for (std::size_t t = 0; t < threads; ++t)
      shares_[t].left = Left{t * count / threads, (t + 1) * count / threads}.packed();
  }

  // Calls work(run) for the runs of the calling thread's share until no more than `kept` are left.
  template <class Work>
  void work_own(std::size_t kept, const Work& work) {
    Share& own = shares_[static_cast<std::size_t>(omp_get_thread_num())];
    for (Left left; own.take(kept, 1, 0, left);) work(left.first);
  }

  // Calls work(run) until no thread has runs left.
  template <class Work>
  void work(const Work& work) {
    work_own(0, work);
    const auto self = static_cast<std::size_t>(omp_get_thread_num());
    for (std::size_t next = 1; next < shares_.size(); ++next) {
      Share& other = shares_[(self + next) % shares_.size()];
      for (Left left; other.take(0, 0, 1, left);) work(left.end - 1);
    }
  }

 private:
  struct Left {  // the runs [first, end), in one word that threads exchange
    std::size_t first = 0, end = 0;
    std::uint64_t packed() const { return first << 32 | end; }
  };
  struct alignas(64) Share {
    std::atomic<std::uint64_t> left{0};

    // Takes runs off both ends. Returns false if no more than `kept` are left, else what was left before.
    bool take(std::size_t kept, std::size_t off_first, std::size_t off_end, Left& before) {
      std::uint64_t now = left.load(std::memory_order_relaxed);
      do {
        before = {now >> 32, now & 0xffffffff};
        if (before.end - before.first <= kept) return false;
      } while (!left.compare_exchange_weak(now, Left{before.first + off_first, before.end - off_end}.packed(),
                                           std::memory_order_relaxed));
      return true;
    }
  };

  std::vector<Share> shares_;
};

}  // namespace shearbus::lagrange
