// Profiles of some nodes across their layers at chosen times: the group /profiles of a history (recording.md). The
// record is kept in memory until the run ends; a restart dump stores it, so that a continued run writes the same file
// as a run that was never stopped.
#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "proto/files/dump.hpp"
#include "proto/files/recording.hpp"
#include "proto/wire/batch.hpp"

namespace shearbus::files {

class ProfileRecord {
 public:
  // A record without nodes or without times stays empty. `times_s` may have any order.
  ProfileRecord(std::vector<std::uint64_t> node_ids, std::vector<double> times_s);

  const std::vector<std::uint64_t>& node_ids() const { return node_ids_; }
  // The last of the times; 0 without any  [s]
  double last_s() const { return times_s_.empty() ? 0.0 : times_s_.back(); }
  // Whether a step that ends at `time_s` is the first one at or after a time that was asked for.
  bool due(double time_s) const;
  // Adds the profiles at the end of a step: the rows of a reply to read_profiles with these nodes, and the pressures
  // that it was asked with  [Pa].
  void add(double time_s, const wire::Batch& rows, std::span<const double> pressure_pa);

  bool empty() const { return taken_s_.empty(); }
  void write(HistoryWriter& writer) const;
  void save(DumpWriter& dump) const;
  void load(const DumpReader& dump);

 private:
  std::vector<std::uint64_t> node_ids_;
  std::vector<double> times_s_;  // ascending
  std::size_t next_ = 0;         // index of the next time in times_s_
  std::vector<double> taken_s_;  // time of each entry
  std::vector<double> pressure_;
  std::vector<wire::Column> columns_;        // of the replies; empty before the first one
  std::vector<std::vector<double>> values_;  // of each column: [entry][node][vertex]
};

}  // namespace shearbus::files
