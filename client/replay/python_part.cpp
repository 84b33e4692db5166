#include "client/replay/python_part.hpp"

#include <unistd.h>

#include <cerrno>
#include <cstdlib>
#include <memory>
#include <stdexcept>
#include <string>
#include <system_error>

#include "proto/program/interrupt.hpp"
#include "proto/program/python.hpp"

namespace shearbus::replay {

namespace fs = std::filesystem;

fs::path script(const char* room, const char* name) {
  std::error_code ignored;
  const fs::path program = fs::read_symlink("/proc/self/exe", ignored);
  const fs::path installed = program.parent_path().parent_path() / "share" / "shearbus" / room / name;
  return fs::exists(installed, ignored) ? installed : fs::path(SHEARBUS_REPLAY_SOURCE) / ".." / room / name;
}

files::HistoryReader read_text(const fs::path& file, const std::string& columns, bool points) {
  const char* const place = std::getenv("TMPDIR");
  std::string name = fs::path(place != nullptr ? place : "/tmp") / "shearbus-history-XXXXXX";
  const int descriptor = ::mkstemp(name.data());
  if (descriptor < 0)
    throw std::system_error(errno, std::generic_category(), "TMPDIR names no directory for a file such as " + name);
  // Whatever ends first, nothing is left: the file has no name, and Python inherits its descriptor.
  ::unlink(name.c_str());
  const auto close = [](const int* opened) { ::close(*opened); };
  const std::unique_ptr<const int, decltype(close)> closed(&descriptor, close);
  const std::string made = "/proc/self/fd/" + std::to_string(descriptor);
  if (program::run_python({script("replay", "tables.py"), "read", points ? "--points" : "--steps", "--out", made,
                           "--columns=" + columns, "--", file}))
    return files::HistoryReader(made);
  if (program::interrupted()) throw std::runtime_error("interrupted; no result is written");
  throw Told();
}

}  // namespace shearbus::replay
