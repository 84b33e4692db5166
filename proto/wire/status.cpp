#include "proto/wire/status.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include "proto/wire/text.hpp"

namespace shearbus::wire {

// Elsewhere than in a scene's faults an end of a line is one of a name, which would forge a second message.
Status& make_printable(Status& status) {
  constexpr std::size_t kAll = std::string::npos;
  status.text = status.code == Code::kInvalidScene ? printable_lines(status.text) : printable(status.text, kAll);
  status.remedy = printable(status.remedy, kAll);
  status.field = printable(status.field, kAll);
  return status;
}

std::string describe(const Status& status) {
  std::string line = fmt::format("{}: {}", name(status.code), status.text);
  if (!status.node_ids.empty()) line += fmt::format(" [nodes {}]", fmt::join(status.node_ids, ", "));
  if (!status.remedy.empty()) {
    const bool goes_on = status.remedy.front() >= 'a' && status.remedy.front() <= 'z';
    line += (line.ends_with('.') || line.ends_with('?') ? " " : goes_on ? "; " : ". ") + status.remedy;
  }
  return line;
}

}  // namespace shearbus::wire
