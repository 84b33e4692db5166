// The numbers and names of the enums of the wire, as in the schema. They are used to check received numbers and to name
// values in texts; a test checks that they agree with the .proto files.
#pragma once

#include <cstdint>
#include <span>
#include <string>

#include "proto/wire/messages.hpp"

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

// Returns the names of an enum. The argument selects the enum; its value does not matter.
EnumNames names_of(AbsentNodes absent);
EnumNames names_of(Code code);
EnumNames names_of(Element element);
EnumNames names_of(Field field);  // the list of values is empty: columns.hpp has the names of the fields
EnumNames names_of(Mode mode);
EnumNames names_of(Outcome outcome);  // names of the bits of an outcome
EnumNames names_of(Policy policy);
EnumNames names_of(Regime regime);
EnumNames names_of(Strategy strategy);
EnumNames names_of(Top top);

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
