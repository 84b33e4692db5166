#include "proto/wire/enum_names.hpp"

#include <algorithm>

#include "proto/wire/text.hpp"

namespace shearbus::wire {
namespace {

constexpr std::uint32_t kFirstOfClient = 500;  // first of the codes that only a client raises

constexpr EnumValue kAbsentNodes[] = {
    {0, "KEEP"},
    {1, "OPEN"},
};
constexpr EnumValue kCodes[] = {
    {0, "UNSPECIFIED"},         {1, "OK"},
    {100, "BAD_FRAMING"},       {101, "MALFORMED"},
    {102, "VERSION"},           {103, "LIMIT"},
    {104, "CHECKSUM"},          {105, "SHAPE"},
    {106, "UNSUPPORTED"},       {200, "UNKNOWN_SESSION"},
    {201, "STALE_SEQUENCE"},    {202, "SEQUENCE_GAP"},
    {203, "SEQUENCE_REUSED"},   {204, "EPOCH"},
    {205, "NOTHING_TO_COMMIT"}, {206, "RESUME_REFUSED"},
    {207, "SUPERSEDED"},        {208, "UNKNOWN_MARK"},
    {209, "TRIAL_STANDS"},      {210, "UNKNOWN_TRANSFER"},
    {220, "NOT_PERMITTED"},     {300, "INVALID_SCENE"},
    {301, "INVALID_VALUE"},     {302, "UNKNOWN_NODE"},
    {303, "DUPLICATE_NODE"},    {304, "NODE_OWNED"},
    {305, "OTHER_SCENE"},       {306, "STEP_FAILED"},
    {400, "SHUTTING_DOWN"},     {401, "INTERNAL"},
    {402, "NO_SPACE"},          {403, "DRAINING"},
    {404, "CHECKPOINT_FAILED"}, {405, "RECOVERING"},
    {500, "UNREACHABLE"},       {501, "UNKNOWN_OUTCOME"},
    {502, "UNEXPECTED_REPLY"},  {503, "AUTH"},
    {504, "NOT_CLOSED"},
};
constexpr EnumValue kElements[] = {
    {0, "UNSPECIFIED"},
    {1, "FLOAT64"},
    {2, "UINT64"},
    {3, "UINT8"},
};
constexpr EnumValue kModes[] = {
    {0, "UNSPECIFIED"},
    {1, "ADVANCE"},
    {2, "TRIAL"},
};
constexpr EnumValue kOutcomes[] = {
    {kOutcomeOk, "OK"},
    {kSubstepped, "SUBSTEPPED"},
    {kMultipleRoots, "MULTIPLE_ROOTS"},
    {kOutsideDomain, "OUTSIDE_DOMAIN"},
    {kSudden, "SUDDEN"},
    {kOverBudget, "OVER_BUDGET"},
    {kAsleep, "ASLEEP"},
    {kFirstOrder, "FIRST_ORDER"},
    {kFailed, "FAILED"},
};
constexpr EnumValue kPolicies[] = {
    {0, "UNSPECIFIED"},
    {1, "ACCEPT"},
    {2, "ALL_OR_NOTHING"},
};
constexpr EnumValue kRegimes[] = {
    {0, "OPEN"}, {1, "STICK"}, {2, "COULOMB"}, {3, "TRESCA"}, {4, "MELTING"},
};
constexpr EnumValue kStrategies[] = {
    {0, "UNSPECIFIED"},
    {1, "VELOCITY_DRIVEN"},
    {2, "FORCE_DRIVEN"},
};
constexpr EnumValue kTops[] = {
    {0, "UNSPECIFIED"},
    {1, "HOTTEST"},
    {2, "FASTEST"},
    {3, "MOLTEN"},
};

}  // namespace

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

EnumNames names_of(AbsentNodes) {
  return {"AbsentNodes", kAbsentNodes};
}
EnumNames names_of(Code) {
  return {"Code", kCodes};
}
EnumNames names_of(Element) {
  return {"Element", kElements};
}
EnumNames names_of(Field) {
  return {"Field", {}};
}
EnumNames names_of(Mode) {
  return {"Mode", kModes};
}
EnumNames names_of(Outcome) {
  return {"Outcome", kOutcomes};
}
EnumNames names_of(Policy) {
  return {"Policy", kPolicies};
}
EnumNames names_of(Regime) {
  return {"Regime", kRegimes};
}
EnumNames names_of(Strategy) {
  return {"Strategy", kStrategies};
}
EnumNames names_of(Top) {
  return {"Top", kTops};
}

std::string regime_name(std::uint64_t number) {
  if (number >= kRegimeCount) return "?";
  std::string name = names_of(Regime{}).name(static_cast<std::uint32_t>(number));
  std::ranges::transform(name, name.begin(), ascii_lower);
  return name;
}

bool may_be_sent(Code type, std::uint64_t number) {
  return number < kFirstOfClient && names_of(type).has(number);
}

bool may_be_sent(Field, std::uint64_t number) {
  return number == 0 || (number <= 0xffffffffU && find_column(static_cast<Field>(number)));
}

const char* name(Code code) {
  return names_of(code).name(static_cast<std::uint32_t>(code));
}

}  // namespace shearbus::wire
