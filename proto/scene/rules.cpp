#include "proto/scene/rules.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <google/protobuf/descriptor.h>
#include <google/protobuf/message.h>

#include <algorithm>
#include <cmath>
#include <span>
#include <unordered_map>

#include "proto/wire/limits.hpp"
#include "proto/wire/text.hpp"

namespace shearbus::scene {
namespace {

using google::protobuf::FieldDescriptor;
using google::protobuf::Message;

// A message with a link to the message that encloses it, and so on outward.
struct Enclosed {
  const Message& message;
  const Enclosed* around = nullptr;

  const FieldDescriptor* field(const std::string& name) const { return message.GetDescriptor()->FindFieldByName(name); }
  bool has(const FieldDescriptor& field) const { return message.GetReflection()->HasField(message, &field); }
};

// Returns true if the rule `unless` excludes a field. The rule names another field, and excludes while that field has a
// value. The other field is looked up in the message, then in the messages around it, up to the first that has a field
// of this name.
bool excluded(const Enclosed& where, const std::string& unless) {
  if (unless.empty()) return false;
  for (const Enclosed* level = &where; level != nullptr; level = level->around)
    if (const FieldDescriptor* other = level->field(unless)) return level->has(*other);
  return false;
}

// Whether the rule `used_with` allows a field, for example "flow_law=johnson_cook or preston_tonks_wallace": `other` is
// the field that the rule names, `found` its value, `wanted` the values with which the rule is met.
struct Condition {
  enum { kNone, kMet, kNotMet, kOpen, kUnknown } state = kNone;
  const FieldDescriptor* other = nullptr;
  std::string_view found;
  std::span<const std::string> wanted;
};

// What a thread makes once of each field's descriptor, which lives as long as the process, and keeps: a scene of many
// pairs asks for it a thousand times for each of them. No lock: a fork could copy it as held.
template <typename Value>
class Kept {
 public:
  template <typename Make>
  const Value& of(const void* descriptor, const Make& make) {
    const auto at = values_.find(descriptor);
    return at != values_.end() ? at->second : values_.emplace(descriptor, make()).first->second;
  }

 private:
  std::unordered_map<const void*, Value> values_;  // references to values stay valid when it grows
};

// Returns the choices in a text like "johnson_cook or preston_tonks_wallace".
std::vector<std::string> choices_in(std::string_view text) {
  constexpr std::string_view kOr = " or ";
  std::vector<std::string> choices;
  for (std::size_t at = text.find(kOr); at != std::string_view::npos; at = text.find(kOr)) {
    choices.emplace_back(text.substr(0, at));
    text.remove_prefix(at + kOr.size());
  }
  choices.emplace_back(text);
  return choices;
}

// The rule `used_with` of a field, parsed.
struct UsedWith {
  const FieldDescriptor* other;  // of the same table
  std::vector<std::string> wanted;
};

const UsedWith& used_with_of(const FieldDescriptor& field) {
  thread_local Kept<UsedWith> kept;
  return kept.of(&field, [&] {
    const std::string& text = rule_of(field).used_with();
    const std::size_t equals = text.find('=');
    return UsedWith{field.containing_type()->FindFieldByName(text.substr(0, equals)),
                    choices_in(text.substr(equals + 1))};
  });
}

// Evaluates the rule `used_with` of a field. The state is kOpen if the field that the rule names has neither a value
// nor a default: then the material of the catalog decides later, and the first choice is assumed until then.
Condition condition_of(const Enclosed& where, const FieldDescriptor& field) {
  if (rule_of(field).used_with().empty()) return {};
  const UsedWith& rule = used_with_of(field);
  const FieldDescriptor& other = *rule.other;
  Condition condition{.other = &other, .wanted = rule.wanted};
  const std::vector<std::string>& choices = choices_of(other);
  const int chosen = where.message.GetReflection()->GetEnumValue(where.message, &other);
  const auto* value = other.enum_type()->FindValueByNumber(chosen);
  const bool open = chosen == 0 && rule_of(other).default_text().empty();
  if (!value) {
    condition.state = Condition::kUnknown;
    return condition;
  }
  condition.found = chosen != 0 ? choices[static_cast<std::size_t>(value->index()) - 1]
                    : open      ? choices.front()
                                : rule_of(other).default_text();
  const bool met =
      std::find(condition.wanted.begin(), condition.wanted.end(), condition.found) != condition.wanted.end();
  condition.state = met ? Condition::kMet : open ? Condition::kOpen : Condition::kNotMet;
  return condition;
}

std::string unit_of(const FieldDescriptor& field) {
  const std::string& unit = rule_of(field).unit();
  return unit.empty() || unit == "1" ? std::string() : " " + unit;
}

bool is_table(const FieldDescriptor& field) {
  return field.cpp_type() == FieldDescriptor::CPPTYPE_MESSAGE;
}

// Adds the warnings of one table and of the tables in it.
void add_unusual(const Message& table, const std::string& path, std::vector<std::string>& found) {
  const auto& reflection = *table.GetReflection();
  for (int i = 0; i < table.GetDescriptor()->field_count(); ++i) {
    const FieldDescriptor& field = *table.GetDescriptor()->field(i);
    const std::string name = path_of(path, field);
    if (has_named_tables(field)) {
      for (int at = 0; at < reflection.FieldSize(table, &field); ++at) {
        const Message& named = reflection.GetRepeatedMessage(table, &field, at);
        add_unusual(named, name + "." + named.GetReflection()->GetString(named, &name_field(*named.GetDescriptor())),
                    found);
      }
    } else if (is_table(field)) {
      if (reflection.HasField(table, &field)) add_unusual(reflection.GetMessage(table, &field), name, found);
    } else if (field.cpp_type() == FieldDescriptor::CPPTYPE_DOUBLE && field.is_repeated()) {
      for (int at = 0; at < reflection.FieldSize(table, &field); ++at) {
        const double value = reflection.GetRepeatedDouble(table, &field, at);
        if (is_usual(field, value)) continue;
        found.push_back(unusual_text(field, name, value));
        break;  // one warning for a list
      }
    } else if (field.cpp_type() == FieldDescriptor::CPPTYPE_DOUBLE && reflection.HasField(table, &field)) {
      const double value = reflection.GetDouble(table, &field);
      if (!is_usual(field, value)) found.push_back(unusual_text(field, name, value));
    }
  }
}

std::string shown(const FieldDescriptor& field, const std::string& name) {
  return is_table(field) ? "[" + name + "]" : name;
}

class Checker {
 public:
  explicit Checker(Findings& findings) : findings_(findings) {}

  // Checks all fields of a table. If `required` is false, a missing field that the schema requires is no fault.
  void table(const Enclosed& where, const std::string& path, bool required = true) {
    const Message& message = where.message;
    const google::protobuf::Descriptor& type = *message.GetDescriptor();
    for (int i = 0; i < type.field_count(); ++i) {
      const FieldDescriptor& field = *type.field(i);
      const std::string name = path_of(path, field);
      // Named tables are completed by the tables outside of them: a rule between keys checks them (scene.cpp).
      if (has_named_tables(field) || unused(where, field, path, name)) continue;
      if (field.is_repeated()) {
        list(where, field, path, name);
      } else if (rule_of(field).merged()) {
        const std::string& without = rule_of(field).required_without();
        const bool needed = without.empty() || !(where.has(*where.field(without)) || !findings_.sound(without));
        table({message.GetReflection()->GetMessage(message, &field), &where}, name, needed);
      } else if (!where.has(field)) {
        absent(where, field, path, name, required);
      } else if (is_table(field)) {
        table({message.GetReflection()->GetMessage(message, &field), &where}, name);
      } else {
        value(message, field, name);
      }
    }
  }

 private:
  // Returns true if the value of another field excludes this field. An excluded field is at fault if it is given, and
  // is not required.
  bool unused(const Enclosed& where, const FieldDescriptor& field, const std::string& table_path,
              const std::string& name) {
    const bool given = !field.is_repeated() && where.has(field);
    const std::string& unless = rule_of(field).unless();
    if (excluded(where, unless)) {
      if (given)
        findings_.add(name, fmt::format("{} is the server's choice where the scene gives a {}: leave out one of them",
                                        shown(field, name), unless));
      return true;
    }
    const Condition condition = condition_of(where, field);
    if (condition.state != Condition::kNotMet && condition.state != Condition::kOpen) return false;
    if (!findings_.sound(path_of(table_path, *condition.other)))
      return true;  // the other field is itself at fault, so nothing more is reported
    if (given && condition.state == Condition::kOpen) return false;
    if (given)
      findings_.add(name,
                    fmt::format("{} is used only with {} = \"{}\", found \"{}\"", shown(field, name),
                                condition.other->name(), fmt::join(condition.wanted, "\" or \""), condition.found));
    return true;
  }

  void absent(const Enclosed& where, const FieldDescriptor& field, const std::string& table_path,
              const std::string& name, bool required) {
    const v1::Rule& rule = rule_of(field);
    if ((!rule.required() || !required) && rule.required_without().empty()) return;  // most fields may be absent
    if (!findings_.sound(name)) return;
    const std::string meaning = rule.meaning().empty() ? std::string() : fmt::format(" ({})", rule.meaning());
    if (rule.required() && required) {
      findings_.add_missing(table_path, name, fmt::format("{} is missing{}", shown(field, name), meaning));
    } else if (!rule.required_without().empty()) {
      const FieldDescriptor& other = *where.field(rule.required_without());
      const std::string other_name = path_of(table_path, other);
      if (where.has(other) || !findings_.sound(other_name)) return;
      findings_.add_missing(
          table_path, name,
          fmt::format("{} is missing{}: it must be given where {} is not", shown(field, name), meaning, other_name));
    }
  }

  void value(const Message& message, const FieldDescriptor& field, const std::string& name) {
    const auto& reflection = *message.GetReflection();
    switch (field.cpp_type()) {
      case FieldDescriptor::CPPTYPE_DOUBLE:
        number(field, name, name, reflection.GetDouble(message, &field));
        break;
      case FieldDescriptor::CPPTYPE_UINT32:
        number(field, name, name, reflection.GetUInt32(message, &field));
        break;
      case FieldDescriptor::CPPTYPE_ENUM: {
        const int chosen = reflection.GetEnumValue(message, &field);
        if (!field.enum_type()->FindValueByNumber(chosen))
          findings_.add(
              name, fmt::format("{} = {} is not one of \"{}\"", name, chosen, fmt::join(choices_of(field), "\", \"")));
        break;
      }
      case FieldDescriptor::CPPTYPE_STRING: {
        const std::size_t size = reflection.GetString(message, &field).size();
        if (size > wire::kMaxTextBytes)
          findings_.add(name, fmt::format("{} has {} bytes, expected at most {}", name, size, wire::kMaxTextBytes));
        break;
      }
      default:
        break;
    }
  }

  void list(const Enclosed& where, const FieldDescriptor& field, const std::string& table_path,
            const std::string& name) {
    const Message& message = where.message;
    const auto& reflection = *message.GetReflection();
    const int size = reflection.FieldSize(message, &field);
    if (size == 0) return absent(where, field, table_path, name, true);
    if (static_cast<std::size_t>(size) > wire::kMaxNodesPerSession)
      return findings_.add(name,
                           fmt::format("{} has {} values, expected at most {}", name, size, wire::kMaxNodesPerSession));
    for (int i = 0; i < size; ++i)
      if (!number(field, name, size == 1 ? name : fmt::format("{}[{}]", name, i),
                  reflection.GetRepeatedDouble(message, &field, i)))
        return;  // at most one fault is reported for a list
  }

  bool number(const FieldDescriptor& field, const std::string& path, const std::string& name, double value) {
    const v1::Rule& rule = rule_of(field);
    if (!std::isfinite(value)) {
      findings_.add(path, fmt::format("{} = {} is not a finite number", name, value));
      return false;
    }
    const bool inside = !(rule.has_at_least() && value < rule.at_least()) &&
                        !(rule.has_at_most() && value > rule.at_most()) &&
                        !(rule.has_above() && value <= rule.above()) && !(rule.has_below() && value >= rule.below());
    if (!inside)
      findings_.add(path, fmt::format("{} = {}{} is out of range, expected {}", name, number_text(value),
                                      unit_of(field), bounds_of(field)));
    return inside;
  }

  Findings& findings_;
};

void set_default(Message& message, const FieldDescriptor& field) {
  const v1::Rule& rule = rule_of(field);
  const auto& reflection = *message.GetReflection();
  switch (field.cpp_type()) {
    case FieldDescriptor::CPPTYPE_DOUBLE:
      if (rule.has_default_number()) reflection.SetDouble(&message, &field, rule.default_number());
      break;
    case FieldDescriptor::CPPTYPE_UINT32:
      if (rule.has_default_number())
        reflection.SetUInt32(&message, &field, static_cast<std::uint32_t>(rule.default_number()));
      break;
    case FieldDescriptor::CPPTYPE_BOOL:
      reflection.SetBool(&message, &field, false);
      break;
    case FieldDescriptor::CPPTYPE_ENUM:
      if (!rule.default_text().empty()) {
        const std::vector<std::string>& choices = choices_of(field);
        const auto at = std::find(choices.begin(), choices.end(), rule.default_text());
        reflection.SetEnum(&message, &field, field.enum_type()->value(1 + static_cast<int>(at - choices.begin())));
      }
      break;
    default:
      break;
  }
}

// Fills in the values of a message first, then its tables, because the default of a table may depend on a value.
void fill_table(Message& message, const Enclosed* around) {
  const Enclosed where{message, around};
  const google::protobuf::Descriptor& type = *message.GetDescriptor();
  for (const bool tables : {false, true}) {
    for (int i = 0; i < type.field_count(); ++i) {
      const FieldDescriptor& field = *type.field(i);
      if (is_table(field) != tables || field.is_repeated()) continue;
      if (excluded(where, rule_of(field).unless())) continue;
      const Condition condition = condition_of(where, field);
      if (condition.state != Condition::kNone && condition.state != Condition::kMet) continue;
      if (!tables && !where.has(field)) set_default(message, field);
      if (tables && (where.has(field) || rule_of(field).always() || rule_of(field).merged()))
        fill_table(*message.GetReflection()->MutableMessage(&message, &field), &where);
    }
  }
}

}  // namespace

Findings::Findings(std::vector<Fault> faults) : faults_(std::move(faults)) {
  for (const Fault& fault : faults_) at_fault_.insert(fault.path);
}

bool Findings::sound(std::string_view path) const {
  return !at_fault_.contains(path) && (!sound_before_ || sound_before_(path));
}

void Findings::add(std::string path, std::string text) {
  at_fault_.insert(path);
  faults_.push_back({std::move(path), std::move(text), {}});
}

void Findings::add_missing(const std::string& table, std::string path, std::string text) {
  at_fault_.insert(std::move(path));
  add(table, std::move(text));
}

void check_fields(const Message& root, Findings& findings) {
  Checker(findings).table({root}, "");
}

void fill_defaults(Message& root) {
  fill_table(root, nullptr);
}

const v1::Rule& rule_of(const FieldDescriptor& field) {
  return field.options().GetExtension(v1::rule);
}

std::string path_of(const std::string& path, const FieldDescriptor& field) {
  if (rule_of(field).merged()) return path;
  return path.empty() ? field.name() : path + "." + field.name();
}

bool has_named_tables(const FieldDescriptor& field) {
  return field.is_repeated() && is_table(field);
}

const FieldDescriptor& name_field(const google::protobuf::Descriptor& named) {
  int i = 0;
  while (!rule_of(*named.field(i)).table_name()) ++i;
  return *named.field(i);
}

std::vector<const FieldDescriptor*> keys_of(const google::protobuf::Descriptor& table) {
  std::vector<const FieldDescriptor*> keys;
  for (int i = 0; i < table.field_count(); ++i) {
    if (rule_of(*table.field(i)).table_name()) continue;
    if (!rule_of(*table.field(i)).merged()) {
      keys.push_back(table.field(i));
      continue;
    }
    const auto inner = keys_of(*table.field(i)->message_type());
    keys.insert(keys.end(), inner.begin(), inner.end());
  }
  return keys;
}

std::string bounds_of(const FieldDescriptor& field) {
  const v1::Rule& rule = rule_of(field);
  std::vector<std::string> parts;
  if (rule.has_at_least()) parts.push_back("at least " + number_text(rule.at_least()));
  if (rule.has_above()) parts.push_back("above " + number_text(rule.above()));
  if (rule.has_at_most()) parts.push_back("at most " + number_text(rule.at_most()));
  if (rule.has_below()) parts.push_back("below " + number_text(rule.below()));
  return parts.empty() ? std::string() : fmt::format("{}{}", fmt::join(parts, " and "), unit_of(field));
}

std::string usual_of(const FieldDescriptor& field) {
  const v1::Rule& rule = rule_of(field);
  if (!rule.has_usual_from()) return {};
  return fmt::format("from {} to {}{}", number_text(rule.usual_from()), number_text(rule.usual_to()), unit_of(field));
}

bool is_usual(const FieldDescriptor& field, double value) {
  const v1::Rule& rule = rule_of(field);
  const double size = rule.usual_from() > 0.0 ? std::abs(value) : value;  // of which the sign is a direction
  return !rule.has_usual_from() || value == 0.0 || (size >= rule.usual_from() && size <= rule.usual_to());
}

std::string unusual_text(const FieldDescriptor& field, const std::string& name, double value) {
  const std::string unit = unit_of(field);
  return fmt::format("{} = {}{} is unusual: values {} are expected. {}", name, number_text(value), unit,
                     usual_of(field), unit.empty() ? "Is it meant?" : "Is it in" + unit + "?");
}

std::vector<std::string> unusual_values(const Message& root) {
  std::vector<std::string> found;
  add_unusual(root, "", found);
  return found;
}

namespace {

std::vector<std::string> choices_in(const google::protobuf::EnumDescriptor& type) {
  // The first name of an enum, for example FAR_BOUNDARY_UNSPECIFIED, begins with the prefix that all its names share.
  const std::string_view unspecified = type.value(0)->name();
  const std::size_t prefix = unspecified.size() - std::string_view("UNSPECIFIED").size();
  std::vector<std::string> choices;
  for (int i = 1; i < type.value_count(); ++i) {
    std::string choice = type.value(i)->name().substr(prefix);
    for (char& c : choice) c = wire::ascii_lower(c);
    choices.push_back(std::move(choice));
  }
  return choices;
}

}  // namespace

const std::vector<std::string>& choices_of(const FieldDescriptor& field) {
  thread_local Kept<std::vector<std::string>> kept;
  return kept.of(field.enum_type(), [&] { return choices_in(*field.enum_type()); });
}

std::string number_text(double value) {
  std::string text = fmt::format("{}", value);  // the shortest text that reads back to the same bits
  if (text.ends_with(".0")) text.resize(text.size() - 2);
  // Writes 200000000 as 2e8, so that nobody has to count zeros.
  constexpr std::size_t kManyZeros = 5;
  const std::size_t last = text.find_last_not_of('0');
  const std::size_t first = text.find_first_of("123456789");
  if (first == std::string::npos || text.find_first_not_of("-0123456789") != std::string::npos ||
      text.size() - last <= kManyZeros)
    return text;
  const std::string_view all = text;
  return fmt::format("{}{}{}e{}", all.substr(0, first + 1), last > first ? "." : "",
                     all.substr(first + 1, last - first), all.size() - first - 1);
}

}  // namespace shearbus::scene
