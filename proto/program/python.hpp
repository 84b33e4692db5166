// Programs in Python, by Debian's interpreter, that a program of ours runs or becomes.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

namespace shearbus::program {

// A program in Python of this installation, or of the sources; `room` is that of its sources below client/.
std::filesystem::path script(const char* room, const std::string& name);

// Runs Python with these arguments and waits for its end. Returns whether it succeeded. Throws std::system_error if it
// cannot be started, std::runtime_error if a signal ends it that does not end this program.
bool run_python(std::vector<std::string> words);

// Replaces the calling program by Python with these arguments.
[[noreturn]] void become_python(std::vector<std::string> words);

}  // namespace shearbus::program
