#include "client/study/command.hpp"

#include <fmt/chrono.h>
#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <cstdio>
#include <ctime>
#include <fstream>
#include <nlohmann/json.hpp>
#include <stdexcept>

#include "proto/files/whole_file.hpp"
#include "proto/program/program.hpp"
#include "proto/program/python.hpp"
#include "server/version.hpp"
#include "shearbus_places.hpp"

namespace shearbus::study {
namespace {

std::string processor() {
  std::ifstream file("/proc/cpuinfo");
  for (std::string line; std::getline(file, line);)
    if (line.starts_with("model name")) return line.substr(line.find(':') + 2);
  return "unknown";
}

}  // namespace

CLI::App* add_command(CLI::App& program, const std::string& name, const std::string& what, const std::string& scene,
                      CommandOptions& options) {
  CLI::App* command = program.add_subcommand(name, what);
  command->add_option("scene", options.scene, scene)->check(CLI::ExistingFile);
  command->add_option("--out", options.out, fmt::format("directory of {0}.json and {0}.png", name))
      ->capture_default_str();
  command->add_flag("!--no-plot", options.plot, "write no picture");
  return command;
}

void prepare_study(const CommandOptions& options, const std::string& name) {
  const files::OneWriter probe(options.out);
  files::check_output(options.out / (name + ".json"), files::kSummaryFile);
}

void write_study(const CommandOptions& options, const std::string& name, const nlohmann::ordered_json& study) {
  nlohmann::ordered_json out = {{"study", name},
                                {"version", SHEARBUS_RELEASE},
                                {"commit", server::kCommit},
                                {"date", fmt::format("{:%Y-%m-%d}", fmt::gmtime(std::time(nullptr)))},
                                {"processor", processor()}};
  for (const auto& [key, value] : server::provenance("shearbus-study", options.scene.string(), options.arguments))
    out["provenance"][key] = value;
  out.update(study);
  const auto path = options.out / (name + ".json");
  files::write_whole(path, files::kSummaryFile,
                     out.dump(1, ' ', false, nlohmann::ordered_json::error_handler_t::replace) + '\n');
  fmt::print("\nwritten: {}\n", path.string());
  static_cast<void>(std::fflush(stdout));
  if (!options.plot) return;
  if (!program::run_python({program::script("study", "plot_" + name + ".py"), path.string()}))
    throw std::runtime_error("the picture was not made; the study is whole in " + path.string());
}

}  // namespace shearbus::study
