#include "proto/wire/columns.hpp"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cctype>
#include <fstream>
#include <iterator>
#include <regex>
#include <set>
#include <string>

#include "proto/wire/enum_names.hpp"
#include "proto/wire/status.hpp"
#include "shearbus_places.hpp"

namespace shearbus::wire {
namespace {

using ::testing::Contains;
using ::testing::ElementsAre;

std::string text_of(const std::string& file) {
  std::ifstream in(std::string(SHEARBUS_SOURCE_DIR) + "/" + file);
  return {std::istreambuf_iterator<char>(in), {}};
}

const char* name_of(Element element) {
  return element == Element::kFloat64 ? "Float64" : element == Element::kUint64 ? "Uint64" : "Uint8";
}

// What proto/print_contract.py reads of columns.inc is what the compiler reads, as far as Python's table has it.
TEST(Columns, ArePrintedAsTheirRowsAre) {
  const std::string table = text_of("client/python/shearbus/_contract.py");
  for (const ColumnRow& row : column_rows()) {
    const std::string line =
        fmt::format("\n    ({}, \"{}\", \"{}\", \"{}\", \"{}\", \"", static_cast<std::uint32_t>(row.field), row.name,
                    row.quantity, row.unit, name_of(row.element));
    const std::size_t at = table.find(line);
    ASSERT_NE(at, std::string::npos) << line;
    const std::size_t behind_kind = table.find("\", ", at + line.size()) + 3;
    EXPECT_EQ(table.substr(behind_kind, 4), row.tangential ? "True" : "Fals") << line;
  }
}

TEST(Columns, HaveOneNameFromWireToFile) {
  std::set<std::string> names, quantities;
  for (const ColumnRow& row : column_rows()) {
    EXPECT_TRUE(names.insert(row.name).second) << row.name;
    EXPECT_TRUE(quantities.insert(row.quantity).second) << row.quantity;
    EXPECT_TRUE(std::string(row.name).starts_with(row.quantity)) << row.name;
    EXPECT_EQ(find_column(row.field), &row);
    EXPECT_STREQ(name(row.field), row.name);
  }
  EXPECT_EQ(quantity_of(Field::kStressSoft, 1), "stress_soft_second");
}

TEST(Columns, UnitsInFilesAreUdunitsText) {
  const std::regex units("1|[A-Za-z]+(-?[0-9])?( [A-Za-z]+(-?[0-9])?)*");
  for (const ColumnRow& row : column_rows())
    EXPECT_TRUE(std::regex_match(units_in_files(row), units)) << row.name << ": " << units_in_files(row);
  EXPECT_EQ(units_in_files(*find_column(Field::kSoftShearRate)), "s-1");
  EXPECT_EQ(units_in_files(*find_column(Field::kImpedance)), "Pa s m-1");
}

// The name of a column ends in the unit of its quantity, if the quantity has a unit.
TEST(Columns, NamesEndInTheirUnit) {
  for (const ColumnRow& row : column_rows()) {
    std::string suffix;
    for (const char letter : std::string(row.unit)) {
      if (letter == '/')
        suffix += "_per_";
      else
        suffix += letter == ' ' ? '_' : static_cast<char>(std::tolower(letter));
    }
    if (suffix.starts_with("1")) suffix.erase(0, 1);
    if (!suffix.empty() && !suffix.starts_with("_")) suffix.insert(0, 1, '_');
    EXPECT_EQ(row.quantity + suffix, row.name);
  }
}

TEST(Columns, OfAStrategyAreThoseItsRowsSay) {
  for (const Strategy strategy : {Strategy::kVelocityDriven, Strategy::kForceDriven}) {
    const StrategyColumns& columns = columns_of(strategy);
    std::size_t used = 0;
    for (const ColumnRow& row : column_rows()) {
      const auto in = [&](std::span<const Field> list) { return std::ranges::count(list, row.field); };
      EXPECT_EQ(in(columns.required), row.use(strategy) == Use::kRequired) << row.name;
      EXPECT_EQ(in(columns.optional), row.use(strategy) == Use::kOptional) << row.name;
      EXPECT_EQ(in(columns.reply), row.use(strategy) == Use::kReply) << row.name;
      EXPECT_EQ(in(columns.on_request), row.use(strategy) == Use::kOnRequest) << row.name;
      EXPECT_EQ(in(columns.stick), row.use(strategy) == Use::kStick) << row.name;
      if (row.use(strategy) != Use::kNone) ++used;
    }
    EXPECT_EQ(used, columns.required.size() + columns.optional.size() + columns.reply.size() +
                        columns.on_request.size() + columns.stick.size());
  }
  EXPECT_TRUE(columns_of(Strategy::kUnspecified).required.empty());
  EXPECT_THAT(columns_of(Strategy::kForceDriven).required, Contains(Field::kMassHard));
  EXPECT_THAT(kLedgerColumns, Contains(Field::kEnergyResidual));
}

TEST(Columns, OfTheStickFormReplaceThoseOfTheFarField) {
  const auto required = columns_of(Strategy::kForceDriven).required;
  EXPECT_THAT(columns_in(Form::kFarField, required), ::testing::ElementsAreArray(required));
  EXPECT_THAT(columns_in(Form::kStick, required),
              ElementsAre(Field::kVelocityJump, Field::kPressure, Field::kStickStress, Field::kImpedance));
  EXPECT_TRUE(std::ranges::equal(columns_of(Strategy::kForceDriven).stick, kStickColumns));
  EXPECT_TRUE(columns_of(Strategy::kVelocityDriven).stick.empty());
}

TEST(Columns, OfARequestHaveBounds) {
  for (const ColumnRow& row : column_rows()) EXPECT_EQ(row.lowest < row.highest, row.kind == Kind::kInput) << row.name;
}

// Which numbers a message may carry, and their names. That the enums are those of the schema is print_contract.py's.
TEST(Names, OfCodesOfTheClientsSideAreNotSent) {
  EXPECT_TRUE(may_be_sent(Code{}, static_cast<std::uint64_t>(Code::kRecovering)));
  EXPECT_FALSE(may_be_sent(Code{}, static_cast<std::uint64_t>(Code::kUnreachable)));
  EXPECT_STREQ(name(Code::kUnreachable), "UNREACHABLE");
  EXPECT_STREQ(name(Code::kOtherProcess), "OTHER_PROCESS");
  EXPECT_STREQ(name(static_cast<Code>(7)), "?");
  EXPECT_EQ(names_of(Mode{}).choices(), "ADVANCE or TRIAL");
}

}  // namespace
}  // namespace shearbus::wire
