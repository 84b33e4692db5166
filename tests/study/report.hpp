// What all studies write alike.
#pragma once

#include <string>
#include <string_view>

namespace shearbus::study {

std::string number(double value);                // as JSON has it; null: none
std::string provenance(std::string_view study);  // keys of a JSON object: study, version, commit, date, processor

}  // namespace shearbus::study
