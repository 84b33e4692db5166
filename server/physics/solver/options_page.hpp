// The page of the options, which `shearbus-ctl options` prints from the tables in parts_table.hpp and from the lists of laws.
#pragma once

#include <string>

namespace shearbus::physics {

// Returns the page as Markdown.
std::string options_page();

}  // namespace shearbus::physics
