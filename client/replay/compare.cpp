#include "client/replay/compare.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <utility>
#include <variant>
#include <vector>

#include "client/replay/log.hpp"
#include "client/replay/python_part.hpp"
#include "client/replay/table.hpp"
#include "client/src/connection.hpp"
#include "proto/program/python.hpp"
#include "proto/wire/columns.hpp"
#include "proto/wire/units.hpp"

namespace shearbus::replay {
namespace {

namespace fs = std::filesystem;

bool same(double a, double b, double rtol) {
  if (std::bit_cast<std::uint64_t>(a) == std::bit_cast<std::uint64_t>(b)) return true;
  return rtol > 0 && std::abs(a - b) <= rtol * std::max(std::abs(a), std::abs(b));
}

double value_at(const wire::Batch& batch, const wire::Column& column, std::size_t row) {
  switch (column.element) {
    case wire::Element::kFloat64:
      return batch.f64(column.field, column.component)[row];
    case wire::Element::kUint8:
      return batch.u8(column.field, column.component)[row];
    default:
      return 0.0;
  }
}

// A step's first difference, and how many values differ.
struct Found {
  std::string first;
  std::size_t differing = 0;
  std::size_t values = 0;

  std::optional<std::string> text() const {
    if (differing == 0) return std::nullopt;
    return fmt::format("{} ({} of {} values of the step differ)", first, differing, values);
  }
};

void add_value(Found& found, const std::string& quantity, std::uint64_t node, double a, double b, const Names& names,
               double rtol) {
  ++found.values;
  if (same(a, b, rtol)) return;
  if (found.differing++ == 0)
    found.first = fmt::format("{} of node {} is {} in {}, {} in {}", quantity, node, a, names.a, b, names.b);
}

// ---- event logs ----

bool compare_logs(const fs::path& file_a, const fs::path& file_b, const Names& names, double rtol) {
  Log a(file_a);
  Log b(file_b);
  NodeOrder order;
  std::uint64_t steps = 0;
  std::uint64_t exchanges = 0;
  for (;; ++exchanges) {
    const bool more_a = a.next();
    const bool more_b = b.next();
    if (!more_a || !more_b) {
      if (more_a == more_b) break;
      const Log& longer = more_a ? a : b;
      fmt::print("{} goes on with {}; {} ends after {} requests, equal until there\n", more_a ? names.a : names.b,
                 place_of(longer.request(), steps), more_a ? names.b : names.a, exchanges);
      return false;
    }
    const std::string place = place_of(a.request(), steps);
    const auto differ = [&](const std::string& what) {
      fmt::print("{}: {}\n", place, what);
      return false;
    };
    if (a.request().body.index() != b.request().body.index())
      return differ(fmt::format("{} in {}, {} in {}", verb_of(a.request()), names.a, verb_of(b.request()), names.b));
    const auto* step_a = std::get_if<wire::Downscale>(&a.request().body);
    const auto* step_b = std::get_if<wire::Downscale>(&b.request().body);
    if (step_a != nullptr && !same(step_a->dt_s, step_b->dt_s, rtol))
      return differ(fmt::format("request, dt is {} s in {}, {} s in {}", step_a->dt_s, names.a, step_b->dt_s, names.b));
    if (step_a != nullptr && (step_a->mode != step_b->mode || step_a->commit_previous != step_b->commit_previous))
      return differ("one is a trial or commits another, the other is not");
    const auto rows_a = order.rows_of(a.request());
    if (const auto what = difference(a.request().batch, b.request().batch, rows_a, names, rtol))
      return differ("request, " + *what);
    if (const auto what = difference(a.reply(), b.reply(), rows_a, names, rtol)) return differ("answer, " + *what);
    if (step_a != nullptr) ++steps;
    order.follow(a.request(), a.reply());
  }
  fmt::print("equal: {} requests, {} of them steps\n", exchanges, steps);
  return true;
}

// ---- tables ----

// Python compares two tables; what it reads of a file in HDF5 is checked before.
[[noreturn]] void compare_tables(const fs::path& file_a, const fs::path& file_b, double rtol) {
  std::vector<std::string> command = {program::script("replay", "tables.py"), "compare",
                                      fmt::format("--rtol={}", rtol)};
  for (const fs::path& file : {file_a, file_b}) {
    command.push_back(is_text(file) ? "--kind=text" : "--kind=hdf5");
    if (is_text(file)) continue;
    Table table(file, {});
    std::vector<double> row(table.nodes());
    for (const auto& [name, column] : wire::quantities())
      if (table.has(name) && is_per_node(column->field))
        table.per_node(name);
      else if (table.has(name))
        table.row(name, 0, row);
  }
  command.insert(command.end(), {"--", file_a, file_b});
  program::become_python(std::move(command));
}

}  // namespace

std::optional<std::string> difference(const wire::Batch& a, const wire::Batch& b, std::span<const std::uint64_t> rows,
                                      const Names& names, double rtol) {
  Found found;
  for (const wire::Column& column : a.columns()) {
    const std::string quantity = wire::quantity_of(column.field, column.component);
    if (!b.has(column.field, column.component)) return fmt::format("{} is in {} only", quantity, names.a);
    const auto other = std::ranges::find_if(b.columns(), [&](const wire::Column& one) {
      return one.field == column.field && one.component == column.component;
    });
    if (other->count != column.count)
      return fmt::format("{} has {} rows in {}, {} in {}", quantity, column.count, names.a, other->count, names.b);
    if (column.element == wire::Element::kUint64) {
      const auto ids_a = a.u64(column.field);
      const auto ids_b = b.u64(column.field);
      for (std::size_t row = 0; row < ids_a.size(); ++row)
        if (ids_a[row] != ids_b[row])
          return fmt::format("row {} is of node {} in {}, of node {} in {}", row, ids_a[row], names.a, ids_b[row],
                             names.b);
      continue;
    }
    for (std::size_t row = 0; row < column.count; ++row)
      add_value(found, quantity, row < rows.size() ? rows[row] : row, value_at(a, column, row),
                value_at(b, *other, row), names, column.element == wire::Element::kFloat64 ? rtol : 0.0);
  }
  for (const wire::Column& column : b.columns())
    if (!a.has(column.field, column.component))
      return fmt::format("{} is in {} only", wire::quantity_of(column.field, column.component), names.b);
  return found.text();
}

std::optional<std::string> difference(const wire::Reply& a, const wire::Reply& b, std::span<const std::uint64_t> rows,
                                      const Names& names, double rtol) {
  if (a.status.code != b.status.code || a.status.field != b.status.field || a.status.node_ids != b.status.node_ids) {
    const auto says = [](const wire::Status& status) { return status.ok() ? "accepted" : describe(status); };
    return fmt::format("{} in {}, {} in {}", says(a.status), names.a, says(b.status), names.b);
  }
  if (auto text = difference(a.batch, b.batch, rows, names, rtol)) return text;
  std::optional<std::string> found;
  const auto count = [&](const char* name, std::uint64_t of_a, std::uint64_t of_b) {
    if (of_a != of_b && !found) found = fmt::format("{} is {} in {}, {} in {}", name, of_a, names.a, of_b, names.b);
  };
  if (a.body.index() != b.body.index()) return "the replies are of different kinds";
  if (const auto* step = std::get_if<wire::Upscale>(&a.body)) {
    const auto& other = std::get<wire::Upscale>(b.body);
    count("state_version", step->state_version, other.state_version);
    count("flagged_nodes", step->flagged_nodes, other.flagged_nodes);
    if (!found && !same(step->largest_closure_m_per_s, other.largest_closure_m_per_s, rtol))
      found = fmt::format("largest_closure_m_per_s is {} in {}, {} in {}", step->largest_closure_m_per_s, names.a,
                          other.largest_closure_m_per_s, names.b);
  } else if (const auto* committed = std::get_if<wire::Committed>(&a.body)) {
    count("state_version", committed->state_version, std::get<wire::Committed>(b.body).state_version);
  } else if (const auto* back = std::get_if<wire::RolledBack>(&a.body)) {
    count("state_version", back->state_version, std::get<wire::RolledBack>(b.body).state_version);
  } else if (const auto* changed = std::get_if<wire::NodesChanged>(&a.body)) {
    count("nodes", changed->nodes, std::get<wire::NodesChanged>(b.body).nodes);
  } else if (const auto* opened = std::get_if<wire::SessionOpened>(&a.body)) {
    const auto& other = std::get<wire::SessionOpened>(b.body);
    if (opened->strategy != other.strategy || opened->reply_columns != other.reply_columns)
      found = "the scenes have different strategies or columns";
  }
  return found;
}

std::string place_of(const wire::Request& request, std::uint64_t steps) {
  if (const auto* step = std::get_if<wire::Downscale>(&request.body))
    return fmt::format("step {} (request {}, ends at {} s)", steps, request.sequence, step->time_s);
  return fmt::format("{} (request {}, after {} steps)", verb_of(request), request.sequence, steps);
}

bool compare(const fs::path& a, const fs::path& b, double rtol) {
  const bool log_a = files::is_event_log(a);
  const bool log_b = files::is_event_log(b);
  const Names names = {.a = a.filename() == b.filename() ? a.string() : a.filename().string(),
                       .b = a.filename() == b.filename() ? b.string() : b.filename().string()};
  if (log_a != log_b)
    throw Error(
        {.code = Code::kInvalidValue,
         .text = fmt::format("{} is an event log and {} is not", (log_a ? a : b).string(), (log_a ? b : a).string()),
         .remedy = "Make a table of the log first: shearbus-replay export LOG --out TABLE.h5"});
  if (!log_a) compare_tables(a, b, rtol);
  return compare_logs(a, b, names, rtol);
}

}  // namespace shearbus::replay
