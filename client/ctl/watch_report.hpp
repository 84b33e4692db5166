// State of a server as shearbus-ctl watch prints it.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "client/ctl/operations.hpp"
#include "client/ctl/operator.hpp"

namespace shearbus::ctl {

// The answers of a server to one look.
struct Sample : Told {
  std::vector<Json> sessions = {};  // those with the most nodes first; only an operator sees them
  // Of each of the hottest nodes "session", as of label_of(), "node", "interface_temperature_k", and "regime" by name.
  std::vector<Json> hottest = {};
};

// What is shown of a look: the state, and the rates since the look before.
struct Report {
  const Sample* sample = nullptr;  // null: no answer
  Json line;                       // as shearbus-ctl watch --json prints it; without an answer "fault" says why
};

// The name of a session's scene, and the first digits of the session's id.
std::string label_of(const Json& session);

// Asks for the sessions and the hottest nodes, for which the server looks at every node.
void inspect(Operator& server, Sample& sample);

Report report_of(const Sample& now, const std::optional<Sample>& before);
Report report_of(const Error& fault);  // no answer

std::string line_of(const Report& report);

// Parts of the texts.
std::optional<double> number(const Report& report, const char* field);  // of the line; nothing: null
std::string scaled(std::optional<double> value);
std::uint64_t nodes_in_regimes(const Json& status);
double percent(std::uint64_t part, std::uint64_t all);
std::string age_of_checkpoint(const Json& status);

}  // namespace shearbus::ctl
