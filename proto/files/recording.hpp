// Histories on disk: HDF5 files that h5py can open. recording.md in this directory describes the layout.
//
//   /time [T] s, /node_id [N], /<name> [T,N] with attribute `units`, /meta with attributes format, created, scene
//   (TOML text), ...
//
// T is the number of steps, N the number of nodes.
//
// Functions throw wire::Error with the file in the text, kNoSpace for a full disk. A writer works on a partial
// file and renames it when closed (whole_file.hpp), so that an interrupted run leaves no file that looks complete.
#pragma once

#include <cstdint>
#include <filesystem>
#include <map>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "proto/files/whole_file.hpp"
#include "proto/wire/columns.hpp"

namespace shearbus::files {

struct Quantity {
  std::string name;         // name of the dataset
  std::string units;        // UDUNITS text; empty: the name tells the unit
  std::string long_name;    // description in one line
  bool is_regime = false;   // true: the values are regimes, stored as uint8 with an enum of their names
  bool is_outcome = false;  // true: the values are outcomes, stored as uint8 with the bits of Outcome
};

// Describes the dataset of a history that stores one component of a column. If `long_name` is empty, it is the column's
// meaning in columns.inc.
Quantity quantity_of_column(wire::Field field, std::uint32_t component = 0, const std::string& long_name = {});

// A history as an output: an HDF5 file with /meta as HistoryWriter writes it.
extern const FileKind kHistoryFile;

class HistoryWriter {
 public:
  // `meta` is written to /meta, together with format, version, created and units_system: a text of one line as an
  // attribute, a longer text (the scene) as a scalar dataset. Rows are buffered until they fill 64 KiB per
  // dataset, or one by one if a row is longer; a dataset of rows exists in the file from then on.
  HistoryWriter(const std::filesystem::path& file, std::span<const std::uint64_t> node_ids,
                std::vector<Quantity> quantities, const std::map<std::string, std::string>& meta,
                double start_time_s = 0.0);
  HistoryWriter(HistoryWriter&&) noexcept;
  HistoryWriter& operator=(HistoryWriter&&) noexcept;
  ~HistoryWriter();       // removes the partial file unless the writer was closed
  bool replaces() const;  // whether there is an older file of the name

  // Begins the row of the step that ends at `time_s`; times increase. `dt_s` is for hosts whose dt is not exactly the
  // difference of two times; either all rows have it or none.
  void begin_row(double time_s, std::optional<double> dt_s = std::nullopt);
  void set(std::size_t quantity, std::span<const double> values);        // `quantity`: index into `quantities`
  void set(std::size_t quantity, std::span<const std::uint8_t> values);  // sets a regime or an outcome
  void end_row();                                                        // throws unless every quantity was set

  // Writes a dataset of one dimension and any length, such as one mass per node.
  void add_static(const Quantity& quantity, std::span<const double> values);
  // Write a dataset of any shape that is no row of the history, such as "profiles/time": a group is made where it is
  // missing.
  void add_array(const Quantity& quantity, std::span<const double> values, const std::vector<std::size_t>& shape);
  void add_ids(const Quantity& quantity, std::span<const std::uint64_t> ids);
  void add_texts(const Quantity& quantity, std::span<const std::string> texts);  // one for each node
  // Returns when the file is on the disk under its final name. An older history of that name is replaced.
  void close(const std::map<std::string, std::string>& closing_meta = {});

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

// Reads a history from disk. The values of a step are read only when row() asks for them.
class HistoryReader {
 public:
  explicit HistoryReader(std::filesystem::path file);
  HistoryReader(HistoryReader&&) noexcept;
  HistoryReader& operator=(HistoryReader&&) noexcept;
  ~HistoryReader();

  std::size_t steps() const { return axes_->times.size(); }
  std::size_t nodes() const { return axes_->node_ids.size(); }
  // start of the first step: attribute t0 of /time; absent: by /dt, or 0
  double start_time_s() const { return axes_->start_time; }
  bool tells_start() const { return axes_->has_start || has("dt"); }   // whether the file has t0 or /dt
  const std::vector<double>& times_s() const { return axes_->times; }  // end of each step; checked to increase strictly
  // length of each step: /dt [T] if present (checked against /time), otherwise the differences of /time
  const std::vector<double>& dt_s() const { return axes_->dts; }
  const std::vector<std::uint64_t>& node_ids() const { return axes_->node_ids; }  // checked to be unique
  bool has(std::string_view name) const;
  std::vector<double> per_node(std::string_view name) const;        // one value per node, all checked to be finite
  std::vector<std::string> texts(std::string_view name) const;      // one text per node
  std::vector<std::string> names_in(std::string_view group) const;  // names in a group, "": the file; none if absent
  // reads the values of one step, one per node; all checked to be finite
  void row(std::string_view name, std::size_t step, std::span<double> values);
  std::optional<std::string> meta(std::string_view name) const;

 private:
  struct Axes {  // what is read when the file is opened
    double start_time = 0.0;
    bool has_start = false;  // whether the file has the attribute t0 of /time
    std::vector<double> times, dts;
    std::vector<std::uint64_t> node_ids;
  };
  struct Impl;
  std::unique_ptr<Impl> impl_;
  const Axes* axes_;  // of impl_
};

// Returns the hash of a file's bytes, "xxh3-64:" and 16 hexadecimal digits: what `xxhsum -H3` prints.
std::string hash_of_file(const std::filesystem::path& file);

}  // namespace shearbus::files
