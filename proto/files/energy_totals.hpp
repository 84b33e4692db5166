// Sums of the energy ledger over the replies of a run, and their lines in the summaries of the clients.
#pragma once

#include <array>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "proto/wire/batch.hpp"

namespace shearbus::files {

class EnergyTotals {
 public:
  // Adds the reply to one step of all nodes; a reply without the ledger columns adds nothing.
  void add(const wire::Batch& upscale);

  void add(const EnergyTotals& step);
  void add(wire::Field term, std::span<const double> values);  // adds one column of a reply

  bool empty() const { return numbers_.back() == 0.0; }
  double mean(wire::Field term) const;  // mean over the nodes of the sum over the steps  [J/m2]

  // Returns the lines of a summary, each with label and text; the residuals of the balances are relative to what is
  // balanced. No lines if no reply had the ledger.
  std::vector<std::pair<std::string, std::string>> lines() const;

  // Return the sums as plain numbers, which a restart dump saves and restores.
  std::span<double> numbers() { return numbers_; }
  std::span<const double> numbers() const { return numbers_; }

 private:
  // sum of each term over nodes and steps [J/m2]; last, the number of nodes
  std::array<double, wire::kLedgerColumns.size() + 1> numbers_{};
};

}  // namespace shearbus::files
