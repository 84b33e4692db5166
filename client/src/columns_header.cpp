// Writes shearbus/columns.h, which shearbus.h includes: the columns of a step as constants of C, one for each row of
// proto/wire/columns.inc.
//   columns-header FILE
#include <cctype>
#include <cstdio>
#include <string>
#include <string_view>

namespace {

void print(std::FILE* file, std::string_view kind, int number, std::string quantity, const char* unit,
           std::string_view element, std::string_view direction, const char* meaning) {
  if (kind == "Node") return;  // given by arguments of the functions
  for (char& letter : quantity) letter = static_cast<char>(std::toupper(static_cast<unsigned char>(letter)));
  std::fprintf(file, "  SHEARBUS_%s = %d, /* %s%s%s%s%s%s */\n", quantity.c_str(), number,
               element == "Uint8" ? "uint8_t: " : "", meaning, *unit ? "  [" : "", unit, *unit ? "]" : "",
               direction == "Tangential" ? "; tangential" : "");
}

}  // namespace

int main(int count, char** arguments) {
  std::FILE* file = count == 2 ? std::fopen(arguments[1], "w") : nullptr;
  if (file == nullptr) {
    std::fputs("usage: columns-header FILE, a file that can be written\n", stderr);
    return 1;
  }
  std::fputs(
      "/* Columns of a step, with the numbers of shearbus.v1.Field. Made from proto/wire/columns.inc by the build. */\n"
      "#ifndef SHEARBUS_COLUMNS_H\n#define SHEARBUS_COLUMNS_H\n\nenum {\n",
      file);
#define COLUMN(enumerator, number, name, quantity, unit, element, kind, direction, ...) \
  print(file, #kind, number, #quantity, unit, #element, #direction, LAST(__VA_ARGS__));
#define LAST(velocity_driven, force_driven, lowest, highest, meaning) meaning
#include "proto/wire/columns.inc"
  std::fputs("  SHEARBUS_NO_COLUMN = 0\n};\n\n#endif\n", file);
  return std::fclose(file) == 0 ? 0 : 1;
}
