// Reads histories from CSV files: names and units in the first line or in an option; comma, semicolon or tab between
// the values; decimal point or, where the comma separates nothing, decimal comma.
#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <unordered_map>
#include <utility>
#include <vector>

#include "client/replay/table.hpp"
#include "client/replay/text_lines.hpp"
#include "proto/wire/limits.hpp"
#include "proto/wire/numbers.hpp"
#include "proto/wire/text.hpp"
#include "proto/wire/units.hpp"

namespace shearbus::replay {
namespace {

struct CsvColumn {
  std::string name;  // empty: the column is left out
  double factor = 1.0;
};

// The names that a replay reads, in the order of a table.
const std::vector<std::string>& read_names() {
  static const std::vector<std::string> kNames = [] {
    std::vector<std::string> names = {"time", "dt", "node", "node_id", "pair", "initial_temperature"};
    for (const char* name : {"initial_velocity_jump", "initial_velocity_jump_second"}) names.emplace_back(name);
    for (const auto& [name, column] : wire::quantities())
      if (column->kind == wire::Kind::kInput) names.push_back(name);
    return names;
  }();
  return kNames;
}

// The name that was meant by one that no table has; empty: none is near.
std::string near_name(std::string_view name) {
  std::string lower(name);
  std::ranges::transform(lower, lower.begin(), wire::ascii_lower);
  std::ranges::replace(lower, ' ', '_');
  const std::vector<std::string>& known = read_names();
  constexpr std::size_t kShort = 5;  // of shorter words, most are near to each other
  if (lower.size() < kShort) return std::ranges::find(known, lower) != known.end() ? lower : std::string();
  return std::string(wire::nearest(lower, std::vector<std::string_view>(known.begin(), known.end())));
}

std::string_view trimmed(std::string_view text) {
  constexpr std::string_view kBlank = " \t\r\"";
  const auto first = text.find_first_not_of(kBlank);
  if (first == std::string_view::npos) return {};
  return text.substr(first, text.find_last_not_of(kBlank) - first + 1);
}

std::vector<std::string_view> cells_of(std::string_view line, char separator) {
  std::vector<std::string_view> cells;
  for (;;) {
    const auto end = line.find(separator);
    cells.push_back(trimmed(line.substr(0, end)));
    if (end == std::string_view::npos) return cells;
    line.remove_prefix(end + 1);
  }
}

// "pressure [GPa]", "pressure (GPa)", "pressure_GPa" or, with the mark ':', "pressure:GPa", as name and unit.
std::pair<std::string_view, std::string_view> parts_of(std::string_view cell, char mark) {
  const auto at = mark == ':' ? cell.find(':') : cell.find_first_of("[(");
  if (at != std::string_view::npos) {
    std::string_view unit = trimmed(cell.substr(at + 1));
    if (mark != ':' && !unit.empty()) unit = trimmed(unit.substr(0, unit.size() - 1));
    return {trimmed(cell.substr(0, at)), unit};
  }
  const auto line = cell.rfind('_');
  if (wire::unit_of_quantity(cell) == nullptr && line != std::string_view::npos)
    if (const std::string_view name = cell.substr(0, line);
        wire::unit_of_quantity(name) != nullptr || !near_name(name).empty())
      return {name, cell.substr(line + 1)};
  return {cell, {}};
}

// A ready option for the columns of a first line, with what their names and units are near to.
std::string columns_option(const std::vector<std::string_view>& cells) {
  std::vector<std::string> words;
  for (const std::string_view cell : cells) {
    const auto [name, unit] = parts_of(cell, '[');
    const std::string meant = wire::unit_of_quantity(name) != nullptr ? std::string(name) : near_name(name);
    const char* const si = meant.empty() ? nullptr : wire::unit_of_quantity(meant);
    if (si == nullptr)
      words.emplace_back("-");
    else if (*si == '\0')
      words.push_back(meant);
    else
      words.push_back(fmt::format("{}:{}", meant, wire::factor_to_si(unit, si) ? std::string(unit) : si));
  }
  return fmt::format("--columns {}", fmt::join(words, ","));
}

std::optional<double> number_of(std::string_view text, bool decimal_comma) {
  if (!decimal_comma || text.find(',') == text.npos) return wire::real_of(text);
  if (std::ranges::count(text, ',') > 1 || text.find('.') != text.npos) return std::nullopt;
  std::string copy(text);
  std::ranges::replace(copy, ',', '.');
  return wire::real_of(copy);
}

// An id: digits, or a whole number as other programs write it ("7.0"), which a double holds exactly.
std::optional<std::uint64_t> id_of(std::string_view text, bool decimal_comma) {
  constexpr double kMostExact = 9007199254740992.0;  // 2^53
  if (const auto id = wire::count_of(text)) return id;
  const auto value = number_of(text, decimal_comma);
  if (!value || *value < 0 || *value > kMostExact || *value != std::floor(*value)) return std::nullopt;
  return static_cast<std::uint64_t>(*value);
}

class CsvReader {
 public:
  explicit CsvReader(const std::filesystem::path& file) : file_(file), lines_(file) {}

  MemoryTable read(const std::string& columns) {
    if (!next_line()) refuse("holds no table");
    const bool separator_named = line_.size() == 5 && line_.starts_with("sep=");  // as Excel writes it
    if (separator_named) {
      separator_ = line_[4];
      if (!next_line()) refuse("holds no table");
    }
    for (const char separator : {';', '\t'})
      if (!separator_named && line_.find(separator) != line_.npos) separator_ = separator;
    const bool has_names = !number_of(cells_of(line_, separator_).front(), separator_ != ',');
    if (!columns.empty())
      for (const std::string_view word : cells_of(columns, ',')) columns_.push_back(column_of(word, ':'));
    else if (has_names)
      for (const std::string_view cell : cells_of(line_, separator_)) columns_.push_back(column_of(cell, '['));
    else
      refuse("the first line has no names", "Name the columns: --columns time:us,pressure:GPa,velocity_jump:m/s");
    check_columns(columns.empty());
    if (has_names && !next_line()) refuse("has no rows");
    do read_row();
    while (next_line());
    return made();
  }

 private:
  [[noreturn]] void refuse(const std::string& what, const std::string& remedy = {},
                           const std::string& field = {}) const {
    throw Error({.code = Code::kInvalidValue,
                 .text = number_ == 0 ? fmt::format("{}: {}", file_.string(), what)
                                      : fmt::format("{}, line {}: {}", file_.string(), number_, what),
                 .remedy = remedy,
                 .field = field});
  }
  [[noreturn]] void refuse_row(std::size_t row, const std::string& what, const std::string& remedy,
                               const std::string& field) {
    number_ = row_lines_[row];
    refuse(what, remedy, field);
  }

  // Skips empty lines and comments. Returns false at the end of the file.
  bool next_line() {
    while (lines_.next(line_)) {
      number_ = lines_.number();
      if (const std::string_view text = trimmed(line_); !text.empty() && text.front() != '#') return true;
    }
    return false;
  }

  CsvColumn column_of(std::string_view cell, char mark) const {
    const auto [name, unit] = parts_of(cell, mark);
    const char* const si = wire::unit_of_quantity(name);
    if (si == nullptr && (mark != ':' || name == "-")) return {};
    if (si == nullptr) {
      const std::string meant = near_name(name);
      refuse(fmt::format("--columns names {}, which no step has{}", wire::in_quotes(name),
                         meant.empty() ? "" : fmt::format("; did you mean {}?", meant)),
             "Use names such as time, pressure, velocity_jump, node; - leaves a column out.");
    }
    if (name == "node" || name == "node_id") return {.name = "node_id"};
    if (*si == '\0' && !unit.empty())
      refuse(fmt::format("{} has the unit {}", name, wire::in_quotes(unit)),
             name == "pair" ? "A pair is a name."
                            : "A parameter has the unit of its key in the scene, and is written without.",
             std::string(name));
    if (*si == '\0' || std::string_view(si) == "1") return {.name = std::string(name)};
    if (const auto factor = wire::factor_to_si(unit, si); factor && !unit.empty())
      return {.name = std::string(name), .factor = *factor};
    refuse(unit.empty() ? fmt::format("{} has no unit", name)
                        : fmt::format("{} has the unit {}", name, wire::in_quotes(unit)),
           fmt::format("Write the unit as {0} [{1}], or give it with --columns {0}:{1}; known are {2}.", name, si,
                       wire::known_units(si)),
           std::string(name));
  }

  bool has_column(std::string_view name) const {
    return std::ranges::find(columns_, name, &CsvColumn::name) != columns_.end();
  }

  // `by_names`: the columns were named by the first line, in which a name may be misspelt.
  void check_columns(bool by_names) {
    for (const CsvColumn& column : columns_)
      if (!column.name.empty() && std::ranges::count(columns_, column.name, &CsvColumn::name) > 1)
        refuse(fmt::format("{} stands in two columns", column.name), {}, column.name);
    const auto cells = by_names ? cells_of(line_, separator_) : std::vector<std::string_view>();
    for (std::size_t i = 0; i < cells.size(); ++i) {
      const std::string_view name = parts_of(cells[i], '[').first;
      const std::string meant = columns_[i].name.empty() ? near_name(name) : std::string();
      if (!meant.empty() && !has_column(meant == "node" ? "node_id" : meant))
        refuse(fmt::format("no step has {}; did you mean {}? {}", wire::in_quotes(name), meant, found_names(cells)),
               fmt::format("Rename the column, or say {}, with the units that they have; - leaves a column out.",
                           columns_option(cells)),
               meant);
    }
    if (!has_column("time"))
      refuse(fmt::format("there is no column of the time. {}", found_names(cells)),
             by_names ? fmt::format("Name it \"time [s]\", or put time:s in its place in {}.", columns_option(cells))
                      : "Put time:s in its place in --columns.",
             "time");
    values_.resize(columns_.size());
  }

  static std::string found_names(const std::vector<std::string_view>& cells) {
    constexpr std::size_t kMost = 40;
    std::vector<std::string> names;
    for (const std::string_view cell : cells)
      if (names.size() < kMost) names.push_back(wire::in_quotes(cell));
    if (cells.size() > kMost) names.push_back(fmt::format("and {} more", cells.size() - kMost));
    return names.empty() ? "" : fmt::format("The first line has {}", fmt::join(names, ", "));
  }

  // A table has one decimal sign.
  void check_decimal_sign(std::string_view cell) {
    const auto at = cell.find_first_of(".,");
    if (separator_ == ',' || at == std::string_view::npos) return;
    if (decimal_ == 0) {
      decimal_ = cell[at];
      decimal_line_ = number_;
    }
    if (cell[at] != decimal_)
      refuse(fmt::format("{} has a decimal {}, line {} a decimal {}", wire::in_quotes(cell),
                         cell[at] == ',' ? "comma" : "point", decimal_line_, decimal_ == ',' ? "comma" : "point"),
             "Write all numbers with one decimal sign, and none with a sign between thousands.");
  }

  void read_row() {
    const auto cells = cells_of(line_, separator_);
    if (cells.size() != columns_.size())
      refuse(fmt::format("{} values, expected {} as there are columns", cells.size(), columns_.size()),
             separator_ == ',' ? "With a decimal comma the values are separated by ; or tabs." : "");
    if (row_lines_.size() == kMostRows)
      refuse(fmt::format("more than {} rows", kMostRows), "Write the table as HDF5, which is read row by row.");
    row_lines_.push_back(number_);
    for (std::size_t i = 0; i < cells.size(); ++i) {
      const CsvColumn& column = columns_[i];
      if (column.name.empty()) continue;
      if (column.name == "pair") {
        pairs_.emplace_back(cells[i]);
      } else if (column.name == "node_id") {
        const auto id = id_of(cells[i], separator_ != ',');
        if (!id)
          refuse(fmt::format("node {} is no whole number from 0 to {}", wire::in_quotes(cells[i]), UINT64_MAX), {},
                 "node_id");
        ids_.push_back(*id);
      } else {
        const auto value = number_of(cells[i], separator_ != ',');
        if (!value)
          refuse(fmt::format("{} is {}, expected a finite number of at most {} characters", column.name,
                             wire::in_quotes(cells[i]), wire::kMostNumberDigits),
                 {}, column.name);
        check_decimal_sign(cells[i]);
        values_[i].push_back(*value * column.factor);
      }
    }
  }

  // Sorts the rows by step and node: a file of several nodes has a row for each time and node.
  MemoryTable made() {
    MemoryTable table;
    const auto time_at = std::ranges::find(columns_, "time", &CsvColumn::name) - columns_.begin();
    const std::vector<double>& times = values_[static_cast<std::size_t>(time_at)];
    table.ids = {0};
    const std::size_t nodes = has_column("node_id") ? take_nodes(times, table) : 1;
    if (nodes > wire::kMaxNodesPerSession) {
      number_ = 0;
      refuse(fmt::format("{} nodes, more than a session takes", nodes));
    }
    for (std::size_t i = 0; i < times.size(); i += nodes) table.times.push_back(times[i]);
    for (std::size_t i = nodes; i < pairs_.size(); ++i)
      if (pairs_[i] != pairs_[i % nodes])
        refuse_row(
            i,
            fmt::format("pair of node {} changes from {} to {} at {} s; a node keeps its pair", table.ids[i % nodes],
                        wire::in_quotes(pairs_[i % nodes]), wire::in_quotes(pairs_[i]), times[i]),
            {}, "pair");
    if (!pairs_.empty()) {
      pairs_.resize(nodes);
      table.names["pair"] = pairs_;
    }
    for (std::size_t i = 0; i < columns_.size(); ++i) {
      const std::string& name = columns_[i].name;
      if (name == "dt")
        for (std::size_t row = 0; row < times.size(); row += nodes) {
          table.dts.push_back(values_[i][row]);
          if (!(table.dts.back() > 0))
            refuse_row(row, fmt::format("dt is {} s, expected a length above 0", table.dts.back()), {}, "dt");
        }
      else if (!name.empty() && name != "time" && name != "node_id" && name != "pair")
        table.series[name] = std::move(values_[i]);
    }
    table.lines = std::move(row_lines_);
    return table;
  }

  // Checks that each time has a row of each node, in one order. Returns the number of nodes.
  std::size_t take_nodes(const std::vector<double>& times, MemoryTable& table) {
    std::size_t nodes = 1;
    while (nodes < times.size() && times[nodes] == times[0]) ++nodes;
    table.ids.assign(ids_.begin(), ids_.begin() + static_cast<std::ptrdiff_t>(nodes));
    std::unordered_map<std::uint64_t, std::size_t> rows;
    for (std::size_t i = 0; i < nodes; ++i)
      if (const auto [at, fresh] = rows.emplace(ids_[i], i); !fresh)
        refuse_row(i,
                   fmt::format("node {} has a second row at {} s, after that of line {}", ids_[i], times[i],
                               row_lines_[at->second]),
                   {}, "node_id");
    for (std::size_t i = 0; i < ids_.size(); ++i)
      if (ids_[i] != ids_[i % nodes] || times[i] != times[i - i % nodes])
        refuse_row(i,
                   fmt::format("the row is of node {} at {} s; expected node {} at {} s", ids_[i], times[i],
                               ids_[i % nodes], times[i - i % nodes]),
                   "Each time has a row for each node, always in the same order.", "node_id");
    if (const std::size_t rest = times.size() % nodes; rest != 0)
      refuse_row(times.size() - 1,
                 fmt::format("the last time, {} s, has rows of {} of {} nodes; that of node {} is the first missing",
                             times.back(), rest, nodes, ids_[rest]),
                 {}, "node_id");
    return nodes;
  }

  static constexpr std::size_t kMostRows = 100'000'000;

  std::filesystem::path file_;
  TextLines lines_;
  std::string_view line_;
  std::size_t number_ = 0;  // of the line; 0: the whole file
  char separator_ = ',';
  char decimal_ = 0;  // the decimal sign of the table; 0: none has been found
  std::size_t decimal_line_ = 0;
  std::vector<CsvColumn> columns_;
  std::vector<std::size_t> row_lines_;       // number of each row's line
  std::vector<std::uint64_t> ids_;           // of the column node_id, in the order of the rows
  std::vector<std::string> pairs_;           // of the column pair, in the order of the rows
  std::vector<std::vector<double>> values_;  // of each other column, in the order of the rows
};

}  // namespace

MemoryTable read_csv(const std::filesystem::path& file, const std::string& columns) {
  return CsvReader(file).read(columns);
}

}  // namespace shearbus::replay
