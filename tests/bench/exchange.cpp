// shearbus-bench-exchange KIND NODES STEPS makes steps for a counter of instructions (instructions.py), in one thread
// and without a socket. KIND is `service`, `embedded` or `shard` (exchange.hpp).
#include "tests/bench/exchange.hpp"

#include <cstdio>
#include <string_view>

namespace {

template <class By>
void make_steps(const char* nodes, const char* steps) {
  By by(shearbus::support::node_ids(static_cast<std::size_t>(std::atoi(nodes))));
  for (int step = std::atoi(steps); step > 0; --step) by.step();
}

}  // namespace

int main(int argc, char** argv) {
  if (argc != 4) {
    std::fprintf(stderr, "usage: shearbus-bench-exchange service|embedded|shard NODES STEPS\n");
    return 2;
  }
  if (!__builtin_cpu_supports("avx2")) return 77;
  const std::string_view kind = argv[1];
  (kind == "service"    ? make_steps<shearbus::bench::ByService>
   : kind == "embedded" ? make_steps<shearbus::bench::Embedded>
                        : make_steps<shearbus::bench::ByShard>)(argv[2], argv[3]);
  return 0;
}
