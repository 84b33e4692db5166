// Keeps the rows of a history in memory until the run ends. A restart dump stores the rows, so that a continued run
// writes the same file as a run that was never stopped.
#pragma once

#include <cstdint>
#include <filesystem>
#include <map>
#include <span>
#include <string>
#include <vector>

#include "proto/files/dump.hpp"
#include "proto/files/profile_record.hpp"
#include "proto/files/recording.hpp"

namespace shearbus::hydro {

class HistoryRows {
 public:
  HistoryRows(std::vector<files::Quantity> quantities, std::size_t nodes);

  void begin_row(double time);  // `time`: time of the row  [s]
  template <typename Values>    // Values: a range of doubles or of regimes
  void set(std::size_t quantity, const Values& values) {
    values_[quantity].insert(values_[quantity].end(), values.begin(), values.end());
  }

  void save(files::DumpWriter& dump, const std::string& name) const;
  void load(const files::DumpReader& dump, const std::string& name);
  void write(const std::filesystem::path& file, const std::map<std::string, std::string>& meta,
             const files::ProfileRecord* profiles = nullptr, std::span<const double> initial_temperature = {}) const;

 private:
  std::vector<files::Quantity> quantities_;
  std::size_t nodes_;
  std::vector<double> times_;
  // all rows of each quantity one after the other; a row has one value per node
  std::vector<std::vector<double>> values_;
};

}  // namespace shearbus::hydro
