#include "proto/wire/status.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include "proto/wire/text.hpp"

namespace shearbus::wire {

Status& make_printable(Status& status) {
  for (std::string* text : {&status.text, &status.remedy, &status.field}) *text = printable_lines(*text);
  return status;
}

std::string describe(const Status& status) {
  std::string line = fmt::format("{}: {}", name(status.code), status.text);
  if (!status.node_ids.empty()) line += fmt::format(" [nodes {}]", fmt::join(status.node_ids, ", "));
  if (!status.remedy.empty()) line += (line.ends_with('.') ? " " : ". ") + status.remedy;
  return line;
}

}  // namespace shearbus::wire
