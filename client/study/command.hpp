// Options that the subcommands of shearbus-study have in common, and functions that write the results of a study.
#pragma once

#include <filesystem>
#include <nlohmann/json_fwd.hpp>
#include <span>
#include <string>

namespace CLI {
class App;
}

namespace shearbus::study {

struct CommandOptions {
  std::filesystem::path scene;  // file of a scene that the study uses in place of its fixed problems; empty: none
  std::filesystem::path out = "out/study";
  bool plot = true;
  std::span<const char* const> arguments;  // the command line
};

// Adds the subcommand `name` with the common options `options`; `scene` is the help text of the argument SCENE.
CLI::App* add_command(CLI::App& program, const std::string& name, const std::string& what, const std::string& scene,
                      CommandOptions& options);

// Makes the directory of a study. Throws wire::Error, before the work of the study, if write_study() could not write there.
void prepare_study(const CommandOptions& options, const std::string& name);

// Writes the study as NAME.json and, if options.plot, draws it with plot_NAME.py. The file begins with name, version,
// commit, date, processor and provenance. Throws std::runtime_error if the file cannot be written or the script fails.
void write_study(const CommandOptions& options, const std::string& name, const nlohmann::ordered_json& study);

}  // namespace shearbus::study
