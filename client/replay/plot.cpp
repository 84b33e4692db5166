#include "client/replay/plot.hpp"

#include <fmt/format.h>
#include <spawn.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cerrno>
#include <cstdio>
#include <optional>
#include <stdexcept>
#include <system_error>
#include <utility>

#include "client/replay/log_export.hpp"
#include "proto/files/event_log.hpp"
#include "proto/files/input_file.hpp"
#include "proto/files/recording.hpp"
#include "proto/files/whole_file.hpp"
#include "proto/program/program.hpp"

namespace shearbus::replay {
namespace {

namespace fs = std::filesystem;

// The script in the tree of an installation, or in that of the sources.
fs::path script() {
  const char* const name = "plot_history.py";
  std::error_code ignored;
  const fs::path program = fs::read_symlink("/proc/self/exe", ignored);
  const fs::path installed = program.parent_path().parent_path() / "share" / "shearbus" / "report" / name;
  return fs::exists(installed, ignored) ? installed : fs::path(SHEARBUS_REPLAY_SOURCE) / ".." / "report" / name;
}

constexpr files::FileKind kPictureFile = {
    "a picture (PNG)", [](const fs::path& file) { return files::head_of(file, 8) == "\x89PNG\r\n\x1a\n"; }};

void run(std::vector<std::string> words) {
  std::vector<char*> arguments;
  arguments.reserve(words.size() + 1);
  for (std::string& word : words) arguments.push_back(word.data());
  arguments.push_back(nullptr);
  static_cast<void>(std::fflush(stdout));
  pid_t child = 0;
  if (const int fault = ::posix_spawn(&child, arguments[0], nullptr, nullptr, arguments.data(), environ); fault != 0)
    throw std::system_error(fault, std::generic_category(), "cannot start " + words[0]);
  int status = 0;
  while (::waitpid(child, &status, 0) < 0)
    if (errno != EINTR) throw std::system_error(errno, std::generic_category(), "waiting for the picture");
  if (!WIFEXITED(status) || WEXITSTATUS(status) != 0)
    throw std::runtime_error("the picture could not be drawn (see the lines above)");
}

}  // namespace

void plot(const PlotOptions& options) {
  std::vector<std::string> words = {SHEARBUS_PYTHON, script().string(), "--out", options.out.string()};
  if (options.node) words.insert(words.end(), {"--node", std::to_string(*options.node)});
  std::vector<files::InputFile> inputs;
  for (const fs::path& file : options.files) {
    const files::RegularFile regular(file);  // a pipe is refused, which would keep the program waiting
    inputs.push_back({"an input", file});
  }
  files::refuse_inputs_as_output("--out", options.out, inputs);
  files::check_output(options.out, kPictureFile);
  std::optional<files::PartialFile> exported;  // the table of an event log, which is not published
  for (const fs::path& file : options.files) {
    if (!files::is_event_log(file)) {
      words.push_back(file.string());
      continue;
    }
    exported.emplace(options.out.string() + ".h5", files::kHistoryFile, files::PartialFile::Writers::kAny);
    export_log({.log = file,
                .out = exported->path(),
                .node = options.node,
                .after_mark = {},
                .version = {},
                .final_name = exported->file()});
    words.push_back(exported->path().string());
  }
  run(std::move(words));
  fmt::print("{}\n", program::shown(options.out));
}

}  // namespace shearbus::replay
