#include "client/replay/result_file.hpp"

namespace shearbus::replay {

ResultFile::ResultFile(const std::filesystem::path& file, const std::filesystem::path& like,
                       const std::vector<ColumnPlace>& columns, std::span<const std::uint64_t> node_ids,
                       const NodeProperties& properties, const std::map<std::string, std::string>& meta,
                       double start_time_s)
    : values_(columns.size()) {
  if (is_text_result(like)) {
    csv_.emplace(file, like, columns, node_ids, properties);
    return;
  }
  std::vector<files::Quantity> quantities;
  quantities.reserve(columns.size());
  for (const auto& [field, component] : columns) quantities.push_back(files::quantity_of_column(field, component));
  hdf5_.emplace(file, node_ids, std::move(quantities), meta, start_time_s);
  properties.write(*hdf5_);
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
  hdf5_ ? hdf5_->end_row() : csv_->step(time_s_, dt_s_, values_);
}

void ResultFile::close() {
  hdf5_ ? hdf5_->close() : csv_->close();
}

}  // namespace shearbus::replay
