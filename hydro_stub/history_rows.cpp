#include "hydro_stub/history_rows.hpp"

#include <utility>

#include "hydro_stub/history.hpp"

namespace shearbus::hydro {

HistoryRows::HistoryRows(std::string name, std::vector<files::Quantity> quantities, std::size_t nodes)
    : name_(std::move(name)), quantities_(std::move(quantities)), nodes_(nodes), values_(quantities_.size()) {}

void HistoryRows::begin_row(double time) {
  times_.push_back(time);
}

void HistoryRows::save(files::DumpWriter& dump) const {
  dump.numbers(name_ + "/time", times_);
  for (std::size_t q = 0; q < quantities_.size(); ++q) dump.numbers(name_ + "/" + quantities_[q].name, values_[q]);
}

void HistoryRows::load(const files::DumpReader& dump) {
  times_ = dump.numbers(name_ + "/time");
  for (std::size_t q = 0; q < quantities_.size(); ++q) {
    values_[q].resize(times_.size() * nodes_);
    dump.fill(name_ + "/" + quantities_[q].name, values_[q]);
  }
}

void HistoryRows::write(const std::filesystem::path& file, const std::map<std::string, std::string>& meta,
                        const files::ProfileRecord* profiles, std::span<const double> initial_temperature) const {
  files::HistoryWriter writer(file, node_ids(nodes_), quantities_, meta);
  if (!initial_temperature.empty())
    writer.add_static(
        {.name = "initial_temperature", .units = "K", .long_name = "temperature of the layer at the start"},
        initial_temperature);
  std::vector<std::uint8_t> codes;
  for (std::size_t row = 0; row < times_.size(); ++row) {
    writer.begin_row(times_[row]);
    for (std::size_t q = 0; q < quantities_.size(); ++q) {
      const std::span<const double> values(values_[q].data() + row * nodes_, nodes_);
      if (quantities_[q].is_regime) {
        codes.assign(values.begin(), values.end());
        writer.set(q, codes);
      } else {
        writer.set(q, values);
      }
    }
    writer.end_row();
  }
  if (profiles != nullptr) profiles->write(writer);
  writer.close();
}

}  // namespace shearbus::hydro
