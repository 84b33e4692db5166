#include "client/replay/result_file.hpp"

#include <fcntl.h>
#include <fmt/format.h>

#include <cerrno>

#include "client/replay/table.hpp"
#include "proto/wire/columns.hpp"

namespace shearbus::replay {

bool is_text_result(const std::filesystem::path& file) {
  return ending_of(file) == ".csv" || ending_of(file) == ".tsv";
}

void refuse_ending_of_text(const std::filesystem::path& file) {
  if (!is_text(file) || is_text_result(file)) return;
  throw Error(
      {.code = Code::kInvalidValue,
       .text = fmt::format("--out {}: a file that ends in {} is read as a table of text, and results are written "
                           "as CSV or HDF5",
                           file.string(), ending_of(file)),
       .remedy = "Name it .csv or .tsv for text, .h5 for HDF5."});
}

ResultFile::ResultFile(const std::filesystem::path& file, const std::filesystem::path& like,
                       const std::vector<ColumnPlace>& columns, std::span<const std::uint64_t> node_ids,
                       const NodeProperties& properties, const std::map<std::string, std::string>& meta,
                       double start_time_s)
    : separator_(ending_of(like) == ".tsv" ? '\t' : ','),
      node_ids_(node_ids.begin(), node_ids.end()),
      properties_(properties),
      values_(columns.size()) {
  if (is_text_result(like)) {
    begin_text(file, columns);
    return;
  }
  std::vector<files::Quantity> quantities;
  quantities.reserve(columns.size());
  for (const auto& [field, component] : columns) quantities.push_back(files::quantity_of_column(field, component));
  hdf5_.emplace(file, node_ids, std::move(quantities), meta, start_time_s);
  properties.write(*hdf5_);
}

void ResultFile::begin_text(const std::filesystem::path& file, const std::vector<ColumnPlace>& columns) {
  partial_.emplace(file, files::kTableFile, files::PartialFile::Writers::kOne);
  text_.reset(::fdopen(::fcntl(partial_->descriptor(), F_DUPFD_CLOEXEC, 0), "w"));
  if (!text_) files::refuse_to_write(file, errno);
  std::string head = fmt::format("time [s]{0}dt [s]{0}node_id", separator_);
  const auto add = [&](const std::string& name) { head += separator_ + name; };
  for (const auto& [field, component] : columns) {
    const std::string unit = wire::column_row(field).unit;
    add(wire::quantity_of(field, component) + (unit.empty() || unit == "1" ? "" : " [" + unit + "]"));
  }
  if (!properties_.initial_temperature_k.empty()) add("initial_temperature [K]");
  if (!properties_.pair.empty()) add("pair");
  for (const auto& [key, values] : properties_.parameters) add("parameter/" + key);
  fmt::print(text_.get(), "{}\n", head);
}

void ResultFile::begin_step(double time_s, double dt_s) {
  if (hdf5_) return hdf5_->begin_row(time_s, dt_s);
  time_s_ = time_s;
  dt_s_ = dt_s;
}

void ResultFile::set(std::size_t column, std::span<const double> values) {
  if (hdf5_) return hdf5_->set(column, values);
  values_[column].assign(values.begin(), values.end());
}

void ResultFile::set(std::size_t column, std::span<const std::uint8_t> values) {
  if (hdf5_) return hdf5_->set(column, values);
  values_[column].assign(values.begin(), values.end());
}

void ResultFile::end_step() {
  if (hdf5_) return hdf5_->end_row();
  for (std::size_t node = 0; node < node_ids_.size(); ++node) {
    fmt::memory_buffer row;
    const auto add = [&](const auto& value) { fmt::format_to(std::back_inserter(row), "{}{}", separator_, value); };
    fmt::format_to(std::back_inserter(row), "{}", time_s_);
    add(dt_s_);
    add(node_ids_[node]);
    for (const std::vector<double>& column : values_) add(column[node]);
    if (!properties_.initial_temperature_k.empty()) add(properties_.initial_temperature_k[node]);
    if (!properties_.pair.empty()) add(properties_.pair[node]);
    for (const auto& [key, own] : properties_.parameters) add(own[node]);
    row.push_back('\n');
    if (std::fwrite(row.data(), 1, row.size(), text_.get()) != row.size())
      files::refuse_to_write(partial_->file(), errno);
  }
}

void ResultFile::close() {
  if (hdf5_) return hdf5_->close();
  if (std::fflush(text_.get()) != 0 || std::fclose(text_.release()) != 0)
    files::refuse_to_write(partial_->file(), errno);
  partial_->publish();
}

}  // namespace shearbus::replay
