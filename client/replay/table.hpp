// The macroscopic history that a replay reads: an HDF5 file, or a table in memory made of a CSV file or by resampling.
#pragma once

#include <cstdint>
#include <filesystem>
#include <map>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "client/replay/names.hpp"

namespace shearbus::replay {

// Quantities per step and node, [T,N], and per node, [N], by name. SI units.
class Table {
 public:
  virtual ~Table() = default;
  virtual double start_time_s() const = 0;
  virtual const std::vector<double>& times_s() const = 0;  // end of each step; points: time of each
  virtual const std::vector<double>& dt_s() const = 0;     // length of each step
  virtual const std::vector<std::uint64_t>& node_ids() const = 0;
  virtual bool has(std::string_view name) const = 0;
  virtual std::vector<double> per_node(std::string_view name) const = 0;
  virtual std::vector<std::string> texts(std::string_view name) const = 0;  // one per node
  // "KEY" of each quantity "group/KEY"; of the group "": all names outside of groups, for messages
  virtual std::vector<std::string> names_in(std::string_view group) const = 0;
  virtual void row(std::string_view name, std::size_t step, std::span<double> values) = 0;
  virtual bool is_recorded() const = 0;  // whether a program recorded it with the step lengths that it used

  std::size_t steps() const { return times_s().size(); }
  std::size_t nodes() const { return node_ids().size(); }
};

class MemoryTable final : public Table {
 public:
  double start = 0.0;
  std::vector<double> times;
  std::vector<double> dts;
  std::vector<std::uint64_t> ids;
  std::map<std::string, std::vector<double>, std::less<>> series;      // [T,N], row after row
  std::map<std::string, std::vector<double>, std::less<>> constants;   // [N]
  std::map<std::string, std::vector<std::string>, std::less<>> names;  // texts, [N]
  std::vector<std::size_t> lines;  // of a text file: number of the line of each step and node

  double start_time_s() const override { return start; }
  const std::vector<double>& times_s() const override { return times; }
  const std::vector<double>& dt_s() const override { return dts; }
  const std::vector<std::uint64_t>& node_ids() const override { return ids; }
  bool has(std::string_view name) const override;
  std::vector<double> per_node(std::string_view name) const override;
  std::vector<std::string> texts(std::string_view name) const override;
  std::vector<std::string> names_in(std::string_view group) const override;
  void row(std::string_view name, std::size_t step, std::span<double> values) override;
  bool is_recorded() const override { return false; }
};

// What a row of a table stands for. A point is the value at an instant, between two points a quantity varies linearly;
// the value of a step holds from its start to its end.
enum class Rows { kUnspecified, kPoints, kSteps };

struct TableOptions {
  Rows rows = Rows::kUnspecified;
  double dt_s = 0.0;    // length of the steps to make; 0: the table's own
  std::string columns;  // CSV: "time:us,pressure:GPa,-", in place of the names and units in the file's first line
};

// Opens a history, an HDF5 file or a CSV file (by the ending .csv), and resamples it as the options say. Throws Error.
std::unique_ptr<Table> open_table(const std::filesystem::path& file, const TableOptions& options);

// A CSV file as it stands; `dts` is empty unless the file has a column dt.
MemoryTable read_csv(const std::filesystem::path& file, const std::string& columns);

// The same history in steps of `dt_s` or less. Steps are divided; points become the means of the steps between them.
MemoryTable resampled(Table& table, Rows rows, double dt_s);

}  // namespace shearbus::replay
