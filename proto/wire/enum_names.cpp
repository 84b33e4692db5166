#include "proto/wire/enum_names.hpp"

#include <algorithm>

#include "proto/wire/text.hpp"

namespace shearbus::wire {
bool EnumNames::has(std::uint64_t number) const {
  return std::ranges::any_of(values, [&](const EnumValue& value) { return value.number == number; });
}

const char* EnumNames::name(std::uint32_t number) const {
  const auto found = std::ranges::find(values, number, &EnumValue::number);
  return found == values.end() ? "?" : found->name;
}

std::string EnumNames::choices() const {
  std::string text;
  for (const EnumValue& value : values)
    if (value.number != 0)
      text += (text.empty() ? "" : &value == &values.back() ? " or " : ", ") + std::string(value.name);
  return text;
}

std::string regime_name(std::uint64_t number) {
  if (number >= kRegimeCount) return "?";
  std::string name = names_of(Regime{}).name(static_cast<std::uint32_t>(number));
  std::ranges::transform(name, name.begin(), ascii_lower);
  return name;
}

bool may_be_sent(Code type, std::uint64_t number) {
  return number < kFirstClientCode && names_of(type).has(number);
}

bool may_be_sent(Field, std::uint64_t number) {
  return number == 0 || (number <= 0xffffffffU && find_column(static_cast<Field>(number)));
}

const char* name(Code code) {
  return names_of(code).name(static_cast<std::uint32_t>(code));
}

}  // namespace shearbus::wire
