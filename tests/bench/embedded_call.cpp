// shearbus-bench-embedded-call NODES ROUNDS makes steps by the C interface with a server in this process. Prints as JSON
// the median and the lowest tenth of the times of the calls, less those of the solver; next to them, in turns, those of
// copying the same columns there and back, the least that a call of another library does.
#include <shearbus/shearbus.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <vector>

namespace {

using Clock = std::chrono::steady_clock;

constexpr const char* kScene = R"(name = "call"
strategy = "force_driven"
[soft]
material = "aluminium_dlp"
[hard]
material = "steel_dlp"
[layer]
thickness_m = 20e-6
cells = 1
[interface]
friction_coefficient = 0.3
yield_strength_pa = 200e6
)";

double since(Clock::time_point started) {
  return std::chrono::duration<double, std::micro>(Clock::now() - started).count();
}

void print(const char* name, std::vector<double>& us, const char* end) {
  std::sort(us.begin(), us.end());
  std::printf("\"%s\": {\"median_us\": %.3f, \"lowest_tenth_us\": %.3f}%s", name, us[us.size() / 2], us[us.size() / 10],
              end);
}

[[noreturn]] void fail(const shearbus_status& status) {
  std::fprintf(stderr, "shearbus-bench-embedded-call: %s\n", status.text);
  std::exit(1);
}

}  // namespace

int main(int argc, char** argv) {
  if (argc != 3) {
    std::fprintf(stderr, "usage: shearbus-bench-embedded-call NODES ROUNDS\n");
    return 2;
  }
  const std::size_t nodes = std::strtoul(argv[1], nullptr, 10);
  std::vector<std::uint64_t> ids(nodes);
  for (std::size_t i = 0; i < nodes; ++i) ids[i] = i;
  shearbus_options options = SHEARBUS_OPTIONS_INIT;
  options.endpoint = "embedded";
  options.scene_text = kScene;
  options.check_closure = SHEARBUS_CHECK_OFF;
  shearbus_session* session = nullptr;
  shearbus_status status = SHEARBUS_STATUS_INIT;
  if (shearbus_open(&session, &options, nodes, ids.data(), nullptr, &status) != 0) fail(status);

  constexpr std::array kInputs = {std::pair{SHEARBUS_VELOCITY_JUMP, 100.0}, std::pair{SHEARBUS_PRESSURE, 5e9},
                                  std::pair{SHEARBUS_STRESS_SOFT, 1e8},     std::pair{SHEARBUS_STRESS_HARD, 2e8},
                                  std::pair{SHEARBUS_MASS_SOFT, 0.0135},    std::pair{SHEARBUS_MASS_HARD, 0.0395}};
  constexpr std::array kOutputs = {SHEARBUS_SHEAR_STRESS, SHEARBUS_SLIDING_VELOCITY, SHEARBUS_INTERFACE_TEMPERATURE,
                                   SHEARBUS_VELOCITY_JUMP_NEW, SHEARBUS_FRICTION_HEAT};
  std::vector<std::vector<double>> in, out(kOutputs.size(), std::vector<double>(nodes));
  std::vector<shearbus_input> inputs;
  std::vector<shearbus_output> outputs;
  for (const auto& [field, value] : kInputs) in.emplace_back(nodes, value);
  for (std::size_t i = 0; i < kInputs.size(); ++i)
    inputs.push_back({static_cast<std::uint32_t>(kInputs[i].first), 0, in[i].data(), 0});
  for (std::size_t i = 0; i < kOutputs.size(); ++i)
    outputs.push_back({static_cast<std::uint32_t>(kOutputs[i]), 0, out[i].data(), 0});
  shearbus_request step = SHEARBUS_REQUEST_INIT;
  step.dt_s = 1e-9;
  step.n = nodes;
  step.inputs = inputs.data();
  step.n_inputs = inputs.size();
  step.outputs = outputs.data();
  step.n_outputs = outputs.size();

  auto there = in;
  auto back = out;
  std::vector<double> calls, copies;
  for (int round = std::atoi(argv[2]); round > 0; --round) {
    auto started = Clock::now();
    for (std::size_t i = 0; i < in.size(); ++i) std::memcpy(there[i].data(), in[i].data(), nodes * sizeof(double));
    for (std::size_t i = 0; i < out.size(); ++i) std::memcpy(back[i].data(), out[i].data(), nodes * sizeof(double));
    copies.push_back(since(started));
    shearbus_result result = SHEARBUS_RESULT_INIT;
    started = Clock::now();
    if (shearbus_step(session, &step, &result, &status) != 0) fail(status);
    calls.push_back(since(started) - 1e-3 * static_cast<double>(result.solver_ns));
  }
  std::printf("{");
  print("call", calls, ", ");
  print("copy", copies, "}\n");
  return shearbus_close(&session, nullptr);
}
