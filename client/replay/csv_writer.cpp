#include "client/replay/csv_writer.hpp"

#include <fcntl.h>
#include <fmt/format.h>

#include <algorithm>
#include <cerrno>

#include "proto/wire/columns.hpp"
#include "proto/wire/text.hpp"

namespace shearbus::replay {

std::string ending_of(const std::filesystem::path& file) {
  std::string ending = file.extension().string();
  std::ranges::transform(ending, ending.begin(), wire::ascii_lower);
  return ending;
}

bool is_text_result(const std::filesystem::path& file) {
  return ending_of(file) == ".csv" || ending_of(file) == ".tsv";
}

void refuse_ending_of_text(const std::filesystem::path& file) {
  const std::string ending = ending_of(file);
  if (ending != ".txt" && ending != ".dat") return;
  throw wire::Error({.code = wire::Code::kInvalidValue,
                     .text = fmt::format("--out {}: a file that ends in {} is read as a table of text, and results are "
                                         "written as CSV or HDF5",
                                         file.string(), ending),
                     .remedy = "Name it .csv or .tsv for text, .h5 for HDF5."});
}

CsvWriter::CsvWriter(const std::filesystem::path& file, const std::filesystem::path& like,
                     std::vector<ColumnPlace> columns, std::span<const std::uint64_t> node_ids,
                     const NodeProperties& properties)
    : partial_(file, files::kTableFile, files::PartialFile::Writers::kOne),
      columns_(std::move(columns)),
      node_ids_(node_ids.begin(), node_ids.end()),
      properties_(properties),
      separator_(ending_of(like) == ".tsv" ? '\t' : ','),
      file_(::fdopen(::fcntl(partial_.descriptor(), F_DUPFD_CLOEXEC, 0), "w"), std::fclose) {
  if (!file_) files::refuse_to_write(file, errno);
  fmt::print(file_.get(), "time [s]{0}dt [s]{0}node_id", separator_);
  for (const auto& [field, component] : columns_) {
    const std::string unit = wire::column_row(field).unit;
    fmt::print(file_.get(), "{}{}{}", separator_, wire::quantity_of(field, component),
               unit.empty() || unit == "1" ? "" : " [" + unit + "]");
  }
  if (!properties_.initial_temperature_k.empty()) fmt::print(file_.get(), "{}initial_temperature [K]", separator_);
  if (!properties_.pair.empty()) fmt::print(file_.get(), "{}pair", separator_);
  for (const auto& [key, values] : properties_.parameters) fmt::print(file_.get(), "{}parameter/{}", separator_, key);
  fmt::print(file_.get(), "\n");
}

void CsvWriter::step(double time_s, double dt_s, std::span<const std::vector<double>> values) {
  for (std::size_t node = 0; node < node_ids_.size(); ++node) {
    fmt::memory_buffer row;
    const auto add = [&](const auto& value) { fmt::format_to(std::back_inserter(row), "{}{}", separator_, value); };
    fmt::format_to(std::back_inserter(row), "{}", time_s);
    add(dt_s);
    add(node_ids_[node]);
    for (const std::vector<double>& column : values) add(column[node]);
    if (!properties_.initial_temperature_k.empty()) add(properties_.initial_temperature_k[node]);
    if (!properties_.pair.empty()) add(properties_.pair[node]);
    for (const auto& [key, own] : properties_.parameters) add(own[node]);
    row.push_back('\n');
    if (std::fwrite(row.data(), 1, row.size(), file_.get()) != row.size())
      files::refuse_to_write(partial_.file(), errno);
  }
}

void CsvWriter::close() {
  if (std::fflush(file_.get()) != 0) files::refuse_to_write(partial_.file(), errno);
  if (std::fclose(file_.release()) != 0) files::refuse_to_write(partial_.file(), errno);
  partial_.publish();
}

}  // namespace shearbus::replay
