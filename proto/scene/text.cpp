// Writes messages as canonical TOML text, and the reference of every key.
#include <fmt/format.h>
#include <fmt/ranges.h>
#include <google/protobuf/descriptor.h>
#include <google/protobuf/message.h>

#include <algorithm>
#include <string>
#include <string_view>
#include <vector>

#include "proto/scene/reader.hpp"

namespace shearbus::scene {
namespace {

using google::protobuf::Descriptor;
using google::protobuf::FieldDescriptor;
using google::protobuf::Message;

std::string toml_string(std::string_view text) {
  std::string out = "\"";
  for (const char c : text) {
    const auto byte = static_cast<unsigned char>(c);
    if (c == '"' || c == '\\')
      out += fmt::format("\\{}", c);
    else if (byte < 0x20 || byte == 0x7F)
      out += fmt::format("\\u{:04X}", byte);
    else
      out += c;
  }
  return out + '"';
}

}  // namespace

std::string value_text(const Message& message, const FieldDescriptor& field) {
  const auto& reflection = *message.GetReflection();
  if (field.is_repeated()) {
    std::vector<std::string> items;
    items.reserve(static_cast<std::size_t>(reflection.FieldSize(message, &field)));
    for (int i = 0; i < reflection.FieldSize(message, &field); ++i)
      items.push_back(number_text(reflection.GetRepeatedDouble(message, &field, i)));
    return fmt::format("[{}]", fmt::join(items, ", "));
  }
  switch (field.cpp_type()) {
    case FieldDescriptor::CPPTYPE_DOUBLE:
      return number_text(reflection.GetDouble(message, &field));
    case FieldDescriptor::CPPTYPE_UINT32:
      return fmt::format("{}", reflection.GetUInt32(message, &field));
    case FieldDescriptor::CPPTYPE_BOOL:
      return reflection.GetBool(message, &field) ? "true" : "false";
    case FieldDescriptor::CPPTYPE_STRING:
      return toml_string(reflection.GetString(message, &field));
    default: {
      const auto* value = field.enum_type()->FindValueByNumber(reflection.GetEnumValue(message, &field));
      if (!value)
        throw wire::Error({.code = wire::Code::kInvalidScene,
                           .text = fmt::format("{} has no value of number {}", field.name(),
                                               reflection.GetEnumValue(message, &field)),
                           .field = field.name()});
      return toml_string(choices_of(field)[static_cast<std::size_t>(value->index()) - 1]);
    }
  }
}

namespace {

std::string comment_of(const FieldDescriptor& field) {
  const v1::Rule& rule = rule_of(field);
  const std::string unit = rule.unit().empty() || rule.unit() == "1" ? std::string() : "[" + rule.unit() + "] ";
  const std::string text = unit + rule.meaning();
  return text.empty() ? std::string() : "  # " + text;
}

// Writes the keys of a message but not its tables: they come after all keys, because a key after a [table] would belong
// to that table. The keys of a message that is marked `merged` stand among those of the enclosing table.
void write_keys(const Message& message, bool comments, std::string& out) {
  std::vector<const FieldDescriptor*> present;
  message.GetReflection()->ListFields(message, &present);
  for (const FieldDescriptor* field : present) {
    if (rule_of(*field).merged())
      write_keys(message.GetReflection()->GetMessage(message, field), comments, out);
    else if (field->cpp_type() != FieldDescriptor::CPPTYPE_MESSAGE)
      out += fmt::format("{} = {}{}\n", field->name(), value_text(message, *field), comments ? comment_of(*field) : "");
  }
}

void write_tables(const Message& message, const std::string& path, bool comments, std::string& out);

// Writes the tables [path.NAME] of a repeated message, without comments: those of the tables outside say it. Such a
// table has only tables, no keys.
void write_named_tables(const Message& message, const FieldDescriptor& field, const std::string& path,
                        std::string& out) {
  const auto& reflection = *message.GetReflection();
  for (int i = 0; i < reflection.FieldSize(message, &field); ++i) {
    const Message& inner = reflection.GetRepeatedMessage(message, &field, i);
    const std::string name =
        fmt::format("{}.{}", path, inner.GetReflection()->GetString(inner, &name_field(*inner.GetDescriptor())));
    out += fmt::format("\n[{}]\n", name);
    write_tables(inner, name, false, out);
  }
}

void write_tables(const Message& message, const std::string& path, bool comments, std::string& out) {
  std::vector<const FieldDescriptor*> present;
  message.GetReflection()->ListFields(message, &present);
  for (const FieldDescriptor* field : present) {
    if (field->cpp_type() != FieldDescriptor::CPPTYPE_MESSAGE) continue;
    if (has_named_tables(*field)) {
      write_named_tables(message, *field, path_of(path, *field), out);
      continue;
    }
    const Message& inner = message.GetReflection()->GetMessage(message, field);
    const std::string name = path_of(path, *field);
    if (!rule_of(*field).merged()) {
      out += fmt::format("\n[{}]{}\n", name, comments ? comment_of(*field) : "");
      write_keys(inner, comments, out);
    }
    write_tables(inner, name, comments, out);
  }
}

std::string type_text(const FieldDescriptor& field) {
  if (field.is_repeated()) return "number or list of numbers";
  switch (field.cpp_type()) {
    case FieldDescriptor::CPPTYPE_DOUBLE:
      return "number";
    case FieldDescriptor::CPPTYPE_UINT32:
      return "integer";
    case FieldDescriptor::CPPTYPE_BOOL:
      return "true or false";
    case FieldDescriptor::CPPTYPE_STRING:
      return "text";
    default:
      return fmt::format("\"{}\"", fmt::join(choices_of(field), "\" or \""));
  }
}

std::string default_text(const FieldDescriptor& field) {
  const v1::Rule& rule = rule_of(field);
  std::string value = rule.has_default_number()     ? number_text(rule.default_number())
                      : rule.default_text().empty() ? ""
                                                    : '"' + rule.default_text() + '"';
  if (!rule.used_with().empty()) {
    const bool needed = rule.required() || !rule.required_without().empty();
    return fmt::format("{}{}{} `{}`", value, value.empty() ? "" : ", ", needed ? "required with" : "only with",
                       rule.used_with());
  }
  if (rule.required()) return "required";
  if (!value.empty()) return value;
  if (field.cpp_type() == FieldDescriptor::CPPTYPE_BOOL) return "false";
  return rule.required_without().empty() ? "absent" : "required without `" + rule.required_without() + "`";
}

// Writes one section for each kind of table, with the names of all tables of this kind as heading ("[soft], [hard]"),
// then the sections of the tables inside it.
void describe_table(const Descriptor& table, const std::string& path, const std::string& heading, std::string& out) {
  out += fmt::format("\n## {}\n\n| key | type | unit | default | bounds | meaning |\n|---|---|---|---|---|---|\n",
                     heading);
  const std::vector<const FieldDescriptor*> keys = keys_of(table);
  for (const FieldDescriptor* field : keys) {
    if (field->message_type()) continue;
    const std::string usual = usual_of(*field);
    out += fmt::format("| `{}` | {} | {} | {} | {}{} | {} |\n", field->name(), type_text(*field),
                       rule_of(*field).unit(), default_text(*field), bounds_of(*field),
                       usual.empty() ? usual : "; usually " + usual, rule_of(*field).meaning());
  }
  std::vector<const Descriptor*> described;
  for (const FieldDescriptor* first : keys) {
    const Descriptor* inner = first->message_type();
    if (inner && has_named_tables(*first)) {
      std::vector<std::string> tables;
      for (const FieldDescriptor* field : keys_of(*inner))
        tables.push_back(fmt::format("`[{}.NAME.{}]`", path_of(path, *first), field->name()));
      out += fmt::format(
          "\n## [{}.NAME]: {}\n\nIts tables are {}: their keys are those of the tables outside, each of which they "
          "replace as a whole.\n",
          path_of(path, *first), rule_of(*first).meaning(), fmt::join(tables, ", "));
      continue;
    }
    if (!inner || std::find(described.begin(), described.end(), inner) != described.end()) continue;
    described.push_back(inner);
    std::vector<std::string> names;
    std::vector<std::string> meanings;
    for (const FieldDescriptor* field : keys)
      if (field->message_type() == inner) {
        names.push_back(fmt::format("[{}]", path_of(path, *field)));
        meanings.push_back(rule_of(*field).meaning());
      }
    describe_table(*inner, path_of(path, *first),
                   fmt::format("{}: {}", fmt::join(names, ", "), fmt::join(meanings, "; ")), out);
  }
}

}  // namespace

std::string to_toml(const Message& root) {
  std::string out;
  write_keys(root, true, out);
  write_tables(root, "", true, out);
  return out;
}

std::string reference_of(const Descriptor& root) {
  std::string out = "# Keys of a scene\n\nA scene is a TOML file. Numbers are SI; an integer may stand for a number.\n";
  describe_table(root, "", "The scene itself: keys before the first [table]", out);
  return out;
}

}  // namespace shearbus::scene
