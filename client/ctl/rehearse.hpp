// The conformity kit of the Python package, as a command of this program.
#pragma once

#include <span>

namespace shearbus::ctl {

// Becomes Python with the kit, which gets the arguments. Throws std::system_error if there is no Python.
[[noreturn]] void rehearse(std::span<char* const> arguments);

}  // namespace shearbus::ctl
