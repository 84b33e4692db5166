#include "client/src/fallback.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <cstddef>
#include <cstdint>
#include <utility>

#include "proto/wire/text.hpp"

namespace shearbus {
namespace {

constexpr std::chrono::milliseconds kLook{1'000};  // deadline of a step that looks whether the server is back

// The outcome of rows that the host's law has answered.
void flag(const shearbus_request& request) {
  for (std::size_t i = 0; i < request.n_outputs; ++i) {
    const shearbus_output& output = request.outputs[i];
    if (output.field != SHEARBUS_OUTCOME) continue;
    auto* at = static_cast<std::uint8_t*>(output.values);
    for (std::size_t row = 0; row < request.n; ++row, at += output.stride_bytes == 0 ? 1 : output.stride_bytes)
      *at = SHEARBUS_OUTCOME_FALLBACK;
  }
}

}  // namespace

std::optional<std::chrono::milliseconds> fallback_patience(const std::string& text) {
  if (text.empty()) return {};
  constexpr double kLongest = 1e7;
  double seconds = 0.0;
  const auto read = std::from_chars(text.data(), text.data() + text.size(), seconds);
  if (read.ec != std::errc() || read.ptr != text.data() + text.size() || !(seconds >= 1e-3 && seconds <= kLongest))
    throw Error({.code = Code::kInvalidValue,
                 .text = fmt::format("SHEARBUS_FALLBACK is \"{}\", expected a time of 0.001 to {} s",
                                     wire::printable(text, 64), kLongest),
                 .remedy = "Give the time in seconds after which the host's own law answers, or unset the variable.",
                 .field = "SHEARBUS_FALLBACK"});
  return std::chrono::milliseconds(static_cast<std::int64_t>(seconds * 1e3));
}

bool Fallback::is_gone(Code code) {
  return code == Code::kUnreachable || code == Code::kUnknownOutcome || code == Code::kShuttingDown;
}

std::chrono::milliseconds Fallback::deadline() const {
  return away_ ? std::min(patience_, kLook) : patience_;
}

std::string Fallback::answer(const shearbus_request& request, const wire::Status& fault,
                             std::optional<StepInDoubt> doubt, shearbus_result* result) {
  if (law_(user_, &request) != 0) throw Error(fault);
  flag(request);
  std::string line;
  if (!std::exchange(away_, true)) {
    before_ = totals_;
    ++totals_.absences;
    fault_ = fault;
    line = fmt::format("fallback: {}the host's own law answers instead of the server: {}",
                       request.step == 0 ? "" : fmt::format("from step {} on ", request.step), fault.text);
  }
  if (doubt) doubt_ = std::move(doubt);
  if (!waits()) next_look_ = Clock::now() + patience_;
  ++totals_.steps;
  totals_.node_steps += request.n;
  totals_.time_s += request.dt_s;
  if (result != nullptr) {
    shearbus_result answered = SHEARBUS_RESULT_INIT;
    answered.size = result->size;
    answered.nodes = answered.flagged_nodes = request.n;
    *result = answered;
  }
  return line;
}

std::string Fallback::came_back() {
  if (!std::exchange(away_, false)) return {};
  return fmt::format(
      "fallback: the server answers again; the host's own law has answered {} steps, {:g} s, in which no layer has "
      "heated or cooled",
      totals_.steps - before_.steps, totals_.time_s - before_.time_s);
}

std::string Fallback::summary() {
  if (std::exchange(told_, totals_.steps) == totals_.steps) return {};
  return fmt::format(
      "fallback: of this session the host's own law answered {} steps, {:g} s, {} node-steps, in {} absences of the "
      "server",
      totals_.steps, totals_.time_s, totals_.node_steps, totals_.absences);
}

}  // namespace shearbus
