// Units of files: which are known, and the factor to SI.
#pragma once

#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "proto/wire/columns.hpp"

namespace shearbus::wire {

// The quantities of steps by name, each component of its own, and the rows of their columns.
std::vector<std::pair<std::string, const ColumnRow*>> quantities();

// The SI unit of a quantity of a history, "" for one without a unit; null if no history has a quantity of this name.
const char* unit_of_quantity(std::string_view name);

// Returns the factor from `unit` to the SI unit `si`, or nothing for a unit that is unknown or of another quantity. All
// usual ways to write a unit are read: "kg/m2", "kg/m^2", "kg m-2", "kg m**-2" and "kg.m-2" are one unit.
std::optional<double> factor_to_si(std::string_view unit, std::string_view si);

// The known units of a quantity whose SI unit is `si`: "Pa, kPa, MPa, GPa, bar, kbar, Mbar".
std::string known_units(std::string_view si);

}  // namespace shearbus::wire
