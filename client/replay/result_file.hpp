// A table of steps and nodes on disk, HDF5 or CSV: the result of a replay, or the export of an event log.
#pragma once

#include <cstdint>
#include <cstdio>
#include <filesystem>
#include <map>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "client/replay/node_properties.hpp"
#include "proto/files/recording.hpp"
#include "proto/files/whole_file.hpp"
#include "proto/wire/messages.hpp"

namespace shearbus::replay {

using ColumnPlace = std::pair<wire::Field, std::uint32_t>;  // a component of a column

// Whether a result of this name is written as CSV: it ends in .csv or .tsv, with tabs between the values.
bool is_text_result(const std::filesystem::path& file);

// Throws Error for a name whose ending stands for a table of text when it is read, but is no ending of a result.
void refuse_ending_of_text(const std::filesystem::path& file);

class ResultFile {
 public:
  // Throws Error if the file cannot be made. `like`: a name whose ending tells how to write. `meta` and `start_time_s`
  // are for HDF5; CSV has neither, and repeats the properties of the nodes in each row.
  ResultFile(const std::filesystem::path& file, const std::filesystem::path& like,
             const std::vector<ColumnPlace>& columns, std::span<const std::uint64_t> node_ids,
             const NodeProperties& properties, const std::map<std::string, std::string>& meta, double start_time_s);

  void begin_step(double time_s, double dt_s);
  void set(std::size_t column, std::span<const double> values);
  void set(std::size_t column, std::span<const std::uint8_t> values);
  void end_step();
  void close();  // returns when the file is on the disk under its final name
  bool replaces() const { return hdf5_ ? hdf5_->replaces() : partial_->replaces(); }
  files::HistoryWriter* hdf5() { return hdf5_ ? &*hdf5_ : nullptr; }  // null: CSV

 private:
  void begin_text(const std::filesystem::path& file, const std::vector<ColumnPlace>& columns);

  std::optional<files::HistoryWriter> hdf5_;
  // Of CSV.
  std::optional<files::PartialFile> partial_;
  std::unique_ptr<std::FILE, int (*)(std::FILE*)> text_{nullptr, std::fclose};
  char separator_;
  std::vector<std::uint64_t> node_ids_;
  NodeProperties properties_;
  double time_s_ = 0.0, dt_s_ = 0.0;         // of the present step
  std::vector<std::vector<double>> values_;  // of the present step, by column
};

}  // namespace shearbus::replay
