// Reads histories from CSV files: names and units in the first line or in an option; comma, semicolon or tab between
// the values; decimal point or, where the comma separates nothing, decimal comma.
#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <fstream>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "client/replay/table.hpp"
#include "proto/wire/columns.hpp"
#include "proto/wire/limits.hpp"
#include "proto/wire/status.hpp"

namespace shearbus::replay {
namespace {

using wire::Code;
using wire::Error;

struct Unit {
  const char* name;
  const char* si;
  double factor;
};
constexpr std::array kUnits = {Unit{"s", "s", 1.0},           Unit{"ms", "s", 1e-3},
                               Unit{"us", "s", 1e-6},         Unit{"\u00b5s", "s", 1e-6},
                               Unit{"\u03bcs", "s", 1e-6},    Unit{"ns", "s", 1e-9},
                               Unit{"ps", "s", 1e-12},        Unit{"Pa", "Pa", 1.0},
                               Unit{"kPa", "Pa", 1e3},        Unit{"MPa", "Pa", 1e6},
                               Unit{"GPa", "Pa", 1e9},        Unit{"bar", "Pa", 1e5},
                               Unit{"kbar", "Pa", 1e8},       Unit{"Mbar", "Pa", 1e11},
                               Unit{"m/s", "m/s", 1.0},       Unit{"mm/s", "m/s", 1e-3},
                               Unit{"km/s", "m/s", 1e3},      Unit{"mm/us", "m/s", 1e3},
                               Unit{"cm/us", "m/s", 1e4},     Unit{"kg/m2", "kg/m2", 1.0},
                               Unit{"g/cm2", "kg/m2", 10.0},  Unit{"K", "K", 1.0},
                               Unit{"1/s", "1/s", 1.0},       Unit{"1/ms", "1/s", 1e3},
                               Unit{"1/us", "1/s", 1e6},      Unit{"1/ns", "1/s", 1e9},
                               Unit{"Pa s/m", "Pa s/m", 1.0}, Unit{"MPa s/m", "Pa s/m", 1e6},
                               Unit{"J/m2", "J/m2", 1.0}};

// The SI unit of a quantity that a table may hold; null for any other name.
const char* unit_of(std::string_view name) {
  if (name == "time" || name == "dt") return "s";
  if (name == "node_id" || name == "node") return "";
  if (name == "initial_temperature") return "K";
  if (name == "pair" || name.starts_with("parameter/")) return "";
  if (name == "initial_velocity_jump" || name == "initial_velocity_jump_second") return "m/s";
  for (const wire::ColumnRow& column : wire::column_rows())
    for (std::uint32_t component = 0; component < (column.tangential ? 2 : 1); ++component)
      if (column.kind != wire::Kind::kNode && wire::quantity_of(column.field, component) == name) return column.unit;
  return nullptr;
}

struct CsvColumn {
  std::string name;  // empty: the column is left out
  double factor = 1.0;
};

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

std::optional<double> number_of(std::string_view text, bool decimal_comma) {
  std::string copy(text);
  if (decimal_comma) {
    if (std::ranges::count(copy, ',') > 1 || (copy.find(',') != copy.npos && copy.find('.') != copy.npos))
      return std::nullopt;
    std::ranges::replace(copy, ',', '.');
  }
  const char* first = copy.c_str() + (copy.starts_with('+') ? 1 : 0);
  const char* const last = copy.c_str() + copy.size();
  double value = 0.0;
  const auto [end, fault] = std::from_chars(first, last, value);
  if (fault != std::errc() || end != last || !std::isfinite(value)) return std::nullopt;
  return value;
}

class CsvReader {
 public:
  explicit CsvReader(std::filesystem::path file) : file_(std::move(file)), stream_(file_) {
    if (!stream_) throw Error({.code = Code::kInvalidValue, .text = file_.string() + ": cannot be read"});
  }

  MemoryTable read(const std::string& columns) {
    if (!next_line()) refuse("holds no table");
    for (const char separator : {';', '\t'})
      if (line_.find(separator) != line_.npos) separator_ = separator;
    const bool has_names = !number_of(cells_of(line_, separator_).front(), separator_ != ',');
    if (!columns.empty())
      for (const std::string_view word : cells_of(columns, ',')) columns_.push_back(column_of(word, ':'));
    else if (has_names)
      for (const std::string_view cell : cells_of(line_, separator_)) columns_.push_back(column_of(cell, '['));
    else
      refuse("the first line has no names", "Name the columns: --columns time:us,pressure:GPa,velocity_jump:m/s");
    check_columns();
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

  // Skips empty lines and comments. Returns false at the end of the file.
  bool next_line() {
    while (std::getline(stream_, line_)) {
      if (++number_ == 1 && line_.starts_with("\xef\xbb\xbf")) line_.erase(0, 3);
      if (const std::string_view text = trimmed(line_); !text.empty() && text.front() != '#') return true;
    }
    return false;
  }

  // "pressure [GPa]", "pressure (GPa)", "pressure_GPa" or, in the option, "pressure:GPa".
  CsvColumn column_of(std::string_view cell, char mark) const {
    std::string_view name = cell;
    std::string_view unit;
    if (const auto at = mark == ':' ? cell.find(':') : cell.find_first_of("[("); at != std::string_view::npos) {
      name = trimmed(cell.substr(0, at));
      unit = trimmed(cell.substr(at + 1));
      if (mark != ':' && !unit.empty()) unit = trimmed(unit.substr(0, unit.size() - 1));
    } else if (const auto line = cell.rfind('_'); unit_of(cell) == nullptr && line != std::string_view::npos) {
      name = cell.substr(0, line);
      unit = cell.substr(line + 1);
    }
    const char* const si = unit_of(name);
    if (si == nullptr && mark != ':') return {};
    if (si == nullptr && name == "-") return {};
    if (si == nullptr)
      refuse(fmt::format("--columns names \"{}\", which no step has", name),
             "Use names such as time, pressure, velocity_jump, node; - leaves a column out.");
    if (name == "node" || name == "node_id") return {.name = "node_id"};
    if (*si == '\0' && !unit.empty())
      refuse(fmt::format("{} has the unit \"{}\"", name, unit),
             name == "pair" ? "A pair is a name."
                            : "A parameter has the unit of its key in the scene, and is written without.",
             std::string(name));
    if (*si == '\0' || std::string_view(si) == "1") return {.name = std::string(name)};
    std::vector<std::string> known;
    for (const Unit& one : kUnits) {
      if (std::string_view(one.si) != si) continue;
      if (unit == one.name) return {.name = std::string(name), .factor = one.factor};
      known.emplace_back(one.name);
    }
    refuse(unit.empty() ? fmt::format("{} has no unit", name) : fmt::format("{} has the unit \"{}\"", name, unit),
           fmt::format("Write the unit as {} [{}], or give it with --columns {}:{}; known are {}.", name, known.front(),
                       name, known.front(), fmt::join(known, ", ")),
           std::string(name));
  }

  void check_columns() {
    for (const CsvColumn& column : columns_)
      if (!column.name.empty() && std::ranges::count(columns_, column.name, &CsvColumn::name) > 1)
        refuse(fmt::format("{} stands in two columns", column.name), {}, column.name);
    if (std::ranges::find(columns_, "time", &CsvColumn::name) == columns_.end())
      refuse("there is no column of the time", "Name it \"time [s]\", or with --columns.", "time");
    values_.resize(columns_.size());
  }

  void read_row() {
    const auto cells = cells_of(line_, separator_);
    if (cells.size() != columns_.size())
      refuse(fmt::format("{} values, expected {} as there are columns", cells.size(), columns_.size()),
             separator_ == ',' ? "With a decimal comma the values are separated by ; or tabs." : "");
    for (std::size_t i = 0; i < cells.size(); ++i) {
      if (columns_[i].name.empty()) continue;
      if (columns_[i].name == "pair") {
        pairs_.emplace_back(cells[i]);
        continue;
      }
      const auto value = number_of(cells[i], separator_ != ',');
      if (!value)
        refuse(fmt::format("{} is \"{}\", expected a finite number", columns_[i].name, cells[i]), {}, columns_[i].name);
      values_[i].push_back(*value * columns_[i].factor);
    }
  }

  // Sorts the rows by step and node: a file of several nodes has a row for each time and node.
  MemoryTable made() {
    number_ = 0;
    MemoryTable table;
    const auto find = [&](const char* name) -> const std::vector<double>* {
      const auto at = std::ranges::find(columns_, name, &CsvColumn::name);
      return at == columns_.end() ? nullptr : &values_[static_cast<std::size_t>(at - columns_.begin())];
    };
    const std::vector<double>& times = *find("time");
    std::size_t nodes = 1;
    if (const std::vector<double>* ids = find("node_id")) {
      for (nodes = 1; nodes < times.size() && times[nodes] == times[0];) ++nodes;
      for (std::size_t i = 0; i < ids->size(); ++i) {
        const double id = (*ids)[i];
        if (id < 0 || id > 9e15 || id != std::floor(id)) refuse(fmt::format("node {} is no whole number", id));
        if (i < nodes) table.ids.push_back(static_cast<std::uint64_t>(id));
        if (id != (*ids)[i % nodes] || times[i] != times[i - i % nodes])
          refuse(fmt::format("row {} is of node {} at {} s; expected node {} at {} s", i, id, times[i],
                             (*ids)[i % nodes], times[i - i % nodes]),
                 "Each time has a row for each node, always in the same order.", "node_id");
      }
      std::vector<std::uint64_t> sorted = table.ids;
      std::ranges::sort(sorted);
      if (std::ranges::adjacent_find(sorted) != sorted.end()) refuse("a node has two rows at one time", {}, "node_id");
      if (times.size() % nodes != 0) refuse("the last time has rows of some nodes only", {}, "node_id");
    } else {
      table.ids = {0};
    }
    if (nodes > wire::kMaxNodesPerSession) refuse(fmt::format("{} nodes, more than a session takes", nodes));
    for (std::size_t i = 0; i < times.size(); i += nodes) table.times.push_back(times[i]);
    for (std::size_t i = nodes; i < pairs_.size(); ++i)
      if (pairs_[i] != pairs_[i % nodes])
        refuse(fmt::format("pair of node {} changes from \"{}\" to \"{}\" at row {}; a node keeps its pair",
                           table.ids[i % nodes], pairs_[i % nodes], pairs_[i], i / nodes),
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
          if (!(table.dts.back() > 0)) refuse(fmt::format("dt of row {} is {} s", row, table.dts.back()), {}, "dt");
        }
      else if (!name.empty() && name != "time" && name != "node_id" && name != "pair")
        table.series[name] = std::move(values_[i]);
    }
    return table;
  }

  std::filesystem::path file_;
  std::ifstream stream_;
  std::string line_;
  std::size_t number_ = 0;  // of the line; 0: the whole file
  char separator_ = ',';
  std::vector<CsvColumn> columns_;
  std::vector<std::string> pairs_;           // of the column pair, in the order of the rows
  std::vector<std::vector<double>> values_;  // of each column, in the order of the rows
};

}  // namespace

MemoryTable read_csv(const std::filesystem::path& file, const std::string& columns) {
  return CsvReader(file).read(columns);
}

}  // namespace shearbus::replay
