#include "proto/scene/reader.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <google/protobuf/descriptor.h>
#include <google/protobuf/message.h>
#include <toml++/toml.h>

#include <algorithm>
#include <limits>
#include <locale>
#include <memory>
#include <optional>
#include <regex>
#include <sstream>
#include <utility>

#include "proto/files/input_file.hpp"
#include "proto/wire/limits.hpp"
#include "proto/wire/status.hpp"
#include "proto/wire/text.hpp"

namespace shearbus::scene {
namespace {

using google::protobuf::Descriptor;
using google::protobuf::FieldDescriptor;
using google::protobuf::Message;
using wire::nearest;
using wire::printable;

constexpr std::size_t kMaxFaultsListed = 50;
constexpr std::size_t kMaxTableName = 64;
constexpr std::size_t kLongestFileName = 1024;  // in a message  [bytes]
constexpr std::string_view kHydro = "hydro";    // the table that only shearbus-hydro reads

Place place_of(const toml::key& key, const toml::node& node) {
  const toml::source_position& at =
      node.is_table() && node.source().begin.line > 0 ? node.source().begin : key.source().begin;
  return {at.line, at.column};
}

// Returns the kind of a TOML value as error texts name it, e.g. "a list".
std::string kind_of(const toml::node& node) {
  switch (node.type()) {
    case toml::node_type::table:
      return "a table";
    case toml::node_type::array:
      return node.is_array_of_tables() ? "an array of tables" : "a list";
    case toml::node_type::string:
      return "text";
    case toml::node_type::integer:
      return "an integer";
    case toml::node_type::floating_point:
      return "a number";
    case toml::node_type::boolean:
      return "a boolean";
    default:
      return "a date or time";
  }
}

std::string found(const toml::node& node) {
  constexpr std::size_t kShown = 40;
  if (node.is_table() || node.is_array()) return "found " + kind_of(node);
  std::ostringstream text;
  text.imbue(std::locale::classic());  // whatever locale the host has chosen
  if (const toml::value<std::string>* string = node.as_string()) {
    text << '"' << printable(string->get(), kShown) << '"';
  } else if (const toml::value<double>* number = node.as_floating_point()) {
    const std::string digits = number_text(number->get());
    text << digits << (digits.find_first_not_of("-0123456789") == digits.npos ? ".0" : "");  // no integer
  } else {
    node.visit([&](const auto& value) { text << value; });
  }
  return fmt::format("found {} {}", kind_of(node), text.str());
}

// The field that a key of a table sets, and the message that has it: the message of the table, or a message merged into
// it. Both are null if the table has no such key.
struct Slot {
  Message* message = nullptr;
  const FieldDescriptor* field = nullptr;
};

Slot find_slot(Message& message, const std::string& key) {
  const Descriptor& table = *message.GetDescriptor();
  if (const FieldDescriptor* field = table.FindFieldByName(key);
      field && !rule_of(*field).merged() && !rule_of(*field).table_name())
    return {&message, field};
  for (int i = 0; i < table.field_count(); ++i) {
    if (!rule_of(*table.field(i)).merged()) continue;
    if (const Slot found = find_slot(*message.GetReflection()->MutableMessage(&message, table.field(i)), key);
        found.field)
      return found;
  }
  return {};
}

// Reads TOML tables into messages of the schema. It checks types; the rules check values.
class Reader {
 public:
  Reader(const Descriptor& root, std::map<std::string, Place, std::less<>>& places, std::vector<Fault>& faults)
      : root_(root), places_(places), faults_(faults) {}

  // Reads the table of the whole text.
  void root_table(const toml::table& from, Message& to) {
    table(from, to, "");
    help_with_unknown_keys();
  }

 private:
  // A key that its table does not have, and the place of its fault in the list.
  struct Unknown {
    std::size_t fault;
    std::string key;
    const Descriptor* table;
  };

  void table(const toml::table& from, Message& to, const std::string& path) {
    for (const auto& [key, node] : from) {
      const auto [message, field] = find_slot(to, std::string(key.str()));
      const Place place = place_of(key, node);
      if (!field) {
        unknown(key.str(), *to.GetDescriptor(), path, place);
        continue;
      }
      const std::string name = path_of(path, *field);
      places_[name] = place;
      if (has_named_tables(*field)) {
        named_tables(node, *message, *field, name);
      } else if (field->cpp_type() == FieldDescriptor::CPPTYPE_MESSAGE) {
        if (const toml::table* inner = node.as_table())
          table(*inner, *message->GetReflection()->MutableMessage(message, field), name);
        else
          fault(name, fmt::format("{0} is a table: expected [{0}] and its keys, {1}", name, found(node)));
      } else {
        value(node, *message, *field, name);
      }
    }
  }

  // The tables [pair.NAME], in the order of their names.
  void named_tables(const toml::node& node, Message& to, const FieldDescriptor& field, const std::string& path) {
    if (!node.is_table())
      return fault(path, fmt::format("{0} holds tables with names: expected [{0}.NAME], {1}", path, found(node)));
    if (node.as_table()->size() > wire::kMaxPairs)
      return fault(path, fmt::format("{} tables [{}.NAME], at most {} are allowed: give nodes parameters, or divide "
                                     "them over several sessions",
                                     node.as_table()->size(), path, wire::kMaxPairs));
    for (const auto& [key, inner] : *node.as_table()) {
      const std::string_view name = key.str();
      const Place place = place_of(key, inner);
      if (name.empty() || name.size() > kMaxTableName ||
          name.find_first_not_of("abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789_-") != name.npos) {
        fault(path,
              fmt::format("{}.{} has no proper name, expected 1 to {} letters, digits, _ or -", path,
                          printable(name, kMaxTableName), kMaxTableName),
              place);
        continue;
      }
      const std::string table_path = fmt::format("{}.{}", path, name);
      places_[table_path] = place;
      if (!inner.is_table()) {
        fault(table_path, fmt::format("{0} is a table: expected [{0}] and its keys, {1}", table_path, found(inner)));
        continue;
      }
      Message& made = *to.GetReflection()->AddMessage(&to, &field);
      made.GetReflection()->SetString(&made, &name_field(*made.GetDescriptor()), std::string(name));
      table(*inner.as_table(), made, table_path);
    }
  }

  void fault(std::string path, std::string text, std::optional<Place> place = {}) {
    faults_.push_back({std::move(path), std::move(text), place});
  }

  void unknown(std::string_view key, const Descriptor& table, const std::string& path, Place place) {
    constexpr std::size_t kShown = 60;
    const std::string name = (path.empty() ? "" : path + ".") + printable(key, kShown);
    unknown_.push_back({faults_.size(), std::string(key), &table});
    fault(name, fmt::format("{} is not a key of {}", name, path.empty() ? "a scene" : "[" + path + "]"), place);
  }

  // Adds to the faults of unknown keys what was meant. A refusal lists the first faults of the text alone, so the others
  // are spared the search.
  void help_with_unknown_keys() {
    const auto place_of = [&](const Unknown& key) { return *faults_[key.fault].place; };
    const auto last = unknown_.begin() + static_cast<std::ptrdiff_t>(std::min(unknown_.size(), kMaxFaultsListed));
    std::ranges::partial_sort(unknown_, last, {}, place_of);
    for (auto key = unknown_.begin(); key != last; ++key) faults_[key->fault].text += help_with(key->key, *key->table);
  }

  std::string help_with(std::string_view key, const Descriptor& table) const {
    if (key == kHydro && &table == &root_)
      return "; shearbus-hydro alone reads it: remove [hydro] and the tables in it";
    std::vector<std::string_view> known;
    for (const FieldDescriptor* field : keys_of(table)) known.push_back(field->name());
    if (const std::string tables = tables_with(key, root_, ""); !tables.empty())
      return fmt::format("; it is a key of {}", tables);
    if (const std::string_view near = nearest(key, known); !near.empty())
      return fmt::format("; did you mean \"{}\"?", near);
    return fmt::format("; expected one of {}", fmt::join(known, ", "));
  }

  // Returns the names of the tables that have this key, e.g. "[soft], [hard]".
  static std::string tables_with(std::string_view key, const Descriptor& table, const std::string& path) {
    std::string names;
    const auto add = [&](const std::string& name) { names += names.empty() || name.empty() ? name : ", " + name; };
    for (const FieldDescriptor* field : keys_of(table))
      if (field->name() == key) add(path.empty() ? "the scene itself, before the first [table]" : "[" + path + "]");
    for (const FieldDescriptor* field : keys_of(table))
      if (const Descriptor* inner = field->message_type(); inner && !has_named_tables(*field))
        add(tables_with(key, *inner, path_of(path, *field)));
    return names;
  }

  void value(const toml::node& node, Message& to, const FieldDescriptor& field, const std::string& name) {
    if (field.is_repeated()) return list(node, to, field, name);
    switch (field.cpp_type()) {
      case FieldDescriptor::CPPTYPE_DOUBLE: {
        double number = 0.0;
        if (read_number(node, field, name, number)) to.GetReflection()->SetDouble(&to, &field, number);
        break;
      }
      case FieldDescriptor::CPPTYPE_UINT32: {
        const auto number = node.value_exact<std::int64_t>();
        if (!number || *number < 0 || *number > std::numeric_limits<std::uint32_t>::max())
          fault(name, fmt::format("{}: expected an integer, {}{}", name, bounds_of(field), ", " + found(node)));
        else
          to.GetReflection()->SetUInt32(&to, &field, static_cast<std::uint32_t>(*number));
        break;
      }
      case FieldDescriptor::CPPTYPE_BOOL:
        if (const auto yes = node.value_exact<bool>())
          to.GetReflection()->SetBool(&to, &field, *yes);
        else
          fault(name, fmt::format("{}: expected true or false, {}", name, found(node)));
        break;
      case FieldDescriptor::CPPTYPE_ENUM:
        choice(node, to, field, name);
        break;
      case FieldDescriptor::CPPTYPE_STRING:
        if (const auto text = node.value_exact<std::string>(); !text)
          fault(name, fmt::format("{}: expected text in quotes, {}", name, found(node)));
        else if (text->empty())  // proto3 does not distinguish an empty text from an absent text
          fault(name, fmt::format("{} is empty, expected text", name));
        else
          to.GetReflection()->SetString(&to, &field, *text);
        break;
      default:
        fault(name, fmt::format("{} cannot be given in a scene file", name));
        break;
    }
  }

  bool read_number(const toml::node& node, const FieldDescriptor& field, const std::string& name, double& number,
                   std::optional<Place> place = {}, const std::string& path = {}) {
    const std::string& unit = rule_of(field).unit();
    if (!node.is_number()) {
      fault(path.empty() ? name : path,
            fmt::format("{}: expected a number{}, {}", name, unit == "1" ? "" : " in " + unit, found(node)), place);
      return false;
    }
    number = *node.value<double>();
    return true;
  }

  void list(const toml::node& node, Message& to, const FieldDescriptor& field, const std::string& name) {
    double number = 0.0;
    const toml::array* items = node.as_array();
    if (!items) {
      if (read_number(node, field, name, number)) to.GetReflection()->AddDouble(&to, &field, number);
      return;
    }
    if (items->empty()) return fault(name, fmt::format("{} is an empty list, expected at least one number", name));
    for (std::size_t i = 0; i < items->size(); ++i) {
      const toml::node& item = *items->get(i);
      const Place at{item.source().begin.line, item.source().begin.column};
      if (!read_number(item, field, fmt::format("{}[{}]", name, i), number, at, name)) {
        // an incomplete list counts as absent, so that its length is not also reported
        to.GetReflection()->ClearField(&to, &field);
        return;
      }
      to.GetReflection()->AddDouble(&to, &field, number);
    }
  }

  void choice(const toml::node& node, Message& to, const FieldDescriptor& field, const std::string& name) {
    const std::vector<std::string> choices = choices_of(field);
    const auto text = node.value_exact<std::string>();
    const auto chosen = text ? std::find(choices.begin(), choices.end(), *text) : choices.end();
    if (chosen != choices.end()) {
      const int index = 1 + static_cast<int>(chosen - choices.begin());
      to.GetReflection()->SetEnum(&to, &field, field.enum_type()->value(index));
      return;
    }
    if (text && own_choice(*text, choices, to, field)) return;
    const std::vector<std::string_view> words(choices.begin(), choices.end());
    const std::string_view near = text ? nearest(*text, words) : std::string_view();
    fault(name, fmt::format("{}: expected \"{}\", {}{}", name, fmt::join(choices, "\" or \""), found(node),
                            near.empty() ? "" : fmt::format("; did you mean \"{}\"?", near)));
  }

  // "own:NAME": the choice "own" of a field, with its name in the field own_<field>.
  static bool own_choice(std::string_view text, const std::vector<std::string>& choices, Message& to,
                         const FieldDescriptor& field) {
    constexpr std::string_view kOwn = "own:";
    const FieldDescriptor* name = to.GetDescriptor()->FindFieldByName("own_" + field.name());
    const auto own = std::find(choices.begin(), choices.end(), "own");
    if (name == nullptr || own == choices.end() || !text.starts_with(kOwn) || text.size() == kOwn.size()) return false;
    to.GetReflection()->SetEnum(&to, &field, field.enum_type()->value(1 + static_cast<int>(own - choices.begin())));
    to.GetReflection()->SetString(&to, name, std::string(text.substr(kOwn.size())));
    return true;
  }

  const Descriptor& root_;
  std::map<std::string, Place, std::less<>>& places_;
  std::vector<Fault>& faults_;
  std::vector<Unknown> unknown_;
};

Place place_at(std::string_view text, std::size_t at) {
  const std::string_view before = text.substr(0, at);
  const std::size_t line_start = before.rfind('\n') + 1;  // without a newline, rfind returns npos, and npos + 1 is 0
  return {static_cast<std::uint32_t>(1 + std::count(before.begin(), before.end(), '\n')),
          static_cast<std::uint32_t>(1 + at - line_start)};
}

// Returns the end of the string that starts at `at`: its last byte, or the end of the line if a one-line string is not
// closed.
std::size_t end_of_string(std::string_view text, std::size_t at) {
  const char quote = text[at];
  const std::string_view triple = quote == '"' ? "\"\"\"" : "'''";
  const bool many_lines = text.substr(at, 3) == triple;
  std::size_t i = at + (many_lines ? 3 : 1);
  for (; i < text.size(); ++i) {
    if (quote == '"' && text[i] == '\\') {
      ++i;
    } else if (!many_lines && (text[i] == quote || text[i] == '\n')) {
      return i;
    } else if (many_lines && text.substr(i, 3) == triple) {
      i += 2;
      // The string itself may end in one or two quotes before the closing """, as in """ha"""""
      for (int more = 0; more < 2 && text.substr(i + 1, 1) == triple.substr(0, 1); ++more) ++i;
      return i;
    }
  }
  return i;
}

// A place where a text has more than any scene, and what.
struct Excess {
  std::size_t at;
  std::string text;
};

// Finds a dotted key with more than kMaxKeyDots dots, more than any key of a scene has, of which toml++ would make
// nested tables and overflow the stack when it destroys them recursively; or the first key, table or value of a list
// beyond those that a scene may have.
std::optional<Excess> find_excess(std::string_view text) {
  constexpr int kMaxKeyDots = 8;
  int dots = 0;
  std::size_t keys = 0;
  bool line_begins = true;
  for (std::size_t i = 0; i < text.size(); ++i) {
    const char c = text[i];
    if (c == '=' || c == ',' || (c == '[' && line_begins)) ++keys;
    if (keys > wire::kMaxSceneKeys)
      return Excess{
          i, fmt::format("more than {} keys, tables and values of lists, the most a scene has", wire::kMaxSceneKeys)};
    line_begins = c == '\n' || (line_begins && (c == ' ' || c == '\t' || c == '['));
    if (c == '"' || c == '\'') {
      i = end_of_string(text, i);
      line_begins = i < text.size() && text[i] == '\n';
      if (line_begins) dots = 0;
    } else if (c == '#') {
      i = std::min(text.find('\n', i), text.size());
      line_begins = true;
      dots = 0;
    } else if (c == '.') {
      if (++dots > kMaxKeyDots)
        return Excess{i, fmt::format("a key of too many parts, at most {} are allowed", kMaxKeyDots + 1)};
    } else if (std::string_view("\n=,[]{}").find(c) != std::string_view::npos) {
      dots = 0;
    }
  }
  return std::nullopt;
}

std::string line_of(const std::string& file, Place place, std::string_view text) {
  return fmt::format("{}:{}:{}: {}", file, place.line, place.column, text);
}

[[noreturn]] void refuse(std::string text, std::string field = {}) {
  throw wire::Error({.code = wire::Code::kInvalidScene, .text = std::move(text), .field = std::move(field)});
}

// Finds the first byte of a control character that TOML does not allow: a binary file has one.
std::size_t find_control_byte(std::string_view text) {
  const auto is_control = [](char c) {
    return c == '\x7f' || (static_cast<unsigned char>(c) < 0x20 && c != '\t' && c != '\n' && c != '\r');
  };
  return static_cast<std::size_t>(std::ranges::find_if(text, is_control) - text.begin());
}

std::string_view trimmed(std::string_view text) {
  constexpr std::string_view kBlank = " \t\r";
  text.remove_prefix(std::min(text.find_first_not_of(kBlank), text.size()));
  return text.substr(0, text.find_last_not_of(kBlank) + 1);
}

// Returns what is wrong in a line that is not TOML, if it is a common slip: numbers as in Fortran or in another language,
// text without its quotes, a key or table given twice. Otherwise what the parser says.
std::string syntax_fault(std::string_view text, std::size_t line, std::string_view parser_says) {
  constexpr std::size_t kLongest = 60;
  std::vector<std::string_view> lines;
  for (std::size_t begin = 0; lines.size() < std::max<std::size_t>(line, 1) && begin <= text.size();
       begin += lines.back().size() + 1)
    lines.push_back(text.substr(begin, text.find('\n', begin) - begin));
  const auto key_of = [](std::string_view l) { return trimmed(l.substr(0, l.find_first_of("=#"))); };
  const std::string_view key = key_of(lines.back());
  if (parser_says.find("cannot redefine") != parser_says.npos)
    for (std::size_t n = lines.size() - 1; n > 0 && (key.starts_with('[') || !trimmed(lines[n]).starts_with('[')); --n)
      if (key_of(lines[n - 1]) == key)
        return fmt::format("{} is given twice, first in line {}: remove one of the two", printable(key, kLongest), n);
  const std::size_t equals = lines.back().find('=');
  if (equals == std::string_view::npos) return printable(parser_says, wire::kMaxTextBytes);
  static const std::pair<std::regex, const char*> kSlips[] = {
      {std::regex("[-+]?[0-9.]+[dD][-+]?[0-9]+"), "the exponent of a number has an e: 1e-6"},
      {std::regex("[-+]?[0-9]+,[0-9]+"), "a number has a decimal point: 1.5"},
      {std::regex("[-+]?([.][0-9]+|[0-9]+[.])([eE][-+]?[0-9]+)?"),
       "a number has digits on both sides of its point: 0.5"},
      {std::regex("[-+]?[0-9.]+([eE][-+]?[0-9]+)? *[^-+0-9.eE,:_xob ].*"),
       "a number stands without its unit, which the key names"},
      {std::regex("(“|”|„|‘|’).*"), "text stands in straight quotes: \"steel_dlp\""},
      {std::regex("(\"[^\"]*|'[^']*)"), "the closing quote is missing"},
      {std::regex("[A-Za-z_].*"), "text stands in quotes: \"steel_dlp\""}};
  const std::string_view rest = trimmed(lines.back().substr(equals + 1));
  const std::string value(trimmed(rest.substr(0, std::min(rest.find('#'), kLongest))));
  for (const auto& [slip, help] : kSlips)
    if (std::regex_match(value, slip))
      return fmt::format("{} = {} is not TOML: {}", printable(key, kLongest), printable(value, kLongest), help);
  return printable(parser_says, wire::kMaxTextBytes);
}

toml::table parse_toml(std::string_view text, const std::string& file) {
  if (text.empty()) refuse(line_of(file, {}, "the file is empty, expected a scene"));
  if (text.size() > wire::kMaxSceneBytes)
    refuse(fmt::format("{}: {} bytes, a scene has at most {}", file, text.size(), wire::kMaxSceneBytes));
  if (const std::size_t at = find_control_byte(text); at < text.size())
    refuse(line_of(file, place_at(text, at),
                   fmt::format("the byte 0x{:02x}, which no text has: expected a scene, TOML text in UTF-8",
                               static_cast<unsigned char>(text[at]))));
  if (const auto excess = find_excess(text)) refuse(line_of(file, place_at(text, excess->at), excess->text));
  // If memory runs out while toml++ reads a number, toml++ reports the number as a fault of the text. A text is
  // therefore refused only if it fails twice. The parser does not get the file's name, because the parser would end the
  // program if memory ran out while it copied the name.
  for (bool failed_before = false;; failed_before = true) {
    try {
      return toml::parse(text);
    } catch (const toml::parse_error& error) {
      const toml::source_position& at = error.source().begin;
      if (failed_before) refuse(line_of(file, {at.line, at.column}, syntax_fault(text, at.line, error.description())));
    }
  }
}

// Refuses TOML that is no scene at all, of which else each key would be a fault.
void refuse_other_format(const toml::table& table, Message& root, const std::string& file) {
  std::vector<std::string> unknown;
  for (const auto& [key, node] : table)
    if (node.is_table() && key.str() != kHydro && !find_slot(root, std::string(key.str())).field)
      unknown.push_back(fmt::format("[{}]", printable(key.str(), kMaxTableName)));
  if (unknown.size() > 1 && !table.contains("strategy"))
    refuse(line_of(file, {},
                   fmt::format("this is no scene but TOML of another kind: it has no strategy, and a scene has no "
                               "tables {}",
                               fmt::join(unknown, ", "))));
}

// Returns the text with the lines marked in `blank` emptied, so that the line numbers stay the same. Lines count from
// 1.
std::string without_lines(std::string_view text, const std::vector<bool>& blank) {
  std::string out;
  for (std::size_t line = 1; !text.empty(); ++line) {
    const std::size_t end = std::min(text.find('\n'), text.size() - 1) + 1;
    if (line < blank.size() && blank[line])
      out += text.substr(0, end).ends_with('\n') ? "\n" : "";
    else
      out += text.substr(0, end);
    text.remove_prefix(end);
  }
  return out;
}

void mark(const toml::source_region& region, std::vector<bool>& lines) {
  const std::size_t last = std::max(region.begin.line, region.end.line);
  if (region.begin.line == 0) return;
  if (lines.size() <= last) lines.resize(last + 1);
  for (std::size_t line = region.begin.line; line <= last; ++line) lines[line] = true;
}

void mark_all(const toml::key& key, const toml::node& node, std::vector<bool>& lines) {
  mark(key.source(), lines);
  mark(node.source(), lines);
  if (const toml::table* table = node.as_table())
    for (const auto& [inner_key, inner] : *table) mark_all(inner_key, inner, lines);
}

}  // namespace

std::string read_file(const std::filesystem::path& path) {
  const auto shown = [&] { return printable(path.string(), kLongestFileName); };
  std::error_code ignored;
  if (std::filesystem::is_directory(path, ignored))
    refuse(fmt::format("{}: is a directory, expected a scene file", shown()));
  try {
    std::string text = files::RegularFile(path).head(wire::kMaxSceneBytes + 1);
    if (text.size() <= wire::kMaxSceneBytes) return text;
  } catch (const wire::Error& fault) {
    refuse(fault.status().text);
  }
  refuse(fmt::format("{}: larger than {} bytes: not a scene", shown(), wire::kMaxSceneBytes));
}

std::string Document::where(std::string_view path) const {
  if (const std::optional<Place> place = place_of_path(path))
    return fmt::format("{}:{}:{}", file, place->line, place->column);
  return file;
}

std::optional<Place> Document::place_of_path(std::string_view path) const {
  while (!path.empty()) {
    if (const auto found = places.find(path); found != places.end()) return found->second;
    const std::size_t cut = path.find_last_of(".[");
    path = path.substr(0, cut == std::string_view::npos ? 0 : cut);
  }
  return std::nullopt;
}

Place Document::place_of_fault(const Fault& fault) const {
  // A rule between keys names "key = value" of each, and may be about one that is absent: another is in the text.
  if (!places.contains(fault.path))
    for (std::size_t end = fault.text.find(" = "); end != std::string::npos; end = fault.text.find(" = ", end + 1)) {
      const std::size_t begin = fault.text.rfind(' ', end - 1) + 1;  // without a blank, npos + 1 is 0
      if (const auto found = places.find(std::string_view(fault.text).substr(begin, end - begin));
          found != places.end())
        return found->second;
    }
  return place_of_path(fault.path).value_or(Place{});
}

void Document::refuse(const std::vector<Fault>& faults, std::string remedy) const {
  std::vector<std::pair<Place, const Fault*>> sorted;
  sorted.reserve(faults.size());
  for (const Fault& fault : faults) {
    sorted.emplace_back(fault.place ? *fault.place : place_of_fault(fault), &fault);
  }
  std::stable_sort(sorted.begin(), sorted.end(), [](const auto& a, const auto& b) { return a.first < b.first; });
  std::vector<std::string> lines;
  for (const auto& [place, fault] : sorted) {
    if (lines.size() == kMaxFaultsListed) {
      lines.push_back(fmt::format("{}: and {} more", file, faults.size() - kMaxFaultsListed));
      break;
    }
    lines.push_back(line_of(file, place, fault->text));
  }
  throw wire::Error({.code = wire::Code::kInvalidScene,
                     .text = fmt::format("{}", fmt::join(lines, "\n")),
                     .remedy = std::move(remedy),
                     .field = sorted.front().second->path});
}

wire::Status Document::placed(wire::Status status) const {
  if (status.code == wire::Code::kInvalidScene && !file.empty() && !status.text.starts_with(file + ":"))
    status.text = fmt::format("{}: {}", where(status.field), status.text);
  return status;
}

Document read(std::string_view text, const std::string& file, Message& root, const CrossRules& cross_rules) {
  Document document{.file = printable(file, kLongestFileName)};
  const toml::table table = parse_toml(text, document.file);
  refuse_other_format(table, root, document.file);
  std::vector<Fault> faults;
  Reader(*root.GetDescriptor(), document.places, faults).root_table(table, root);
  Findings findings(std::move(faults));
  check_fields(root, findings);
  fill_defaults(root);
  cross_rules(root, findings);
  if (!findings.faults().empty()) document.refuse(findings.faults());
  return document;
}

std::string with_value(std::string_view text, const std::string& origin, std::string_view assignment) {
  const auto equals = assignment.find('=');
  const std::string_view path = assignment.substr(0, equals);
  const auto refuse = [&](const std::string& why) {
    throw wire::Error({.code = wire::Code::kInvalidScene,
                       .text = fmt::format("{} {}: {}", origin, wire::printable(assignment, wire::kMaxTextBytes), why),
                       .remedy = "Write it as table.key=value, for instance interface.friction_coefficient=0.2.",
                       .field = std::string(path)});
  };
  if (equals == std::string_view::npos || path.empty() || equals + 1 == assignment.size()) refuse("it sets no key");
  const std::string value(assignment.substr(equals + 1));
  toml::table given;
  try {
    given = toml::parse("value = " + value);
  } catch (const toml::parse_error&) {  // a bare word
    given.insert_or_assign("value", value);
  }
  if (given.size() != 1) refuse("it is more than one value");
  toml::table root = parse_toml(text, printable(origin, kLongestFileName));
  toml::table* table = &root;
  std::string_view rest = path;
  for (auto dot = rest.find('.'); dot != std::string_view::npos; dot = rest.find('.')) {
    const std::string_view name = rest.substr(0, dot);
    if (name.empty()) refuse("it has an empty name");
    if (!table->contains(name)) table->insert(name, toml::table());
    toml::table* const inner = (*table)[name].as_table();
    if (inner == nullptr) refuse(fmt::format("{} is no table", name));
    table = inner;
    rest.remove_prefix(dot + 1);
  }
  if (rest.empty()) refuse("it has an empty name");
  given["value"].visit([&](const auto& node) { table->insert_or_assign(rest, node); });
  std::ostringstream out;
  out.imbue(std::locale::classic());
  out << root << '\n';
  return out.str();
}

std::string without_table(std::string_view text, const std::string& file, std::string_view key) {
  std::vector<bool> lines;
  const toml::table table = parse_toml(text, printable(file, kLongestFileName));
  for (const auto& [found, node] : table)
    if (found.str() == key) mark_all(found, node, lines);
  return without_lines(text, lines);
}

std::string load_text(const std::filesystem::path& path) {
  return without_table(read_file(path), path.string(), kHydro);
}

}  // namespace shearbus::scene
