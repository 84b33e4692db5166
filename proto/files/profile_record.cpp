#include "proto/files/profile_record.hpp"

#include <algorithm>
#include <utility>

namespace shearbus::files {
namespace {

const std::string kGroup = "profiles";

// The columns of a profile that a record keeps: positions and widths do not change in time.
bool is_fixed(wire::Field field) {
  return field == wire::Field::kPosition || field == wire::Field::kWidth;
}

}  // namespace

ProfileRecord::ProfileRecord(std::vector<std::uint64_t> node_ids, std::vector<double> times_s)
    : node_ids_(std::move(node_ids)), times_s_(std::move(times_s)) {
  if (node_ids_.empty()) times_s_.clear();
  std::ranges::sort(times_s_);
}

bool ProfileRecord::due(double time_s) const {
  constexpr double kRounding = 1e-12;  // relative: a sum of steps may end just before the time
  return next_ < times_s_.size() && time_s >= times_s_[next_] * (1.0 - kRounding);
}

void ProfileRecord::add(double time_s, const wire::Batch& rows, std::span<const double> pressure_pa) {
  while (due(time_s)) ++next_;
  if (columns_.empty()) {
    for (const wire::Column& column : rows.columns())
      if (column.element == wire::Element::kFloat64) columns_.push_back(column);
    values_.resize(columns_.size());
  }
  taken_s_.push_back(time_s);
  pressure_.insert(pressure_.end(), pressure_pa.begin(), pressure_pa.end());
  for (std::size_t i = 0; i < columns_.size(); ++i) {
    const std::span<const double> column = rows.f64(columns_[i].field, columns_[i].component);
    const bool first = taken_s_.size() == 1;
    if (is_fixed(columns_[i].field) && first)
      values_[i].assign(column.begin(), column.begin() + static_cast<std::ptrdiff_t>(column.size() / node_ids_.size()));
    else if (!is_fixed(columns_[i].field))
      values_[i].insert(values_[i].end(), column.begin(), column.end());
  }
}

void ProfileRecord::write(HistoryWriter& writer) const {
  if (empty()) return;
  const std::size_t vertices = columns_.front().count / node_ids_.size();
  const auto name = [](const char* quantity) { return kGroup + "/" + quantity; };
  writer.add_array({name("time"), "s", "end of the step after which the profiles were read"}, taken_s_,
                   {taken_s_.size()});
  writer.add_ids({name("node_id"), "1", "the host's number of the interface node"}, node_ids_);
  Quantity pressure = quantity_of_column(wire::Field::kPressure, 0, "at which the flow stress is evaluated");
  pressure.name = name(pressure.name.c_str());
  writer.add_array(pressure, pressure_, {taken_s_.size(), node_ids_.size()});
  for (std::size_t i = 0; i < columns_.size(); ++i) {
    Quantity quantity = quantity_of_column(columns_[i].field, columns_[i].component);
    quantity.name = name(quantity.name.c_str());
    if (is_fixed(columns_[i].field))
      writer.add_array(quantity, values_[i], {vertices});
    else
      writer.add_array(quantity, values_[i], {taken_s_.size(), node_ids_.size(), vertices});
  }
}

void ProfileRecord::save(DumpWriter& dump) const {
  if (node_ids_.empty()) return;
  std::vector<std::uint64_t> columns;
  for (const wire::Column& column : columns_)
    columns.insert(columns.end(), {static_cast<std::uint64_t>(column.field), column.component, column.count});
  dump.counts(kGroup + "/columns", columns);
  dump.numbers(kGroup + "/time", taken_s_);
  dump.numbers(kGroup + "/pressure", pressure_);
  for (std::size_t i = 0; i < columns_.size(); ++i)
    dump.numbers(kGroup + "/" + wire::quantity_of(columns_[i].field, columns_[i].component), values_[i]);
}

void ProfileRecord::load(const DumpReader& dump) {
  if (node_ids_.empty()) return;
  const std::vector<std::uint64_t>& columns = dump.counts(kGroup + "/columns");
  taken_s_ = dump.numbers(kGroup + "/time");
  pressure_ = dump.numbers(kGroup + "/pressure");
  for (std::size_t i = 0; i + 2 < columns.size(); i += 3) {
    columns_.push_back({.field = static_cast<wire::Field>(columns[i]),
                        .component = static_cast<std::uint32_t>(columns[i + 1]),
                        .element = wire::Element::kFloat64,
                        .count = columns[i + 2]});
    values_.push_back(dump.numbers(kGroup + "/" + wire::quantity_of(columns_.back().field, columns_.back().component)));
  }
  for (const double time_s : taken_s_)
    while (due(time_s)) ++next_;
}

}  // namespace shearbus::files
