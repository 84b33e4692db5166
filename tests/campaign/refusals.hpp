// Inputs that make no sense, asked of a service as a host would: each must be refused with a reason that names what is
// wrong, and change nothing.
#pragma once

#include <string>
#include <vector>

namespace shearbus::study::stability {

struct Refusal {
  std::string name;   // what was sent
  std::string field;  // what has to be named
  std::string named;  // what was named; empty: it was not refused
  std::string text;   // the reason given
  bool seen() const { return named == field && !text.empty(); }
};
std::vector<Refusal> run_refusals();

}  // namespace shearbus::study::stability
