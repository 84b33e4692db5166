// Writes shearbus/shearbus_stub.h: shearbus.h, in which every function has a body that says that the
// program was built without the library. Usage: stub-header SHEARBUS_H VERSION FILE. Exit code 1, with a
// sentence, where a declaration has no body here or a file cannot be read or written.
#include <fstream>
#include <iostream>
#include <regex>
#include <sstream>
#include <stdexcept>
#include <string>
#include <string_view>
#include <vector>

#include "proto/wire/text.hpp"

namespace {

std::string text_of(const char* path) {
  std::ifstream file(path);
  std::ostringstream text;
  text << file.rdbuf();
  if (!file || text.str().empty()) throw std::runtime_error(std::string(path) + " cannot be read");
  return text.str();
}

// Replaces what lies between two marks, which are replaced, too.
void replace(std::string& text, std::string_view from, std::string_view to, const std::string& by) {
  const std::size_t begin = text.find(from);
  const std::size_t end = begin == std::string::npos ? begin : text.find(to, begin + from.size());
  if (end == std::string::npos) throw std::runtime_error("shearbus.h has no \"" + std::string(from) + "\"");
  text.replace(begin, end + to.size() - begin, by);
}

std::string code_names(const std::string& header) {
  const std::size_t begin = header.find("SHEARBUS_OK = 0");
  const std::string codes = header.substr(begin, header.find("};", begin) - begin);
  std::string body = "  switch (code) {\n";
  const std::regex entry("(SHEARBUS_([A-Z_]+)) = [0-9]+");
  for (std::sregex_iterator at(codes.begin(), codes.end(), entry), end; at != end; ++at)
    body += "    case " + at->str(1) + ": return \"" + at->str(2) + "\";\n";
  return body + "    default: return \"?\";\n  }\n";
}

struct Column {
  std::string constant, name;
};

std::vector<Column> columns() {
  std::vector<Column> all;
  const auto add = [&](std::string_view kind, std::string quantity, const char* name) {
    for (char& letter : quantity) letter = shearbus::wire::ascii_upper(letter);
    if (kind != "Node") all.push_back({"SHEARBUS_" + quantity, name});
  };
#define COLUMN(enumerator, number, name, quantity, unit, element, kind, ...) add(#kind, #quantity, #name);
#include "proto/wire/columns.inc"
  return all;
}

std::string field_names() {
  std::string body = "  switch (field) {\n";
  for (const Column& column : columns()) body += "    case " + column.constant + ": return \"" + column.name + "\";\n";
  return body + "    default: return NULL;\n  }\n";
}

std::string field_numbers() {
  return "  uint32_t field;\n"
         "  for (field = 1; name != NULL && field < 256; ++field)\n"
         "    if (shearbus_field_name(field) != NULL && strcmp(shearbus_field_name(field), name) == 0) return field;\n"
         "  return 0;\n";
}

// The body of a function, by its name and its type.
std::string body_of(const std::string& type, const std::string& name, const std::string& header,
                    const std::string& version) {
  if (name == "shearbus_code_name") return code_names(header);
  if (name == "shearbus_field_name") return field_names();
  if (name == "shearbus_field_number") return field_numbers();
  if (name == "shearbus_version") return "  return \"" + version + " stub\";\n";
  if (name == "shearbus_close") return "  return shearbus_stub_report(status, SHEARBUS_OK, \"\", \"\");\n";
  if (type == "void") return "";
  if (type == "const char*") return "  return \"\";\n";
  if (type == "size_t") return "  return 0;\n";
  if (type == "const uint64_t*") return "  return NULL;\n";
  if (type == "int") return "  return shearbus_stub_refuse(status);\n";
  throw std::runtime_error(name + " returns " + type + ", for which the stub has no body");
}

// Gives each declaration its body. Parameters that the body does not read are named in casts to void.
std::string with_bodies(const std::string& header, const std::string& version) {
  const std::regex declaration("SHEARBUS_API ([^;{]*?[ *])(shearbus_\\w+)\\(([^;]*)\\);");
  std::string out;
  std::string::const_iterator from = header.begin();
  for (std::sregex_iterator at(header.begin(), header.end(), declaration), end; at != end; ++at) {
    out.append(from, (*at)[0].first);
    from = (*at)[0].second;
    std::string type = at->str(1);
    if (type.back() == ' ') type.pop_back();
    const std::string body = body_of(type, at->str(2), header, version);
    out += "SHEARBUS_API " + at->str(1) + at->str(2) + "(" + at->str(3) + ") {\n";
    std::istringstream parameters(std::regex_replace(at->str(3), std::regex("\\[[^\\]]*\\]"), ""));
    for (std::string parameter; std::getline(parameters, parameter, ',');) {
      std::smatch last;
      if (!std::regex_search(parameter, last, std::regex("(\\w+)\\)?\\s*$"))) throw std::runtime_error(at->str(2));
      const std::regex word("\\b" + last.str(1) + "\\b");
      if (last.str(1) != "void" && !std::regex_search(body, word)) out += "  (void)" + last.str(1) + ";\n";
    }
    out += body + "}\n";
  }
  return out.append(from, header.end());
}

constexpr std::string_view kAbout =
    R"(/* shearbus.h for a program that is built without the library: the same types, constants and functions, in this file
 * alone. Printed from shearbus.h by the build; a host may keep a copy of it in its own tree:
 *
 *   #ifdef HAVE_SHEARBUS
 *   #include <shearbus/shearbus.h>
 *   #else
 *   #include "shearbus_stub.h"
 *   #endif
 *
 * An opening is SHEARBUS_NO_LIBRARY, whose text says what is missing, and there never is a session; so is each other call
 * that may fail. Names of codes and columns are those of the library; closing and leaving have nothing to do. client.hpp
 * and contact_law.hpp work over it where it is included before them. A program with the Fortran module compiles one C
 * file, too:
 *
 *   #define SHEARBUS_STUB_EXTERNAL
 *   #include "shearbus_stub.h"
 */
#ifndef SHEARBUS_H)";

constexpr std::string_view kLinkage =
    R"(#define SHEARBUS_STUB 1
#ifdef SHEARBUS_STUB_EXTERNAL
#define SHEARBUS_API
#else
#define SHEARBUS_API static inline
#endif)";

constexpr std::string_view kReport =
    R"(static inline int shearbus_stub_report(shearbus_status* status, int code, const char* text, const char* remedy) {
  if (status == NULL) return code;
  status->code = code;
  status->n_nodes = 0;
  status->field[0] = '\0';
  strncpy(status->text, text, sizeof status->text - 1);
  strncpy(status->remedy, remedy, sizeof status->remedy - 1);
  return code;
}
static inline int shearbus_stub_refuse(shearbus_status* status) {
  return shearbus_stub_report(status, SHEARBUS_NO_LIBRARY, "this program was built without the shearbus library",
                              "Build it with the library (find_package(shearbus) or pkg-config shearbus), or switch "
                              "its subgrid friction off.");
}

)";

void write(char** arguments) {
  std::string header = text_of(arguments[1]);
  replace(header, "/* The C interface", "#ifndef SHEARBUS_H", std::string(kAbout));
  replace(header, "#include <stdint.h>", "\n", "#include <stdint.h>\n#include <string.h>\n");
  replace(header, "#if defined(__GNUC__)", "#endif", std::string(kLinkage));
  // The bodies report by functions that stand behind the status, whose type they need.
  constexpr std::string_view kBehindStatus = "/* ---- columns ---- */";
  replace(header, kBehindStatus, "\n", std::string(kReport) + std::string(kBehindStatus) + "\n");
  std::ofstream out(arguments[3]);
  out << with_bodies(header, arguments[2]);
  out.close();
  if (!out) throw std::runtime_error(std::string(arguments[3]) + " cannot be written");
}

}  // namespace

int main(int count, char** arguments) {
  try {
    if (count != 4) throw std::runtime_error("usage: stub-header SHEARBUS_H VERSION FILE");
    write(arguments);
    return 0;
  } catch (const std::exception& fault) {
    std::cerr << "stub-header: " << fault.what() << '\n';
    return 1;
  }
}
