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

files::HistoryReader read_text(const fs::path& file, const std::string& columns, bool points) {
  const char* const place = std::getenv("TMPDIR");
  std::string made = fs::path(place != nullptr ? place : "/tmp") / "shearbus-history-XXXXXX";
  const int descriptor = ::mkstemp(made.data());
  if (descriptor < 0)
    throw std::system_error(errno, std::generic_category(), "TMPDIR names no directory for a file such as " + made);
  ::close(descriptor);
  const auto remove = [](const std::string* name) { ::unlink(name->c_str()); };  // its reader keeps it open
  const std::unique_ptr<std::string, decltype(remove)> removed(&made, remove);
  if (program::run_python({program::script("replay", "tables.py"), "read", points ? "--points" : "--steps", "--out",
                           made, "--parent=" + std::to_string(::getpid()), "--columns=" + columns, "--", file}))
    return files::HistoryReader(made);
  if (program::interrupted()) throw std::runtime_error("interrupted; no result is written");
  throw Told();
}

}  // namespace shearbus::replay
