// Keeps the rows of a history in memory until the run ends. A restart dump stores the rows, so that a continued run
// writes the same file as a run that was never stopped.
#pragma once

#include <cstdint>
#include <filesystem>
#include <map>
#include <span>
#include <string>
#include <vector>

#include "hydro_stub/interface_law.hpp"
#include "proto/files/dump.hpp"
#include "proto/files/profile_record.hpp"
#include "proto/files/recording.hpp"

namespace shearbus::hydro {

// A column of what the law is sent or answers, as a history records it. `meaning` empty: that of the contract.
struct LawColumn {
  wire::Field field;
  const char* meaning;
  std::vector<double> InterfaceInputs::*sent = nullptr;  // without either member it is the regime
  std::vector<double> InterfaceAnswer::*answered = nullptr;

  files::Quantity quantity() const { return files::quantity_of_column(field, 0, meaning); }
  // Calls set(values) with the values of a step.
  void record(const InterfaceInputs& in, const InterfaceAnswer& answer, const auto& set) const {
    if (sent != nullptr)
      set(in.*sent);
    else if (answered != nullptr)
      set(answer.*answered);
    else
      set(answer.regime);
  }
};

class HistoryRows {
 public:
  // `name`: of the rows in restart dumps
  HistoryRows(std::string name, std::vector<files::Quantity> quantities, std::size_t nodes);

  void begin_row(double time);  // `time`: time of the row  [s]
  template <typename Values>    // Values: a range of doubles or of regimes
  void set(std::size_t quantity, const Values& values) {
    values_[quantity].insert(values_[quantity].end(), values.begin(), values.end());
  }

  void save(files::DumpWriter& dump) const;
  void load(const files::DumpReader& dump);
  void write(const std::filesystem::path& file, const std::map<std::string, std::string>& meta,
             const files::ProfileRecord* profiles = nullptr, std::span<const double> initial_temperature = {}) const;

 private:
  std::string name_;
  std::vector<files::Quantity> quantities_;
  std::size_t nodes_;
  std::vector<double> times_;
  // all rows of each quantity one after the other; a row has one value per node
  std::vector<std::vector<double>> values_;
};

}  // namespace shearbus::hydro
