#include "client/replay/plot.hpp"

#include <fmt/format.h>
#include <spawn.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cerrno>
#include <cstdio>
#include <stdexcept>
#include <system_error>
#include <utility>

#include "client/replay/log_export.hpp"
#include "proto/wire/event_log.hpp"

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

// A table of an event log, removed at the end.
struct Exported {
  explicit Exported(fs::path file) : table(std::move(file)) {}
  Exported(const Exported&) = delete;
  Exported& operator=(const Exported&) = delete;
  ~Exported() {
    std::error_code ignored;
    fs::remove(table, ignored);
  }
  fs::path table;
};

}  // namespace

void plot(const PlotOptions& options) {
  std::vector<std::string> words = {SHEARBUS_PYTHON, script().string(), "--out", options.out.string()};
  if (!options.node.empty()) words.insert(words.end(), {"--node", options.node});
  Exported exported(fs::path(options.out.string() + ".h5.partial"));
  for (const fs::path& file : options.files) {
    if (!wire::is_event_log(file)) {
      words.push_back(file.string());
      continue;
    }
    ExportOptions table{.log = file, .out = exported.table, .node = {}, .after_mark = {}, .version = {}};
    if (!options.node.empty()) table.node = std::stoull(options.node);
    export_log(table);
    words.push_back(exported.table.string());
  }
  run(std::move(words));
  fmt::print("{}\n", options.out.string());
}

}  // namespace shearbus::replay
