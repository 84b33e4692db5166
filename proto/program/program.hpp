// Functions that a program calls first and last if it writes files or prints to its standard output.
#pragma once

#include <fcntl.h>
#include <unistd.h>

#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <exception>
#include <filesystem>
#include <string>

#include "proto/wire/status.hpp"
#include "proto/wire/text.hpp"

namespace shearbus::program {

// Must be called first. A write beyond the limit of the file size then fails with an error and does not end the
// process. Standard streams that the caller has closed are opened on /dev/null; otherwise the next file that the
// program opens would receive what is printed.
inline void begin_program() {
  static_cast<void>(std::signal(SIGXFSZ, SIG_IGN));
  for (int stream = STDIN_FILENO; stream <= STDERR_FILENO; ++stream)
    // open() takes the lowest free number, which is that of the closed stream.
    if (::fcntl(stream, F_GETFD) < 0) static_cast<void>(::open("/dev/null", O_RDWR));
}

// Prints a text to standard error, without commands to a terminal. A failure to print is ignored.
inline void complain(const std::string& text) noexcept try {
  static_cast<void>(std::fputs((wire::printable_lines(text) + '\n').c_str(), stderr));
} catch (const std::exception&) {  // no memory for the text
}

// Prints what has ended a program: one line, whatever names it quotes, or the list of a scene's faults.
inline void complain(const std::string& program, const std::exception& fault) noexcept try {
  constexpr std::size_t kLongest = std::size_t{16} << 10;
  const auto* refusal = dynamic_cast<const wire::Error*>(&fault);
  const bool list = refusal != nullptr && refusal->status().code == wire::Code::kInvalidScene;
  complain(program + ": " + (list ? fault.what() : wire::printable(fault.what(), kLongest)));
} catch (const std::exception&) {
}

// The name of a file, for a terminal.
inline std::string shown(const std::filesystem::path& file) {
  constexpr std::size_t kLongest = 4096;
  return wire::printable(file.string(), kLongest);
}

// Returns `code`. If not everything that was printed has reached standard output, complains and returns 1 in place of
// 0.
inline int end_program(const std::string& program, int code) {
  if (std::fflush(stdout) == 0 && std::ferror(stdout) == 0) return code;
  complain(program + ": standard output could not be written: its results are not complete");
  return code != 0 ? code : 1;
}

}  // namespace shearbus::program
