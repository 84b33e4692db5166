#include "client/replay/table.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "client/replay/python_part.hpp"
#include "proto/wire/text.hpp"

namespace shearbus::replay {
namespace {

[[noreturn]] void refuse(const std::string& text, const std::string& remedy, const char* field = "time") {
  throw Error({.code = Code::kInvalidValue, .text = text, .remedy = remedy, .field = field});
}

// Refuses a first step that begins at 0, because nothing tells its start, and is out of all proportion to the others.
void refuse_late_clock(const std::filesystem::path& file, const std::vector<double>& times) {
  constexpr double kMost = 10.0;
  double longest = 0.0;
  for (std::size_t i = 1; i < times.size(); ++i) longest = std::max(longest, times[i] - times[i - 1]);
  if (times.size() < 2 || times.front() <= kMost * longest) return;
  refuse(
      fmt::format("{}: the first step would last from 0 to {} s, {:.3g} times as long as the longest other one, {:.6g} "
                  "s; does the clock begin later?",
                  file.string(), times.front(), times.front() / longest, longest),
      "Give the start of the first step as the attribute t0 of /time, in its unit, or the lengths of all steps as "
      "/dt.");
}

files::HistoryReader opened(const std::filesystem::path& file, const TableOptions& options) {
  if (!is_text(file)) {
    if (options.columns.empty()) return files::HistoryReader(file);
    refuse(fmt::format("--columns is for CSV files; {} is read as HDF5", file.string()),
           "CSV files end in .csv, .tsv, .txt or .dat.", "");
  }
  if (options.rows == Rows::kUnspecified)
    refuse(
        fmt::format("{}: a CSV file does not tell whether its rows are points or steps", file.string()),
        "--points: each row is a value at its time, linear in between. --steps: the values of a row hold from the time "
        "of the row before to its own.",
        "");
  return read_text(file, options.columns, options.rows == Rows::kPoints);
}

}  // namespace

std::string ending_of(const std::filesystem::path& file) {
  std::string ending = file.extension().string();
  std::ranges::transform(ending, ending.begin(), wire::ascii_lower);
  return ending;
}

bool is_text(const std::filesystem::path& file) {
  const std::string ending = ending_of(file);
  return ending == ".csv" || ending == ".txt" || ending == ".tsv" || ending == ".dat";
}

Table::Table(const std::filesystem::path& file, const TableOptions& options) : history_(opened(file, options)) {
  if (options.rows != Rows::kPoints && !history_.tells_start()) refuse_late_clock(file, times_s());
  if (options.rows == Rows::kPoints || options.dt_s > 0) resample(options.rows == Rows::kPoints, options.dt_s);
}

std::size_t Table::parts_of(double length, double dt_s) const {
  constexpr double kMost = 1e8;
  const double parts = dt_s > 0 ? std::max(1.0, std::ceil(length / dt_s * (1 - 1e-9))) : 1.0;
  if (static_cast<double>(times_s_.size()) + parts > kMost)
    throw Error({.code = Code::kLimit, .text = fmt::format("--dt {} s makes more than 1e8 steps", dt_s)});
  return static_cast<std::size_t>(parts);
}

void Table::resample(bool points, double dt_s) {
  for (const char* name : {has("stress_soft") ? "velocity_jump" : "stick_stress", "stick_stress"})
    if (has(name))
      refuse(
          fmt::format("/{} belongs to the steps that the host took: the history cannot have others", name),
          "Leave --points and --dt out; or give /initial_velocity_jump in place of /velocity_jump, for a closed loop.",
          name);
  const std::vector<double>& times = history_.times_s();
  if (points && times.size() < 2) refuse("one point is no history; expected two or more", {});
  start_s_ = points ? times.front() : history_.start_time_s();
  const auto add = [&](double end_s, double length_s) {
    times_s_.push_back(end_s);
    dts_s_.push_back(length_s);
  };
  if (points && dt_s > 0) {
    const std::size_t parts = parts_of(times.back() - start_s_, dt_s);
    for (std::size_t part = 1; part < parts; ++part) add(start_s_ + static_cast<double>(part) * dt_s, dt_s);
    add(times.back(), times.back() - (times_s_.empty() ? start_s_ : times_s_.back()));
  }
  for (std::size_t i = points ? 1 : 0; i < times.size() && !(points && dt_s > 0); ++i) {
    const double begin = i == 0 ? start_s_ : times[i - 1];
    const double length = points ? times[i] - begin : history_.dt_s()[i];
    const std::size_t parts = parts_of(length, dt_s);
    for (std::size_t part = 1; part <= parts; ++part) {
      const double share = static_cast<double>(part) / static_cast<double>(parts);
      add(part == parts ? times[i] : begin + length * share, length / static_cast<double>(parts));
      if (!points) row_of_.push_back(i);
    }
  }
}

// The mean of values at instants, linear in between: the trapezoidal rule on the parts of the intervals that the step
// covers.
void Table::row(std::string_view name, std::size_t step, std::span<double> values) {
  if (!resampled()) return history_.row(name, step, values);
  if (!row_of_.empty()) return history_.row(name, row_of_[step], values);
  const std::vector<double>& times = history_.times_s();
  const double begin = step == 0 ? start_s_ : times_s_[step - 1];
  const double end = times_s_[step];
  const auto first = std::upper_bound(times.begin(), times.end(), begin) - times.begin();
  std::ranges::fill(values, 0.0);
  point_.resize(values.size());
  for (auto i = static_cast<std::size_t>(std::max<std::ptrdiff_t>(first - 1, 0));
       i + 1 < times.size() && times[i] < end; ++i) {
    const double length = times[i + 1] - times[i];
    const double from = (std::max(begin, times[i]) - times[i]) / length;
    const double to = (std::min(end, times[i + 1]) - times[i]) / length;
    const double share = (to - from) * length / (end - begin);
    const double right = share * 0.5 * (from + to);
    for (const auto& [point, weight] : {std::pair(i, share - right), std::pair(i + 1, right)}) {
      history_.row(name, point, point_);
      for (std::size_t node = 0; node < values.size(); ++node) values[node] += weight * point_[node];
    }
  }
}

}  // namespace shearbus::replay
