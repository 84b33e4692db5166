#include "tests/study/command.hpp"
#include "shearbus_places.hpp"

#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <stdexcept>

namespace shearbus::study {

CLI::App* add_command(CLI::App& program, const std::string& name, const std::string& what, const std::string& scene,
                      CommandOptions& options) {
  CLI::App* command = program.add_subcommand(name, what);
  command->add_option("scene", options.scene, scene)->check(CLI::ExistingFile);
  command->add_option("--out", options.out, fmt::format("directory of {0}.json and {0}.png", name))
      ->capture_default_str();
  command->add_flag("!--no-plot", options.plot, "write no picture");
  return command;
}

void write_study(const CommandOptions& options, const std::string& name, const std::string& json) {
  std::filesystem::create_directories(options.out);
  const auto path = options.out / (name + ".json");
  std::ofstream file(path);
  file << json;
  file.close();
  if (!file) throw std::runtime_error("cannot write " + path.string());
  fmt::print("\nwritten: {}\n", path.string());
  static_cast<void>(std::fflush(stdout));
  if (!options.plot) return;
  const std::string command = fmt::format("\"{}\" \"{}/tests/study/plot_{}.py\" \"{}\"", SHEARBUS_PYTHON,
                                          SHEARBUS_SOURCE_DIR, name, path.string());
  if (std::system(command.c_str()) != 0)  // NOLINT(cert-env33-c): the user's own file names
    throw std::runtime_error("the picture was not made; the study is whole in " + path.string());
}

}  // namespace shearbus::study
