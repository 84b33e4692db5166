// The macroscopic history that a replay reads: an HDF5 file, or a table of text as one.
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "client/replay/names.hpp"
#include "proto/files/recording.hpp"

namespace shearbus::replay {

// What a row of a table stands for. A point is the value at an instant, between two points a quantity varies linearly;
// the value of a step holds from its start to its end.
enum class Rows { kUnspecified, kPoints, kSteps };

struct TableOptions {
  Rows rows = Rows::kUnspecified;
  double dt_s = 0.0;    // largest length of the steps to make; 0: the table's own
  std::string columns;  // CSV: "time:us,pressure:GPa,-", in place of the names and units in the file's first line
};

// The ending of a file's name in small letters, such as ".csv".
std::string ending_of(const std::filesystem::path& file);

// Whether a file is read as a table of text: its name ends in .csv, .tsv, .txt or .dat.
bool is_text(const std::filesystem::path& file);

// Whether a history has one value of a column per node, [N], that does not change in time.
constexpr bool is_per_node(Field field) {
  return field == Field::kMassSoft || field == Field::kMassHard;
}

// Quantities per step and node, [T,N], and per node, [N], by name, in SI units. Steps are divided, and points become the
// means of the steps between them, as the options say. Throws Error.
class Table {
 public:
  Table(const std::filesystem::path& file, const TableOptions& options);

  double start_time_s() const { return resampled() ? start_s_ : history_.start_time_s(); }
  const std::vector<double>& times_s() const { return resampled() ? times_s_ : history_.times_s(); }
  const std::vector<double>& dt_s() const { return resampled() ? dts_s_ : history_.dt_s(); }
  const std::vector<std::uint64_t>& node_ids() const { return history_.node_ids(); }
  std::size_t steps() const { return times_s().size(); }
  std::size_t nodes() const { return node_ids().size(); }
  bool has(std::string_view name) const { return history_.has(name); }
  std::optional<std::string> meta(std::string_view name) const { return history_.meta(name); }
  std::vector<double> per_node(std::string_view name) const { return history_.per_node(name); }
  std::vector<std::string> texts(std::string_view name) const { return history_.texts(name); }
  std::vector<std::string> names_in(std::string_view group) const { return history_.names_in(group); }
  void row(std::string_view name, std::size_t step, std::span<double> values);
  // Whether a program recorded it with the step lengths that it used.
  bool is_recorded() const { return !resampled() && has("dt"); }

 private:
  bool resampled() const { return !times_s_.empty(); }
  void resample(bool points, double dt_s);
  std::size_t parts_of(double length, double dt_s) const;

  files::HistoryReader history_;
  // Of the steps that were made, if any.
  double start_s_ = 0.0;
  std::vector<double> times_s_, dts_s_;
  std::vector<std::size_t> row_of_;  // the step that each is a part of; none: the rows are points
  std::vector<double> point_;        // room for one row
};

}  // namespace shearbus::replay
