// Tests the C library when memory runs out. Usage: c_no_memory SCENE.toml ENDPOINT. Each call listed in main() is
// made with the first allocation of the library itself (not of libzmq) failing, then with its second, and so on, until
// no allocation fails. A call that fails must return SHEARBUS_NO_MEMORY. The same call, repeated with enough memory,
// must then succeed: nothing is lost, and no request runs twice.
#include <dlfcn.h>
#include <shearbus/shearbus.h>
#include <unwind.h>

#include <array>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <functional>
#include <new>
#include <vector>

namespace {

long allocations_left = -1;  // number of allocations of the library that still succeed before one fails; -1: none fails
bool looking = false;

void* base_of(void* address) {
  Dl_info info{};
  return dladdr(address, &info) == 0 ? nullptr : info.dli_fbase;
}
void* const library = base_of(reinterpret_cast<void*>(&shearbus_open));
void* const program = base_of(reinterpret_cast<void*>(&base_of));

// Returns true if the shearbus library makes the present allocation, directly or through libstdc++. Allocations of
// other libraries never fail here: libzmq, for instance, ends the process when it finds no memory.
bool asked_by_library() {
  bool ours = false;
  const auto look = [](_Unwind_Context* frame, void* found) {
    Dl_info info{};
    if (dladdr(reinterpret_cast<void*>(_Unwind_GetIP(frame)), &info) == 0) return _URC_END_OF_STACK;
    if (info.dli_fbase == program || std::strstr(info.dli_fname, "libstdc++") != nullptr) return _URC_NO_REASON;
    *static_cast<bool*>(found) = info.dli_fbase == library;
    return _URC_END_OF_STACK;
  };
  _Unwind_Backtrace(look, &ours);
  return ours;
}

}  // namespace

// noinline: if GCC 12 inlined `new` and `delete`, it would warn that free() gets the memory of a `new`.
[[gnu::noinline]] void* operator new(std::size_t size) {
  if (allocations_left >= 0 && !looking) {
    looking = true;
    const bool ours = asked_by_library();
    looking = false;
    if (ours && allocations_left-- == 0) throw std::bad_alloc();
  }
  if (void* memory = std::malloc(size == 0 ? 1 : size)) return memory;
  throw std::bad_alloc();
}
[[gnu::noinline]] void operator delete(void* memory) noexcept {
  std::free(memory);
}
[[gnu::noinline]] void operator delete(void* memory, std::size_t) noexcept {
  std::free(memory);
}

namespace {

int faults = 0;
shearbus_status status = SHEARBUS_STATUS_INIT;

void check(bool is_so, const char* what, long allocation = -1) {
  if (is_so) return;
  ++faults;
  std::fprintf(stderr, "not so at allocation %ld: %s (%s %s)\n", allocation, what, shearbus_code_name(status.code),
               status.text);
}

// Makes the call with its first allocation failing, then its second, and so on, until no allocation fails. After each
// failure the call must succeed with enough memory. `passed()` runs after each success. Returns the number of failures.
long try_all(const char* what, const std::function<int()>& call, const std::function<void()>& passed) {
  for (long allocation = 0; allocation < 2000; ++allocation) {
    allocations_left = allocation;
    int code = call();
    allocations_left = -1;
    const bool failed = code != SHEARBUS_OK;
    if (failed) {
      check(code == SHEARBUS_NO_MEMORY, what, allocation);
      code = call();
      check(code == SHEARBUS_OK, what, allocation);
    }
    passed();
    if (!failed) return allocation;
  }
  check(false, what);
  return 0;
}

constexpr std::size_t kNodes = 3;
using Column = std::array<double, kNodes>;
const std::array<std::uint64_t, kNodes> kIds = {1, 2, 3};

shearbus_session* opened(const shearbus_options& options) {
  shearbus_session* session = nullptr;
  check(shearbus_open(&session, &options, kNodes, kIds.data(), nullptr, &status) == SHEARBUS_OK, "open");
  if (session == nullptr) std::exit(1);
  return session;
}

}  // namespace

int main(int, char** argv) {
  shearbus_options options = SHEARBUS_OPTIONS_INIT;
  options.scene_file = argv[1];
  options.endpoint = argv[2];
  // In a domain every node has one owner. If a failed opening had opened a session, the next opening would be refused.
  options.domain = "c_no_memory";

  shearbus_session* session = nullptr;
  long failures = try_all(
      "open", [&] { return shearbus_open(&session, &options, kNodes, kIds.data(), nullptr, &status); },
      [&] {
        check(shearbus_node_count(session) == kNodes, "the nodes of the session");
        check(shearbus_close(&session, &status) == SHEARBUS_OK, "close");
      });
  check(failures > 20, "an opening allocates");

  const Column jump = {90, 95, 100}, pressure = {2e8, 4e8, 6e8}, stress_soft = {0, 1e6, 2e6}, stress_hard = {0, 0, 1e6},
               mass_soft = {4e-3, 4e-3, 4e-3}, mass_hard = {12e-3, 12e-3, 12e-3};
  const std::array<shearbus_input, 6> inputs = {{{SHEARBUS_VELOCITY_JUMP, 0, jump.data(), 0},
                                                 {SHEARBUS_PRESSURE, 0, pressure.data(), 0},
                                                 {SHEARBUS_STRESS_SOFT, 0, stress_soft.data(), 0},
                                                 {SHEARBUS_STRESS_HARD, 0, stress_hard.data(), 0},
                                                 {SHEARBUS_MASS_SOFT, 0, mass_soft.data(), 0},
                                                 {SHEARBUS_MASS_HARD, 0, mass_hard.data(), 0}}};
  Column found{}, expected{};
  const auto request_of = [&](shearbus_output& output) {
    shearbus_request request = SHEARBUS_REQUEST_INIT;
    request.dt_s = 1e-9;
    request.n = kNodes;
    request.inputs = inputs.data();
    request.n_inputs = inputs.size();
    request.outputs = &output;
    request.n_outputs = 1;
    return request;
  };
  shearbus_output tried_output = {SHEARBUS_INTERFACE_TEMPERATURE, 0, found.data(), 0};
  shearbus_output calm_output = {SHEARBUS_INTERFACE_TEMPERATURE, 0, expected.data(), 0};
  const shearbus_request tried = request_of(tried_output), calm = request_of(calm_output);
  session = opened(options);
  options.domain = nullptr;
  shearbus_session* reference = opened(options);
  options.domain = "c_no_memory";
  const auto same_step = [&] {
    check(shearbus_step(reference, &calm, nullptr, &status) == SHEARBUS_OK && found == expected, "each step runs once");
  };
  failures = try_all(
      "step", [&] { return shearbus_step(session, &tried, nullptr, &status); }, same_step);
  check(failures > 5, "a step allocates");
  bool started = false;
  try_all(
      "start and finish",
      [&] {
        if (!started && shearbus_start(session, &tried, &status) != SHEARBUS_OK) return status.code;
        started = true;
        const int code = shearbus_finish(session, nullptr, &status);
        if (code == SHEARBUS_OK || code == SHEARBUS_NO_MEMORY) started = false;
        return code;
      },
      same_step);

  try_all(
      "mark", [&] { return shearbus_mark(session, "here", &status); }, [] {});
  try_all(
      "rollback_to", [&] { return shearbus_rollback_to(session, "here", &status); },
      [&] { check(shearbus_node_count(session) == kNodes, "the nodes of the mark"); });
  std::uint64_t next = 100;
  try_all(
      "register", [&] { return shearbus_register(session, 1, &next, nullptr, &status); },
      [&] {
        const std::size_t count = shearbus_node_count(session);
        check(count == kNodes + next - 99 && shearbus_node_ids(session)[count - 1] == next,
              "the new node is there once");
        ++next;
      });
  std::uint8_t transfer[SHEARBUS_TRANSFER_BYTES];
  std::size_t count = shearbus_node_count(session);
  const auto take_back = [&] {
    check(shearbus_node_count(session) == count - 1, "the offered node has left");
    check(shearbus_accept(session, transfer, &status) == SHEARBUS_OK, "accept");
  };
  try_all(
      "offer", [&] { return shearbus_offer(session, 1, kIds.data(), transfer, &status); }, take_back);
  const auto offer = [&] {
    check(shearbus_node_count(session) == count, "the accepted node is there once");
    check(shearbus_offer(session, 1, kIds.data(), transfer, &status) == SHEARBUS_OK, "offer");
  };
  offer();
  try_all(
      "accept", [&] { return shearbus_accept(session, transfer, &status); }, offer);
  check(shearbus_accept(session, transfer, &status) == SHEARBUS_OK, "accept");
  std::vector<std::uint64_t> more(200);
  for (std::uint64_t& id : more) id = next++;
  check(shearbus_register(session, more.size(), more.data(), nullptr, &status) == SHEARBUS_OK, "register");
  count = shearbus_node_count(session);
  std::uint64_t gone = 100;
  try_all(
      "retire", [&] { return shearbus_retire(session, 1, &gone, &status); },
      [&] { check(shearbus_node_count(session) == --count && ++gone > 100, "the node has left"); });

  char ticket[SHEARBUS_TICKET_BYTES];
  check(shearbus_ticket(session, ticket, &status) == SHEARBUS_OK, "ticket");
  shearbus_leave(&session);
  try_all(
      "resume", [&] { return shearbus_resume(&session, &options, ticket, &status); },
      [&] {
        check(shearbus_node_count(session) == count, "the nodes of the resumed session");
        shearbus_leave(&session);
      });
  check(shearbus_resume(&session, &options, ticket, &status) == SHEARBUS_OK, "resume");
  check(shearbus_close(&session, &status) == SHEARBUS_OK, "close");
  check(shearbus_close(&reference, &status) == SHEARBUS_OK, "close");
  if (faults == 0) std::printf("the C library survives every allocation that fails\n");
  return faults == 0 ? 0 : 1;
}
