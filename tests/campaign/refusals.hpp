// Invalid requests to a service: each must be refused with a reason that names the field at fault, and must change
// nothing.
#pragma once

#include <string>
#include <vector>

namespace shearbus::study::stability {

struct Refusal {
  std::string name;   // the invalid request
  std::string field;  // field that the refusal must name
  std::string named;  // field that the service's refusal named; empty: the request was not refused
  std::string text;   // reason in the refusal
  bool seen() const { return named == field && !text.empty(); }
};
std::vector<Refusal> run_refusals();

}  // namespace shearbus::study::stability
