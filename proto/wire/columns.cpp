#include "proto/wire/columns.hpp"

#include <algorithm>
#include <array>
#include <iterator>
#include <stdexcept>

namespace shearbus::wire {
namespace {

constexpr bool kTangential = true;
constexpr bool kScalar = false;

constexpr std::array kRows = {
#define COLUMN(enumerator, number, name, quantity, unit, element, kind, direction, velocity_driven, force_driven, \
               lowest, highest, meaning)                                                                          \
  ColumnRow{Field::enumerator,    #name,         #quantity,    unit,                                              \
            Element::k##element,  Kind::k##kind, k##direction, Use::k##velocity_driven,                           \
            Use::k##force_driven, lowest,        highest,      meaning},
#include "proto/wire/columns.inc"
};

// For each number of a field the place of its row in kRows, plus 1; 0: the number is no field.
constexpr std::array kPlaces = [] {
  std::array<std::uint8_t, 1 + static_cast<std::size_t>(std::ranges::max_element(kRows, {}, &ColumnRow::field)->field)>
      places{};
  for (std::size_t place = 0; place < kRows.size(); ++place)
    places[static_cast<std::size_t>(kRows[place].field)] = static_cast<std::uint8_t>(place + 1);
  return places;
}();

// The fields of all columns whose row of kRows passes the test, that is, Test{}(row) is true.
template <typename Test>
struct Selection {
  static constexpr std::size_t kCount = std::count_if(kRows.begin(), kRows.end(), Test{});
  static constexpr std::array<Field, kCount> kFields = [] {
    std::array<Field, kCount> fields{};
    std::size_t n = 0;
    for (const ColumnRow& row : kRows)
      if (Test{}(row)) fields[n++] = row.field;
    return fields;
  }();
};

template <Use ColumnRow::*kStrategy, Use kUse>
struct Uses {
  constexpr bool operator()(const ColumnRow& row) const { return row.*kStrategy == kUse; }
};

template <Use ColumnRow::*kStrategy>
constexpr StrategyColumns kColumns = {
    Selection<Uses<kStrategy, Use::kRequired>>::kFields, Selection<Uses<kStrategy, Use::kOptional>>::kFields,
    Selection<Uses<kStrategy, Use::kReply>>::kFields, Selection<Uses<kStrategy, Use::kOnRequest>>::kFields,
    Selection<Uses<kStrategy, Use::kStick>>::kFields};

}  // namespace

std::span<const ColumnRow> column_rows() {
  return kRows;
}

const ColumnRow* find_column(Field field) {
  const auto number = static_cast<std::size_t>(field);
  return number < kPlaces.size() && kPlaces[number] != 0 ? &kRows[kPlaces[number] - 1] : nullptr;
}

const ColumnRow& column_row(Field field) {
  const ColumnRow* row = find_column(field);
  if (!row) throw std::out_of_range("a number that is no field");
  return *row;
}

std::size_t size_of(Element element) {
  return element == Element::kUnspecified ? 0 : element == Element::kUint8 ? 1 : 8;
}

Element element_of(Field field) {
  const ColumnRow* row = find_column(field);
  return row ? row->element : Element::kUnspecified;
}

bool is_tangential(Field field) {
  const ColumnRow* row = find_column(field);
  return row && row->tangential;
}

const char* name(Field field) {
  const ColumnRow* row = find_column(field);
  return row ? row->name : "?";
}

std::string units_in_files(const ColumnRow& row) {
  std::string unit = row.unit;
  const std::size_t slash = unit.find('/');
  if (unit.empty()) return "1";
  if (slash == std::string::npos) return unit;
  const std::string above = unit.substr(0, slash);
  const std::size_t power = unit.find_first_of("0123456789", slash);
  const std::string below = unit.substr(slash + 1, power - slash - 1);
  return (above == "1" ? "" : above + " ") + below + "-" + (power == std::string::npos ? "1" : unit.substr(power));
}

const StrategyColumns& columns_of(Strategy strategy) {
  static constexpr StrategyColumns kNone{};
  switch (strategy) {
    case Strategy::kVelocityDriven:
      return kColumns<&ColumnRow::velocity_driven>;
    case Strategy::kForceDriven:
      return kColumns<&ColumnRow::force_driven>;
    case Strategy::kUnspecified:
      break;
  }
  return kNone;
}

std::vector<Field> columns_in(Form form, std::span<const Field> far_field) {
  std::vector<Field> columns;
  const auto is_far_field = [](Field field) { return std::ranges::count(kFarFieldColumns, field) != 0; };
  std::ranges::copy_if(far_field, std::back_inserter(columns),
                       [&](Field field) { return form == Form::kFarField || !is_far_field(field); });
  if (form == Form::kStick) columns.insert(columns.end(), kStickColumns.begin(), kStickColumns.end());
  return columns;
}

std::string quantity_of(Field field, std::uint32_t component) {
  return std::string(column_row(field).quantity) + (component == 0 ? "" : "_second");
}

}  // namespace shearbus::wire
