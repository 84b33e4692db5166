#include "proto/wire/scene_file.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <google/protobuf/descriptor.h>
#include <toml++/toml.h>

#include <algorithm>
#include <cerrno>
#include <cstdio>
#include <cstring>
#include <limits>
#include <memory>
#include <optional>
#include <sstream>
#include <utility>

#include "proto/wire/limits.hpp"
#include "proto/wire/scene_message.hpp"
#include "proto/wire/scene_rules.hpp"
#include "proto/wire/text.hpp"
#include "proto/wire/with_message.hpp"
#include "shearbus/v1/scene.pb.h"

namespace shearbus::wire {
namespace {

using google::protobuf::Descriptor;
using google::protobuf::FieldDescriptor;
using google::protobuf::Message;

constexpr std::size_t kMaxFaultsTold = 50;

struct Place {
  std::uint32_t line = 1;
  std::uint32_t column = 1;
  friend auto operator<=>(const Place&, const Place&) = default;
};

Place place_of(const toml::key& key, const toml::node& node) {
  const toml::source_position& at =
      node.is_table() && node.source().begin.line > 0 ? node.source().begin : key.source().begin;
  return {at.line, at.column};
}

// What a TOML value is, in a user's words.
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
  if (const toml::value<std::string>* string = node.as_string())
    text << '"' << as_utf8(string->get(), kShown) << '"';
  else
    node.visit([&](const auto& value) { text << value; });
  return fmt::format("found {} {}", kind_of(node), text.str());
}

// TOML tables into messages of the schema. Types are judged here, values by the rules.
class Reader {
 public:
  Reader(std::map<std::string, Place, std::less<>>& places, std::vector<std::pair<Place, std::string>>& faults)
      : places_(places), faults_(faults) {}

  void table(const toml::table& from, Message& to, const std::string& path) {
    for (const auto& [key, node] : from) {
      const FieldDescriptor* field = to.GetDescriptor()->FindFieldByName(std::string(key.str()));
      const Place place = place_of(key, node);
      if (!field) {
        unknown(key.str(), *to.GetDescriptor(), path, place);
        continue;
      }
      const std::string name = path.empty() ? field->name() : path + "." + field->name();
      places_[name] = place;
      if (field->cpp_type() == FieldDescriptor::CPPTYPE_MESSAGE) {
        if (const toml::table* inner = node.as_table())
          table(*inner, *to.GetReflection()->MutableMessage(&to, field), name);
        else
          fault(place, fmt::format("{0} is a table: expected [{0}] and its keys, {1}", name, found(node)));
      } else {
        value(node, to, *field, name, place);
      }
    }
  }

 private:
  void fault(Place place, std::string text) { faults_.emplace_back(place, std::move(text)); }

  void unknown(std::string_view key, const Descriptor& table, const std::string& path, Place place) {
    std::vector<std::string_view> known;
    known.reserve(static_cast<std::size_t>(table.field_count()));
    for (int i = 0; i < table.field_count(); ++i) known.push_back(table.field(i)->name());
    constexpr std::size_t kShown = 60;
    std::string text = fmt::format("{}{} is not a key of {}", path.empty() ? "" : path + ".", as_utf8(key, kShown),
                                   path.empty() ? "a scene" : "[" + path + "]");
    if (const std::string home = home_of(key, *v1::Scene::descriptor(), ""); !home.empty())
      text += fmt::format("; it is a key of {}", home);
    else if (const std::string_view near = nearest(key, known); !near.empty())
      text += fmt::format("; did you mean \"{}\"?", near);
    else
      text += fmt::format("; expected one of {}", fmt::join(known, ", "));
    fault(place, std::move(text));
  }

  // Tables that do have this key, e.g. "[soft], [hard]".
  static std::string home_of(std::string_view key, const Descriptor& table, const std::string& path) {
    std::string homes;
    const auto add = [&](const std::string& home) { homes += homes.empty() || home.empty() ? home : ", " + home; };
    if (table.FindFieldByName(std::string(key)))
      add(path.empty() ? "the scene itself, before the first [table]" : "[" + path + "]");
    for (int i = 0; i < table.field_count(); ++i)
      if (const Descriptor* inner = table.field(i)->message_type())
        add(home_of(key, *inner, path.empty() ? table.field(i)->name() : path + "." + table.field(i)->name()));
    return homes;
  }

  void value(const toml::node& node, Message& to, const FieldDescriptor& field, const std::string& name, Place place) {
    if (field.is_repeated()) return list(node, to, field, name, place);
    switch (field.cpp_type()) {
      case FieldDescriptor::CPPTYPE_DOUBLE: {
        double number = 0.0;
        if (read_number(node, field, name, place, number)) to.GetReflection()->SetDouble(&to, &field, number);
        break;
      }
      case FieldDescriptor::CPPTYPE_UINT32: {
        const auto number = node.value_exact<std::int64_t>();
        if (!number || *number < 0 || *number > std::numeric_limits<std::uint32_t>::max())
          fault(place, fmt::format("{}: expected an integer, {}{}", name, bounds_of(field), ", " + found(node)));
        else
          to.GetReflection()->SetUInt32(&to, &field, static_cast<std::uint32_t>(*number));
        break;
      }
      case FieldDescriptor::CPPTYPE_BOOL:
        if (const auto yes = node.value_exact<bool>())
          to.GetReflection()->SetBool(&to, &field, *yes);
        else
          fault(place, fmt::format("{}: expected true or false, {}", name, found(node)));
        break;
      case FieldDescriptor::CPPTYPE_ENUM:
        choice(node, to, field, name, place);
        break;
      case FieldDescriptor::CPPTYPE_STRING:
        if (const auto text = node.value_exact<std::string>(); !text)
          fault(place, fmt::format("{}: expected text in quotes, {}", name, found(node)));
        else if (text->empty())  // on the wire an empty text is an absent one
          fault(place, fmt::format("{} is empty, expected text", name));
        else
          to.GetReflection()->SetString(&to, &field, *text);
        break;
      default:
        fault(place, fmt::format("{} cannot be given in a scene file", name));
        break;
    }
  }

  bool read_number(const toml::node& node, const FieldDescriptor& field, const std::string& name, Place place,
                   double& number) {
    const std::string& unit = field.options().GetExtension(v1::rule).unit();
    if (!node.is_number()) {
      fault(place, fmt::format("{}: expected a number{}, {}", name, unit == "1" ? "" : " in " + unit, found(node)));
      return false;
    }
    number = *node.value<double>();
    return true;
  }

  void list(const toml::node& node, Message& to, const FieldDescriptor& field, const std::string& name, Place place) {
    double number = 0.0;
    const toml::array* items = node.as_array();
    if (!items) {
      if (read_number(node, field, name, place, number)) to.GetReflection()->AddDouble(&to, &field, number);
      return;
    }
    if (items->empty()) return fault(place, fmt::format("{} is an empty list, expected at least one number", name));
    for (std::size_t i = 0; i < items->size(); ++i) {
      const toml::node& item = *items->get(i);
      const Place at{item.source().begin.line, item.source().begin.column};
      if (!read_number(item, field, fmt::format("{}[{}]", name, i), at, number)) {
        to.GetReflection()->ClearField(&to, &field);  // a list with a hole has no length to check
        return;
      }
      to.GetReflection()->AddDouble(&to, &field, number);
    }
  }

  void choice(const toml::node& node, Message& to, const FieldDescriptor& field, const std::string& name, Place place) {
    const std::vector<std::string> choices = choices_of(field);
    const auto text = node.value_exact<std::string>();
    const auto chosen = text ? std::find(choices.begin(), choices.end(), *text) : choices.end();
    if (chosen != choices.end()) {
      const int index = 1 + static_cast<int>(chosen - choices.begin());
      to.GetReflection()->SetEnum(&to, &field, field.enum_type()->value(index));
      return;
    }
    const std::vector<std::string_view> words(choices.begin(), choices.end());
    const std::string_view near = text ? nearest(*text, words) : std::string_view();
    fault(place, fmt::format("{}: expected \"{}\", {}{}", name, fmt::join(choices, "\" or \""), found(node),
                             near.empty() ? "" : fmt::format("; did you mean \"{}\"?", near)));
  }

  std::map<std::string, Place, std::less<>>& places_;
  std::vector<std::pair<Place, std::string>>& faults_;
};

Place place_at(std::string_view text, std::size_t at) {
  const std::string_view before = text.substr(0, at);
  const std::size_t line_start = before.rfind('\n') + 1;  // npos + 1 is 0
  return {static_cast<std::uint32_t>(1 + std::count(before.begin(), before.end(), '\n')),
          static_cast<std::uint32_t>(1 + at - line_start)};
}

// Where the string that starts at `at` ends: its last byte, or the line's end where a one-line string is left open.
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
      for (int more = 0; more < 2 && text.substr(i + 1, 1) == triple.substr(0, 1); ++more) ++i;  // """ha"""""
      return i;
    }
  }
  return i;
}

// The first dot of a dotted key that has more parts than any scene's. toml++ makes a table of each part and takes them
// down recursively, so that a long enough key would overflow the stack.
std::optional<std::size_t> find_deep_key(std::string_view text) {
  constexpr int kMaxKeyDots = 8;
  int dots = 0;
  for (std::size_t i = 0; i < text.size(); ++i) {
    const char c = text[i];
    if (c == '"' || c == '\'') {
      i = end_of_string(text, i);
      if (i < text.size() && text[i] == '\n') dots = 0;
    } else if (c == '#') {
      i = std::min(text.find('\n', i), text.size());
      dots = 0;
    } else if (c == '.') {
      if (++dots > kMaxKeyDots) return i;
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
  throw Error({.code = Code::kInvalidScene, .text = std::move(text), .field = std::move(field)});
}

std::string read_file(const std::filesystem::path& path) {
  const auto fail = [&](const char* what) {
    refuse(fmt::format("{}: {}: {}", path.string(), what, std::strerror(errno)));
  };
  std::error_code ignored;
  if (std::filesystem::is_directory(path, ignored))
    refuse(fmt::format("{}: is a directory, expected a scene file", path.string()));
  const std::unique_ptr<std::FILE, int (*)(std::FILE*)> file(std::fopen(path.c_str(), "rb"), std::fclose);
  if (!file) fail("cannot be opened");
  std::string text;
  char block[65536];
  while (const std::size_t size = std::fread(block, 1, sizeof block, file.get())) {
    text.append(block, size);
    if (text.size() > kMaxSceneFileBytes)
      refuse(fmt::format("{}: larger than {} bytes: not a scene", path.string(), kMaxSceneFileBytes));
  }
  if (std::ferror(file.get())) fail("cannot be read");
  return text;
}

toml::table parse_toml(std::string_view text, const std::string& file) {
  if (text.empty()) refuse(line_of(file, {}, "the file is empty, expected a scene"));
  if (const auto deep = find_deep_key(text))
    refuse(line_of(file, place_at(text, *deep), "a key of too many parts, no table lies so deep"));
  try {
    return toml::parse(text, std::string_view(file));
  } catch (const toml::parse_error& error) {
    const toml::source_position& at = error.source().begin;
    refuse(line_of(file, {at.line, at.column}, as_utf8(error.description(), kMaxTextBytes)));
  }
}

}  // namespace

std::string SceneFile::where(std::string_view field) const {
  for (std::string_view path = field; !path.empty();) {
    if (const auto found = places.find(path); found != places.end()) return file + ":" + found->second;
    const std::size_t cut = path.find_last_of(".[");
    path = path.substr(0, cut == std::string_view::npos ? 0 : cut);
  }
  return file;
}

SceneFile parse_scene(std::string_view text, std::string file_name) {
  const toml::table root = parse_toml(text, file_name);
  std::map<std::string, Place, std::less<>> places;
  std::vector<std::pair<Place, std::string>> faults;
  v1::Scene message;
  Reader(places, faults).table(root, message, "");
  for (Fault& fault : faults_of(message, [&](std::string_view path) { return places.contains(path); })) {
    const auto place = places.find(fault.path);
    faults.emplace_back(place == places.end() ? Place{} : place->second, std::move(fault.text));
  }
  if (!faults.empty()) {
    std::stable_sort(faults.begin(), faults.end(), [](const auto& a, const auto& b) { return a.first < b.first; });
    std::vector<std::string> lines;
    for (const auto& [place, fault] : faults) {
      if (lines.size() == kMaxFaultsTold) {
        lines.push_back(fmt::format("{}: and {} more", file_name, faults.size() - kMaxFaultsTold));
        break;
      }
      lines.push_back(line_of(file_name, place, fault));
    }
    refuse(fmt::format("{}", fmt::join(lines, "\n")));
  }
  SceneFile result{.scene = from_message(message), .file = std::move(file_name), .places = {}};
  for (const auto& [path, place] : places) result.places[path] = fmt::format("{}:{}", place.line, place.column);
  return result;
}

SceneFile load_scene_file(const std::filesystem::path& path) {
  return parse_scene(read_file(path), path.string());
}

Status check_scene(const Scene& scene) {
  std::vector<Fault> faults;
  try {
    faults = with_message<v1::Scene>([&](v1::Scene& message) {
      to_message(scene, message);
      return faults_of(message, [](std::string_view) { return false; });
    });
  } catch (const Error& error) {
    return error.status();
  }
  if (faults.empty()) return {};
  std::vector<std::string_view> lines;
  lines.reserve(faults.size());
  for (const Fault& fault : faults) lines.push_back(fault.text);
  return {.code = Code::kInvalidScene, .text = fmt::format("{}", fmt::join(lines, "\n")), .field = faults.front().path};
}

}  // namespace shearbus::wire
