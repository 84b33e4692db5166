#include "proto/program/python.hpp"

#include <spawn.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cerrno>
#include <csignal>
#include <cstdio>
#include <cstring>
#include <stdexcept>
#include <system_error>

#include "proto/program/interrupt.hpp"

namespace shearbus::program {
namespace {

[[noreturn]] void fail(int code, const char* doing) {
  throw std::system_error(code, std::generic_category(), doing + std::string(SHEARBUS_PYTHON) + " (package python3)");
}

// The arguments as the system takes them. They point into `words`.
std::vector<char*> command(std::vector<std::string>& words) {
  words.insert(words.begin(), SHEARBUS_PYTHON);
  std::vector<char*> pointers;
  pointers.reserve(words.size() + 1);
  for (std::string& word : words) pointers.push_back(word.data());
  pointers.push_back(nullptr);
  static_cast<void>(std::fflush(stdout));  // the text printed so far appears before that of Python
  return pointers;
}

}  // namespace

std::filesystem::path script(const char* room, const std::string& name) {
  namespace fs = std::filesystem;
  std::error_code ignored;
  const fs::path program = fs::read_symlink("/proc/self/exe", ignored);
  const fs::path installed = program.parent_path().parent_path() / "share" / "shearbus" / room / name;
  return fs::exists(installed, ignored) ? installed : fs::path(SHEARBUS_CLIENT_SOURCE) / room / name;
}

bool run_python(std::vector<std::string> words) {
  pid_t child = 0;
  if (const int fault = ::posix_spawn(&child, SHEARBUS_PYTHON, nullptr, nullptr, command(words).data(), environ))
    fail(fault, "cannot start ");
  int status = 0;
  while (::waitpid(child, &status, 0) < 0)
    if (errno != EINTR) fail(errno, "waiting for ");
  if (WIFSIGNALED(status) && !interrupted())  // nobody has told the user
    throw std::runtime_error(SHEARBUS_PYTHON + std::string(" was ended: ") + ::strsignal(WTERMSIG(status)) +
                             (WTERMSIG(status) == SIGKILL ? ", as the system does where memory ends" : ""));
  return WIFEXITED(status) && WEXITSTATUS(status) == 0;
}

void become_python(std::vector<std::string> words) {
  ::execv(SHEARBUS_PYTHON, command(words).data());
  fail(errno, "cannot start ");
}

}  // namespace shearbus::program
