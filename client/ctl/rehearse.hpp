// The command that rehearses a host: the mock server of the Python package plays test problems to it and checks how it
// couples.
#pragma once

#include <span>

namespace shearbus::ctl {

// Replaces this process by Python, which runs the rehearsal. Throws std::system_error if there is no Python.
[[noreturn]] void rehearse(std::span<char* const> arguments);

}  // namespace shearbus::ctl
