// Study of tolerances: runs scenes that request a tolerance at several step lengths of the host, and random histories,
// and compares the error of each run with the requested tolerance.
#pragma once

#include <filesystem>
#include <nlohmann/json_fwd.hpp>
#include <string>
#include <vector>

#include "client/study/precision.hpp"
#include "tests/support/turning_histories.hpp"

namespace shearbus::study {

struct Tracked {
  std::string study_case;
  std::string reference;
  std::vector<Outcome> outcomes;  // one for each combination of tolerance and number of steps
};

std::vector<Tracked> track_tolerances(const std::vector<StudyCase>& cases, const SweepOptions& options);

// Random velocity-driven histories of the paper's case on a half-space, eight for each seed.
std::vector<testing::TurningAnswers> track_histories(unsigned seeds, bool quick);

std::string table(const std::vector<Tracked>& tracked);
std::string table(const std::vector<testing::TurningAnswers>& histories);
nlohmann::ordered_json json(const std::vector<Tracked>& tracked, int repeats);
nlohmann::ordered_json json(const std::vector<testing::TurningAnswers>& histories);

}  // namespace shearbus::study
