// The enums of the code must have the same names and values as those of the schema, and neither side may have more.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cctype>
#include <fstream>
#include <iterator>
#include <map>
#include <regex>
#include <string>

#include "proto/wire/columns.hpp"
#include "proto/wire/enum_names.hpp"
#include "shearbus_places.hpp"

namespace shearbus::wire {
namespace {

using Values = std::map<std::string, std::uint32_t>;  // number of each value, by its name without the enum's prefix
using Enums = std::map<std::string, Values>;

std::string upper_case(std::string text) {
  std::ranges::transform(text, text.begin(), [](unsigned char c) { return static_cast<char>(std::toupper(c)); });
  return text;
}

// Reads the enums of a schema file: "enum Mode { MODE_TRIAL = 2; }" -> {"Mode", {{"TRIAL", 2}}}.
Enums enums_of_schema(const std::string& file) {
  std::ifstream in(std::string(SHEARBUS_SOURCE_DIR) + "/proto/shearbus/v1/" + file);
  std::string text{std::istreambuf_iterator<char>(in), {}};
  text = std::regex_replace(text, std::regex("//[^\n]*"), "");
  Enums enums;
  const std::regex block("enum (\\w+) \\{([^}]*)\\}");
  const std::regex value("(\\w+)\\s*=\\s*(\\d+)\\s*;");
  for (std::sregex_iterator found(text.begin(), text.end(), block); found != std::sregex_iterator(); ++found) {
    const std::string type = (*found)[1];
    const std::string body = (*found)[2];
    const std::string prefix = upper_case(std::regex_replace(type, std::regex("([a-z])([A-Z])"), "$1_$2")) + "_";
    for (std::sregex_iterator row(body.begin(), body.end(), value); row != std::sregex_iterator(); ++row) {
      const std::string name = (*row)[1];
      EXPECT_TRUE(name.starts_with(prefix)) << name;
      enums[type][name.substr(prefix.size())] = static_cast<std::uint32_t>(std::stoul((*row)[2]));
    }
  }
  return enums;
}

template <typename E>
void add(Enums& enums) {
  const EnumNames names = names_of(E{});
  for (const EnumValue& value : names.values)
    if (may_be_sent(E{}, value.number)) enums[names.type][value.name] = value.number;
}

TEST(Names, OfEveryEnumAreThoseOfTheSchema) {
  Enums schema;
  for (const char* file : {"control.proto", "downscale.proto", "envelope.proto"}) schema.merge(enums_of_schema(file));
  Enums ours;
  add<Code>(ours);
  add<Element>(ours);
  add<Mode>(ours);
  add<Outcome>(ours);
  add<AbsentNodes>(ours);
  add<Policy>(ours);
  add<Regime>(ours);
  add<Strategy>(ours);
  add<Top>(ours);
  ours["Field"]["UNSPECIFIED"] = 0;
  for (const ColumnRow& row : column_rows())
    ours["Field"][upper_case(row.name)] = static_cast<std::uint32_t>(row.field);
  EXPECT_EQ(ours, schema);
}

TEST(Names, OfCodesOfTheClientsSideAreNotSent) {
  EXPECT_FALSE(may_be_sent(Code{}, static_cast<std::uint64_t>(Code::kUnreachable)));
  EXPECT_STREQ(name(Code::kUnreachable), "UNREACHABLE");
  EXPECT_STREQ(name(static_cast<Code>(7)), "?");
  EXPECT_EQ(names_of(Mode{}).choices(), "ADVANCE or TRIAL");
}

}  // namespace
}  // namespace shearbus::wire
