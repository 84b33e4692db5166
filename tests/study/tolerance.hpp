// Study of tolerances: runs scenes that request a tolerance at several step lengths of the host, and compares the error
// of each run with the requested tolerance.
#pragma once

#include <filesystem>
#include <nlohmann/json_fwd.hpp>
#include <string>
#include <vector>

#include "tests/study/precision.hpp"

namespace shearbus::study {

struct Tracked {
  std::string study_case;
  std::string reference;
  std::vector<Outcome> outcomes;  // one for each combination of tolerance and number of steps
};

std::vector<Tracked> track_tolerances(const std::vector<StudyCase>& cases, const SweepOptions& options);

std::string table(const std::vector<Tracked>& tracked);
nlohmann::ordered_json json(const std::vector<Tracked>& tracked, int repeats);

}  // namespace shearbus::study
