// Functions that a program calls first and last if it writes files or prints to its standard output.
#pragma once

#include <fcntl.h>
#include <unistd.h>

#include <csignal>
#include <cstdio>
#include <string>

namespace shearbus::wire {

// Must be called first. A write beyond the limit of the file size then fails with an error and does not end the
// process. Standard streams that the caller has closed are opened on /dev/null; otherwise the next file that the
// program opens would receive what is printed.
inline void begin_program() {
  static_cast<void>(std::signal(SIGXFSZ, SIG_IGN));
  for (int stream = STDIN_FILENO; stream <= STDERR_FILENO; ++stream)
    // open() takes the lowest free number, which is that of the closed stream.
    if (::fcntl(stream, F_GETFD) < 0) static_cast<void>(::open("/dev/null", O_RDWR));
}

// Prints a line to standard error. A failure to print is ignored.
inline void complain(const std::string& line) noexcept {
  static_cast<void>(std::fputs((line + '\n').c_str(), stderr));
}

// Returns `code`. If not everything that was printed has reached standard output, complains and returns 1 in place of
// 0.
inline int end_program(const std::string& program, int code) {
  if (std::fflush(stdout) == 0 && std::ferror(stdout) == 0) return code;
  complain(program + ": standard output could not be written: its results are not complete");
  return code != 0 ? code : 1;
}

}  // namespace shearbus::wire
