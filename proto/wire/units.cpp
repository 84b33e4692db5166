#include "proto/wire/units.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cstdint>

namespace shearbus::wire {
namespace {

struct Unit {
  const char* name;
  const char* si;
  double factor;
};
constexpr std::array kUnits = {
#define UNIT(name, si, factor) Unit{name, si, factor},
#define WORD(word, name)
#include "proto/wire/units.inc"
#undef UNIT
#undef WORD
};

// Names that are written out, and what they stand for.
constexpr std::array kWords = {
#define UNIT(name, si, factor)
#define WORD(word, name) std::array<std::string_view, 2>{word, name},
#include "proto/wire/units.inc"
#undef UNIT
#undef WORD
};

void replace_all(std::string& text, std::string_view from, std::string_view to) {
  std::string out;
  std::string_view rest = text;
  for (auto at = rest.find(from); at != std::string_view::npos; at = rest.find(from)) {
    out.append(rest.substr(0, at)).append(to);
    rest.remove_prefix(at + from.size());
  }
  text = out.append(rest);
}

// The unit as its parts with powers, in alphabetical order: "kg/m2" is "kg m-2".
std::string normal(std::string_view unit) {
  constexpr std::pair<std::string_view, std::string_view> kSpellings[] = {
      {"\u00b5", "u"}, {"\u03bc", "u"}, {"\u00b7", " "}, {"\u22c5", " "}, {"\u00b2", "2"}, {"\u207b", "-"},
      {"\u00b9", "1"}, {"**", ""},      {"^", ""},       {".", " "},      {"*", " "}};
  std::string text(unit);
  for (const auto& [from, to] : kSpellings) replace_all(text, from, to);
  std::vector<std::string> parts;
  bool below = false;
  for (std::size_t at = 0; at < text.size();) {
    if (text[at] == ' ' || text[at] == '/') {
      below = below || text[at] == '/';
      ++at;
      continue;
    }
    const std::size_t end = std::min(text.find_first_of(" /", at), text.size());
    std::string part = text.substr(at, end - at);
    at = end;
    if (part == "1") continue;
    for (const auto& [word, name] : kWords)
      if (part == word) part = name;
    if (below) {  // only the part behind the stroke is below it, as everybody reads "Pa s/m"
      const auto power = part.find_first_of("0123456789");
      part = power == std::string::npos ? fmt::format("{}-1", part)
                                        : fmt::format("{}-{}", part.substr(0, power), part.substr(power));
      below = false;
    }
    parts.push_back(std::move(part));
  }
  std::ranges::sort(parts);
  std::string out;
  for (const std::string& part : parts) {
    if (!out.empty()) out += ' ';
    out += part;
  }
  return out;
}

}  // namespace

std::vector<std::pair<std::string, const ColumnRow*>> quantities() {
  std::vector<std::pair<std::string, const ColumnRow*>> found;
  for (const ColumnRow& column : column_rows())
    for (std::uint32_t component = 0; component < (column.tangential ? 2 : 1); ++component)
      if (column.kind != Kind::kNode) found.emplace_back(quantity_of(column.field, component), &column);
  return found;
}

const char* unit_of_quantity(std::string_view name) {
  if (name == "time" || name == "dt") return "s";
  if (name == "node_id" || name == "node") return "";
  if (name == "initial_temperature") return "K";
  if (name == "pair" || name.starts_with("parameter/")) return "";
  if (name == "initial_velocity_jump" || name == "initial_velocity_jump_second") return "m/s";
  for (const auto& [quantity, column] : quantities())
    if (quantity == name) return column->unit;
  return nullptr;
}

std::optional<double> factor_to_si(std::string_view unit, std::string_view si) {
  constexpr std::size_t kLongest = 64;  // of a unit
  if (unit.size() > kLongest) return std::nullopt;
  const std::string given = normal(unit);
  for (const Unit& one : kUnits)
    if (si == one.si && given == normal(one.name)) return one.factor;
  if (given == normal(si)) return 1.0;
  return std::nullopt;
}

std::string known_units(std::string_view si) {
  std::string names;
  for (const Unit& one : kUnits)
    if (si == one.si) names.append(names.empty() ? "" : ", ").append(one.name);
  return names;
}

}  // namespace shearbus::wire
