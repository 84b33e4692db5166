// What the studies have in common as commands: a scene to take, where to write, and whether to draw.
#pragma once

#include <filesystem>
#include <string>

namespace CLI {
class App;
}

namespace shearbus::study {

struct CommandOptions {
  std::filesystem::path scene;  // empty: none
  std::filesystem::path out = "out/study";
  bool plot = true;
};

// Adds the subcommand `name` with these options; `scene` says what a scene is taken for.
CLI::App* add_command(CLI::App& program, const std::string& name, const std::string& what, const std::string& scene,
                      CommandOptions& options);

// Writes a study as NAME.json and draws it with plot_NAME.py.
void write_study(const CommandOptions& options, const std::string& name, const std::string& json);

}  // namespace shearbus::study
