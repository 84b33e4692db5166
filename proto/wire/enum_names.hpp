// Which numbers a message may carry as values of an enum, and names of regimes as texts have them.
#pragma once

#include <cstdint>
#include <string>

#include "proto/wire/columns.hpp"
#include "proto/wire/enums.hpp"

namespace shearbus::wire {

inline EnumNames names_of(Field) {  // the list of values is empty: columns.hpp has the names of the fields
  return {"Field", {}};
}

// Name of a regime as files and printed texts have it: "stick"; "?" for a number that is no regime.
std::string regime_name(std::uint64_t number);

// Returns true if a message may carry this number as a value of the enum.
template <typename E>
bool may_be_sent(E type, std::uint64_t number) {
  return names_of(type).has(number);
}
bool may_be_sent(Code type, std::uint64_t number);  // false for codes that only the client library sets
bool may_be_sent(Field type, std::uint64_t number);

}  // namespace shearbus::wire
