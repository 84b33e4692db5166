// A table of steps and nodes on disk, HDF5 or CSV: the result of a replay, or the export of an event log.
#pragma once

#include <filesystem>
#include <map>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "client/replay/csv_writer.hpp"
#include "client/replay/node_properties.hpp"
#include "proto/files/recording.hpp"

namespace shearbus::replay {

class ResultFile {
 public:
  // Throws Error if the file cannot be made. `like`: a name whose ending tells how to write. `meta` and `start_time_s`
  // are for HDF5; CSV has neither.
  ResultFile(const std::filesystem::path& file, const std::filesystem::path& like,
             const std::vector<ColumnPlace>& columns, std::span<const std::uint64_t> node_ids,
             const NodeProperties& properties, const std::map<std::string, std::string>& meta, double start_time_s);

  void begin_step(double time_s, double dt_s);
  void set(std::size_t column, std::span<const double> values);
  void set(std::size_t column, std::span<const std::uint8_t> values);
  void end_step();
  void close();
  bool replaces() const { return csv_ ? csv_->replaces() : hdf5_->replaces(); }
  files::HistoryWriter* hdf5() { return hdf5_ ? &*hdf5_ : nullptr; }  // null: CSV

 private:
  std::optional<files::HistoryWriter> hdf5_;
  std::optional<CsvWriter> csv_;
  double time_s_ = 0.0, dt_s_ = 0.0;         // of the present step, for CSV
  std::vector<std::vector<double>> values_;  // likewise
};

}  // namespace shearbus::replay
