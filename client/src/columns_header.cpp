// Writes shearbus/columns.h, which shearbus.h includes: the columns of a step as constants of C, one for each row of
// proto/wire/columns.inc. Usage: columns-header FILE. Exit code 1 if FILE cannot be written.
#include <fstream>
#include <iostream>
#include <string>
#include <string_view>

#include "proto/wire/text.hpp"

namespace {

void print(std::ostream& out, std::string_view kind, int number, std::string quantity, std::string_view unit,
           std::string_view element, std::string_view direction, std::string_view meaning) {
  if (kind == "Node") return;  // node columns are arguments of the functions
  for (char& letter : quantity) letter = shearbus::wire::ascii_upper(letter);
  out << "  SHEARBUS_" << quantity << " = " << number << ", /* " << (element == "Uint8" ? "uint8_t: " : "") << meaning;
  if (!unit.empty()) out << "  [" << unit << "]";
  out << (direction == "Tangential" ? "; tangential" : "") << " */\n";
}

}  // namespace

int main(int count, char** arguments) {
  std::ofstream out(count == 2 ? arguments[1] : "");
  out << "/* Columns of a step, with the numbers of shearbus.v1.Field. Made from proto/wire/columns.inc by the build. "
         "*/\n"
         "#ifndef SHEARBUS_COLUMNS_H\n#define SHEARBUS_COLUMNS_H\n\nenum {\n";
#define COLUMN(enumerator, number, name, quantity, unit, element, kind, direction, ...) \
  print(out, #kind, number, #quantity, unit, #element, #direction, LAST(__VA_ARGS__));
#define LAST(velocity_driven, force_driven, lowest, highest, meaning) meaning
#include "proto/wire/columns.inc"
  out << "  SHEARBUS_NO_COLUMN = 0\n};\n\n#endif\n";
  out.close();
  if (out) return 0;
  std::cerr << "usage: columns-header FILE, a file that can be written\n";
  return 1;
}
