// The columns of payloads: their meaning, the messages that have them and the bounds of their values. They are listed
// in columns.inc, one row for each column.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "proto/wire/enums.hpp"

namespace shearbus::wire {

// The columns, with the same numbers as in shearbus.v1.Field.
enum class Field : std::uint32_t {
  kUnspecified = 0,
#define COLUMN(enumerator, number, ...) enumerator = number,
#include "proto/wire/columns.inc"
};

// How requests and replies of a strategy use a column.
enum class Use : std::uint8_t {
  kNone,
  kRequired,   // every request has the column
  kOptional,   // a request may have the column; without it the values are 0
  kStick,      // every request in stick form has the column, and no other request does
  kReply,      // every reply has the column, unless `wanted` leaves it out
  kOnRequest,  // a reply has the column only if `wanted` names it
};

enum class Kind : std::uint8_t { kNode, kInput, kOutput, kLedger, kProfile };

struct ColumnRow {
  Field field;
  const char* name;      // name on the wire, with its unit: "pressure_pa"
  const char* quantity;  // name in files, where the unit is an attribute: "pressure"
  const char* unit;      // "kg/m2"; "" for ids, codes and bits
  Element element;
  Kind kind;
  bool tangential;  // a vector along the interface: has a second column, component 1, if slip has two components
  Use velocity_driven;
  Use force_driven;
  // smallest and largest value that a request may hold, in `unit`; both are 0 for columns of a reply
  double lowest;
  double highest;
  const char* meaning;

  Use use(Strategy strategy) const {
    return strategy == Strategy::kVelocityDriven ? velocity_driven
           : strategy == Strategy::kForceDriven  ? force_driven
                                                 : Use::kNone;
  }
};

std::span<const ColumnRow> column_rows();          // descriptions of all columns, as in columns.inc
const ColumnRow* find_column(Field field);         // null for a number that is no field
const ColumnRow& column_row(Field field);          // throws std::out_of_range for a number that is no field
std::size_t size_of(Element element);              // size of one value in bytes
Element element_of(Field field);                   // kUnspecified for a number that is no field
bool is_tangential(Field field);                   // false for a number that is no field
const char* name(Field field);                     // "?" for a number that is no field
std::string units_in_files(const ColumnRow& row);  // UDUNITS text: "kg m-2"; "1" for ids, codes and bits

// The two forms of a force-driven request. The stick form has the columns kStickColumns in place of kFarFieldColumns.
enum class Form : std::uint8_t { kFarField, kStick };
inline constexpr std::array kFarFieldColumns = {Field::kStressSoft, Field::kStressHard, Field::kMassSoft,
                                                Field::kMassHard};
inline constexpr std::array kStickColumns = {
#define STICK(enumerator, ...) Field::enumerator,
#include "proto/wire/columns.inc"
};
// Returns the required columns of a request in this form; `far_field` are those of the far-field form.
std::vector<Field> columns_in(Form form, std::span<const Field> far_field);

// Columns of the steps of a strategy, in the order of columns.inc. A request may also have node_id.
struct StrategyColumns {
  std::span<const Field> required;
  std::span<const Field> optional;
  std::span<const Field> reply;
  std::span<const Field> on_request;
  std::span<const Field> stick;  // columns that replace kFarFieldColumns in a request in stick form
};
const StrategyColumns& columns_of(Strategy strategy);  // all lists are empty for kUnspecified

// The columns of the energy ledger of a step.
inline constexpr std::array kLedgerColumns = {
#define LEDGER(enumerator, ...) Field::enumerator,
#include "proto/wire/columns.inc"
};

// Returns the name of a component of a column in a file: its quantity, with an ending for the second component.
std::string quantity_of(Field field, std::uint32_t component = 0);

}  // namespace shearbus::wire
