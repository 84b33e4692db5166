// The result of a replay on disk, HDF5 or CSV.
#pragma once

#include <filesystem>
#include <map>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "client/replay/bus.hpp"
#include "client/replay/csv_writer.hpp"
#include "client/replay/node_properties.hpp"
#include "proto/files/profile_record.hpp"
#include "proto/files/recording.hpp"

namespace shearbus::replay {

class ResultFile {
 public:
  // Throws Error if the file cannot be made. `start_time_s` and `meta` are for HDF5; CSV has neither.
  ResultFile(const std::filesystem::path& file, const wire::SessionOpened& opened,
             std::span<const std::uint64_t> node_ids, const NodeProperties& properties,
             const std::map<std::string, std::string>& meta, double start_time_s);

  // Writes a step: the velocity jump and the pressure that were sent, so that a result can be drawn and understood
  // without its history, and everything that was answered. The other inputs are in the history alone.
  void step(const Batch& request, const Answer& answer, double time_s, double dt_s);
  void close(const files::ProfileRecord& profiles);
  bool replaces() const { return csv_ ? csv_->replaces() : hdf5_->replaces(); }

 private:
  struct Column {
    Field field;
    std::uint32_t component;
    bool is_input;
  };
  std::vector<Column> columns_;
  std::optional<files::HistoryWriter> hdf5_;
  std::optional<CsvWriter> csv_;
  std::vector<std::vector<double>> values_;  // of a step, for CSV
};

}  // namespace shearbus::replay
