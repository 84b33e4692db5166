// State of a server as shearbus-ctl watch prints it.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "client/ctl/operations.hpp"
#include "client/ctl/operator.hpp"

namespace shearbus::ctl {

struct HotNode {
  std::string session;  // name of its scene, and the first digits of its id
  std::uint64_t node = 0;
  double temperature_k = 0.0;
  std::size_t regime = 0;
};

// The answers of a server to one look.
struct Sample : Told {
  std::vector<wire::SessionInfo> sessions = {};  // those with the most nodes first; only an operator sees them
  std::vector<HotNode> hottest = {};
};

// What is shown of a look: the state, and the rates since the look before.
struct Report {
  const Sample* sample = nullptr;  // null: no answer
  std::string fault;               // why there is no answer
  std::optional<double> node_steps_per_s, requests_per_s, journal_bytes_per_s, solver_share;
  std::optional<double> half_below_s, most_below_s;  // of the steps since the look before: 50 % and 99 % took less
};

std::string label_of(const wire::SessionInfo& session);

// Asks for the sessions and the hottest nodes, for which the server looks at every node.
void inspect(Operator& server, Sample& sample);

Report report_of(const Sample& now, const std::optional<Sample>& before);

std::string line_of(const Report& report);
std::string json_of(const Report& report);

// Parts of the texts.
std::string scaled(double value);
std::string scaled(const std::optional<double>& value);
std::uint64_t nodes_in_regimes(const wire::ServerStatus& status);
double percent(std::uint64_t part, std::uint64_t all);
std::string age_of_checkpoint(const wire::ServerStatus& status);

}  // namespace shearbus::ctl
