// Histograms of the service's run time and counters of its refusals. Adding a time is a bit scan and two additions,
// without allocation. The same thread adds and reads.
#pragma once

#include <algorithm>
#include <array>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <utility>
#include <variant>

#include "proto/wire/messages.hpp"

namespace shearbus::service {

class Histogram {
 public:
  static constexpr std::size_t kBuckets = 28;  // number of buckets; the last one begins at 69 s

  void add(std::uint64_t ns) {
    const auto bucket = static_cast<std::size_t>(std::bit_width(ns / wire::kHistogramBaseNs));
    ++counts_[std::min(bucket, kBuckets - 1)];
    sum_ns_ += ns;
  }
  bool empty() const {
    return std::all_of(counts_.begin(), counts_.end(), [](std::uint64_t count) { return count == 0; });
  }
  wire::Histogram on_wire(const char* name, const char* verb = "") const {
    return {.name = name, .verb = verb, .counts = {counts_.begin(), counts_.end()}, .sum_ns = sum_ns_};
  }

 private:
  std::array<std::uint64_t, kBuckets> counts_{};
  std::uint64_t sum_ns_ = 0;
};

struct Metrics {
  static constexpr std::size_t kVerbs = std::variant_size_v<decltype(wire::Request::body)>;
  static constexpr std::size_t kCodes = 500;  // number of counters, for the codes 0 to 499

  std::array<Histogram, kVerbs> requests;  // time from arrival to answer, by index of the body in wire::Request
  Histogram solver;
  Histogram journal_append;
  Histogram journal_sync;
  Histogram checkpoint;
  std::array<std::uint64_t, kCodes> refusals{};  // number of refusals, by code

  void put_into(wire::ServerStatus& status) const;
};

// Keeps the longest of the times between its construction and its end.
class Longest {
 public:
  using Clock = std::function<std::uint64_t()>;  // may be empty: then nothing is measured

  Longest(const Clock& now_ns, std::uint64_t& longest_ns)
      : now_ns_(now_ns), longest_ns_(longest_ns), begun_ns_(now_ns ? now_ns() : 0) {}
  Longest(const Longest&) = delete;
  Longest& operator=(const Longest&) = delete;
  ~Longest() {
    if (now_ns_) longest_ns_ = std::max(longest_ns_, now_ns_() - begun_ns_);
  }

 private:
  const Clock& now_ns_;
  std::uint64_t& longest_ns_;
  std::uint64_t begun_ns_;
};

// Runs `act` and adds its time to the histogram, also if it throws.
template <typename Clock, typename Act>
auto timed(const Clock& now_ns, Histogram& histogram, Act act) {
  struct Lap {
    const Clock& clock;
    Histogram& histogram;
    std::uint64_t started_ns;
    ~Lap() { histogram.add(clock() - started_ns); }
  } const lap{now_ns, histogram, now_ns()};
  return act();
}

}  // namespace shearbus::service
