#include "client/replay/result_file.hpp"

#include <algorithm>

namespace shearbus::replay {

ResultFile::ResultFile(const std::filesystem::path& file, const wire::SessionOpened& opened,
                       std::span<const std::uint64_t> node_ids, const NodeProperties& properties,
                       const std::map<std::string, std::string>& meta, double start_time_s) {
  refuse_ending_of_text(file);
  const auto add = [&](Field field, bool is_input) {
    for (std::uint32_t component = 0; component < (wire::is_tangential(field) ? opened.tangential_components : 1);
         ++component)
      columns_.push_back({field, component, is_input});
  };
  for (const Field field : {Field::kPressure, Field::kVelocityJump}) add(field, true);
  for (const Field field : opened.reply_columns) add(field, false);
  if (is_text_result(file)) {
    std::vector<ColumnPlace> places;
    for (const Column& column : columns_) places.emplace_back(column.field, column.component);
    csv_.emplace(file, file, std::move(places), node_ids, properties);
    values_.resize(columns_.size());
    return;
  }
  std::vector<files::Quantity> quantities;
  for (const Column& column : columns_) quantities.push_back(files::quantity_of_column(column.field, column.component));
  hdf5_.emplace(file, node_ids, std::move(quantities), meta, start_time_s);
  properties.write(*hdf5_);
}

void ResultFile::step(const Batch& request, const Answer& answer, double time_s, double dt_s) {
  if (hdf5_) hdf5_->begin_row(time_s, dt_s);
  for (std::size_t i = 0; i < columns_.size(); ++i) {
    const auto [field, component, is_input] = columns_[i];
    const Batch& batch = is_input ? request : answer.columns;
    const auto put = [&](const auto& column) {
      if (hdf5_)
        hdf5_->set(i, column);
      else
        values_[i].assign(column.begin(), column.end());
    };
    if (wire::element_of(field) == wire::Element::kUint8)
      put(batch.u8(field, component));
    else
      put(batch.f64(field, component));
  }
  if (hdf5_)
    hdf5_->end_row();
  else
    csv_->step(time_s, dt_s, values_);
}

void ResultFile::close(const files::ProfileRecord& profiles) {
  if (csv_) return csv_->close();
  profiles.write(*hdf5_);
  hdf5_->close();
}

}  // namespace shearbus::replay
