// The enums of the wire by number and name, as the schema has them: for checks of what arrives, for texts, and for the
// test that compares them with the .proto files.
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
  const char* type;  // in the schema: "Mode"
  std::span<const EnumValue> values;

  bool has(std::uint64_t number) const;
  const char* name(std::uint32_t number) const;  // "?" where it has none
  std::string choices() const;                   // "ADVANCE or TRIAL": all but number 0
};

// The names of an enum, whichever of its values is given.
EnumNames names_of(Code code);
EnumNames names_of(Element element);
EnumNames names_of(Field field);  // without values: columns.hpp has the rows
EnumNames names_of(Mode mode);
EnumNames names_of(Outcome outcome);  // the bits
EnumNames names_of(Policy policy);
EnumNames names_of(Regime regime);
EnumNames names_of(Strategy strategy);
EnumNames names_of(Top top);

// Whether a message may carry this number as a value of the enum.
template <typename E>
bool may_be_sent(E type, std::uint64_t number) {
  return names_of(type).has(number);
}
bool may_be_sent(Code type, std::uint64_t number);  // codes of the client's side are never sent
bool may_be_sent(Field type, std::uint64_t number);

}  // namespace shearbus::wire
