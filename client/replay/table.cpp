#include "client/replay/table.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <utility>

#include "client/replay/csv_writer.hpp"
#include "proto/files/recording.hpp"
#include "proto/wire/units.hpp"

namespace shearbus::replay {
namespace {

class Hdf5Table final : public Table {
 public:
  explicit Hdf5Table(const std::filesystem::path& file) : history_(file) {}
  double start_time_s() const override { return history_.start_time_s(); }
  const std::vector<double>& times_s() const override { return history_.times_s(); }
  const std::vector<double>& dt_s() const override { return history_.dt_s(); }
  const std::vector<std::uint64_t>& node_ids() const override { return history_.node_ids(); }
  bool has(std::string_view name) const override { return history_.has(name); }
  std::vector<double> per_node(std::string_view name) const override { return history_.per_node(name); }
  std::vector<std::string> texts(std::string_view name) const override { return history_.texts(name); }
  std::vector<std::string> names_in(std::string_view group) const override { return history_.names_in(group); }
  void row(std::string_view name, std::size_t step, std::span<double> values) override {
    history_.row(name, step, values);
  }
  bool is_recorded() const override { return history_.has("dt"); }
  bool tells_start() const { return history_.tells_start(); }

 private:
  files::HistoryReader history_;
};

// The mean from `begin` to `end` of values at instants, linear in between.
class Means {
 public:
  explicit Means(const std::vector<double>& times) : times_(times) {}
  // Weights of the points in the mean: the trapezoidal rule on the parts of the intervals that the step covers.
  std::vector<std::pair<std::size_t, double>> weights(double begin, double end) const {
    std::vector<std::pair<std::size_t, double>> found;
    const auto first = std::upper_bound(times_.begin(), times_.end(), begin) - times_.begin();
    for (auto i = static_cast<std::size_t>(std::max<std::ptrdiff_t>(first - 1, 0));
         i + 1 < times_.size() && times_[i] < end; ++i) {
      const double length = times_[i + 1] - times_[i];
      const double from = (std::max(begin, times_[i]) - times_[i]) / length;
      const double to = (std::min(end, times_[i + 1]) - times_[i]) / length;
      const double share = (to - from) * length / (end - begin);
      const double right = share * 0.5 * (from + to);
      found.emplace_back(i, share - right);
      found.emplace_back(i + 1, right);
    }
    return found;
  }

 private:
  const std::vector<double>& times_;
};

[[noreturn]] void refuse_resampling(const char* name) {
  throw Error({.code = Code::kInvalidValue,
               .text = fmt::format("/{} belongs to the steps that the host took: the history cannot have others", name),
               .remedy =
                   "Leave --points and --dt out; or give /initial_velocity_jump in place of /velocity_jump, for a "
                   "closed loop.",
               .field = name});
}

// Refuses a first step that begins at 0, because nothing tells its start, and is out of all proportion to the others.
void refuse_late_clock(const std::string& place, const std::vector<double>& times, const std::string& remedy) {
  constexpr double kMost = 10.0;
  double longest = 0.0;
  for (std::size_t i = 1; i < times.size(); ++i) longest = std::max(longest, times[i] - times[i - 1]);
  if (times.size() < 2 || times.front() <= kMost * longest) return;
  throw Error({.code = Code::kInvalidValue,
               .text = fmt::format("{}: the first step would last from 0 to {} s, {:.3g} times as long as the longest "
                                   "other one, {:.6g} s; does the clock begin later?",
                                   place, times.front(), times.front() / longest, longest),
               .remedy = remedy,
               .field = "time"});
}

}  // namespace

bool MemoryTable::has(std::string_view name) const {
  return series.contains(name) || constants.contains(name) || names.contains(name);
}

std::vector<std::string> MemoryTable::texts(std::string_view name) const {
  return names.find(name)->second;
}

std::vector<std::string> MemoryTable::names_in(std::string_view group) const {
  const std::string begin = group.empty() ? std::string() : std::string(group) + '/';
  std::vector<std::string> found;
  for (const auto* table : {&series, &constants})
    for (const auto& [name, values] : *table)
      if (name.starts_with(begin)) found.push_back(name.substr(begin.size()));
  return found;
}

std::vector<double> MemoryTable::per_node(std::string_view name) const {
  if (const auto found = constants.find(name); found != constants.end()) return found->second;
  const auto found = series.find(name);
  if (found == series.end())
    throw Error({.code = Code::kInvalidValue, .text = fmt::format("the table has no column {}", name)});
  std::vector<double> first(found->second.begin(), found->second.begin() + static_cast<std::ptrdiff_t>(nodes()));
  for (std::size_t i = 0; i < found->second.size(); ++i)
    if (found->second[i] != first[i % nodes()])
      throw Error({.code = Code::kInvalidValue,
                   .text = fmt::format("{}{} of node {} changes from {} to {} at {} s; it is one value per node",
                                       lines.empty() ? "" : fmt::format("line {}: ", lines[i]), name, ids[i % nodes()],
                                       first[i % nodes()], found->second[i], times[i / nodes()]),
                   .field = std::string(name)});
  return first;
}

void MemoryTable::row(std::string_view name, std::size_t step, std::span<double> values) {
  const std::vector<double>& all = series.find(name)->second;
  std::copy_n(all.begin() + static_cast<std::ptrdiff_t>(step * nodes()), values.size(), values.begin());
}

MemoryTable resampled(Table& table, Rows rows, double dt_s) {
  const bool points = rows == Rows::kPoints;
  if (table.has("stress_soft") && table.has("velocity_jump")) refuse_resampling("velocity_jump");
  if (table.has("stick_stress")) refuse_resampling("stick_stress");
  if (points && table.steps() < 2)
    throw Error(
        {.code = Code::kInvalidValue, .text = "one point is no history; expected two or more", .field = "time"});
  MemoryTable made;
  made.ids = table.node_ids();
  const std::vector<double>& times = table.times_s();
  made.start = points ? times.front() : table.start_time_s();
  std::vector<std::size_t> row_of;  // of each new step: the step that it is a part of, or the interval behind a point
  for (std::size_t i = points ? 1 : 0; i < times.size(); ++i) {
    const double begin = i == 0 ? made.start : times[i - 1];
    const double length = points ? times[i] - begin : table.dt_s()[i];
    if (points && dt_s > 0) continue;
    const double parts = dt_s > 0 ? std::max(1.0, std::ceil(length / dt_s * (1 - 1e-9))) : 1.0;
    if (static_cast<double>(made.times.size()) + parts > 1e8)
      throw Error({.code = Code::kLimit, .text = fmt::format("--dt {} s makes more than 1e8 steps", dt_s)});
    const int count = static_cast<int>(parts);  // at most 1e8
    for (int part = 1; part <= count; ++part) {
      made.times.push_back(part == count ? times[i] : begin + length * (part / parts));
      made.dts.push_back(length / parts);
      row_of.push_back(i);
    }
  }
  if (points && dt_s > 0) {
    const double parts = std::max(1.0, std::ceil((times.back() - made.start) / dt_s * (1 - 1e-9)));
    if (parts > 1e8)
      throw Error({.code = Code::kLimit, .text = fmt::format("--dt {} s makes more than 1e8 steps", dt_s)});
    const int count = static_cast<int>(parts);
    for (int part = 1; part <= count; ++part) {
      const double before = made.times.empty() ? made.start : made.times.back();
      made.times.push_back(part == count ? times.back() : made.start + part * dt_s);
      made.dts.push_back(part == count ? made.times.back() - before : dt_s);
    }
  }
  const std::size_t nodes = table.nodes();
  for (const auto& [name, column] : wire::quantities()) {
    if (column->kind != wire::Kind::kInput || !table.has(name)) continue;
    if (name == "mass_soft" || name == "mass_hard") {
      made.constants[name] = table.per_node(name);
      continue;
    }
    std::vector<double> old(table.steps() * nodes);
    for (std::size_t i = 0; i < table.steps(); ++i) table.row(name, i, std::span(old).subspan(i * nodes, nodes));
    std::vector<double>& values = made.series[name];
    values.reserve(made.times.size() * nodes);
    const Means means(times);
    for (std::size_t step = 0; step < made.times.size(); ++step) {
      const auto weights = points ? means.weights(step == 0 ? made.start : made.times[step - 1], made.times[step])
                                  : std::vector<std::pair<std::size_t, double>>{{row_of[step], 1.0}};
      for (std::size_t node = 0; node < nodes; ++node) {
        double value = 0.0;
        for (const auto& [i, weight] : weights) value += weight * old[i * nodes + node];
        values.push_back(value);
      }
    }
  }
  for (const char* name : {"initial_temperature", "initial_velocity_jump", "initial_velocity_jump_second"})
    if (table.has(name)) made.constants[name] = table.per_node(name);
  for (const std::string& key : table.names_in("parameter"))
    made.constants["parameter/" + key] = table.per_node("parameter/" + key);
  if (table.has("pair")) made.names["pair"] = table.texts("pair");
  return made;
}

std::unique_ptr<Table> open_table(const std::filesystem::path& file, const TableOptions& options) {
  const std::string ending = ending_of(file);
  const bool csv = ending == ".csv" || ending == ".txt" || ending == ".tsv" || ending == ".dat";
  if (!csv) {
    if (!options.columns.empty())
      throw Error({.code = Code::kInvalidValue,
                   .text = fmt::format("--columns is for CSV files; {} is read as HDF5", file.string()),
                   .remedy = "CSV files end in .csv, .tsv, .txt or .dat."});
    auto table = std::make_unique<Hdf5Table>(file);
    if (options.rows != Rows::kPoints && !table->tells_start())
      refuse_late_clock(file.string(), table->times_s(),
                        "Give the start of the first step as the attribute t0 of /time, in its unit, or the lengths of "
                        "all steps as /dt.");
    if (options.rows != Rows::kPoints && options.dt_s == 0.0) return table;
    return std::make_unique<MemoryTable>(resampled(*table, options.rows, options.dt_s));
  }
  auto table = std::make_unique<MemoryTable>(read_csv(file, options.columns));
  if (options.rows == Rows::kUnspecified)
    throw Error(
        {.code = Code::kInvalidValue,
         .text = fmt::format("{}: a CSV file does not tell whether its rows are points or steps", file.string()),
         .remedy = "--points: each row is a value at its time, linear in between. --steps: the values of a row "
                   "hold from the time of the row before to its own."});
  for (std::size_t i = 1; i < table->steps(); ++i)
    if (table->times[i] <= table->times[i - 1])
      throw Error({.code = Code::kInvalidValue,
                   .text = fmt::format("{}, line {}: time {} s is not after {} s of the row before", file.string(),
                                       table->lines[i * table->nodes()], table->times[i], table->times[i - 1]),
                   .field = "time"});
  if (options.rows == Rows::kPoints)
    return std::make_unique<MemoryTable>(resampled(*table, Rows::kPoints, options.dt_s));
  if (!table->dts.empty())
    table->start = table->times.front() - table->dts.front();
  else if (table->times.front() <= 0.0)
    throw Error({.code = Code::kInvalidValue,
                 .text = fmt::format("{}, line {}: the first step ends at {} s, not after its start at 0 s",
                                     file.string(), table->lines.front(), table->times.front()),
                 .remedy = "With --steps a time is the end of its row's step. Are the rows --points?",
                 .field = "time"});
  else
    refuse_late_clock(fmt::format("{}, line {}", file.string(), table->lines.front()), table->times,
                      "Give the lengths of the steps in a column \"dt [s]\", or say --points if the rows are values "
                      "at instants.");
  for (std::size_t i = table->dts.size(); i < table->steps(); ++i)
    table->dts.push_back(table->times[i] - (i == 0 ? table->start : table->times[i - 1]));
  if (options.dt_s > 0) return std::make_unique<MemoryTable>(resampled(*table, Rows::kSteps, options.dt_s));
  return table;
}

}  // namespace shearbus::replay
