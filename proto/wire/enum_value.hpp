// The numbers and names of the values of an enum. enums.hpp has them for every enum of the wire.
#pragma once

#include <cstdint>
#include <span>
#include <string>

namespace shearbus::wire {

struct EnumValue {
  std::uint32_t number;
  const char* name;  // without the prefix of the schema: "TRIAL" of MODE_TRIAL
};

struct EnumNames {
  const char* type;  // name in the schema: "Mode"
  std::span<const EnumValue> values;

  bool has(std::uint64_t number) const;
  const char* name(std::uint32_t number) const;  // "?" for a number without a name
  // names of all values except number 0 (unspecified), as text: "ADVANCE or TRIAL"
  std::string choices() const;
};

}  // namespace shearbus::wire
