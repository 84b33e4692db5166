// The rules of the schema (the option `rule` of every field) in C++, and the checks that they imply for a message of
// any root type.
#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <set>
#include <string>
#include <string_view>
#include <vector>

#include "shearbus/v1/rules.pb.h"

namespace google::protobuf {
class Descriptor;
class FieldDescriptor;
class Message;
}  // namespace google::protobuf

namespace shearbus::scene {

// A place in a text; lines and columns count from 1.
struct Place {
  std::uint32_t line = 1;
  std::uint32_t column = 1;
  friend auto operator<=>(const Place&, const Place&) = default;  // NOLINT(modernize-use-nullptr): a false alarm
};

struct Fault {
  std::string path;            // key at fault ("layer.cells"), or table that lacks a key; empty: the root
  std::string text;            // one line, naming the key
  std::optional<Place> place;  // place of the fault in the text, if this is not the place of the key `path`
};

// The faults found so far, for rules that look at more than one key.
class Findings {
 public:
  // Tells whether a key was sound before these findings.
  using Sound = std::function<bool(std::string_view path)>;

  explicit Findings(std::vector<Fault> faults = {});
  explicit Findings(Sound sound_before) : sound_before_(std::move(sound_before)) {}

  // Returns true if no fault was found at this key, so that its value may be used.
  bool sound(std::string_view path) const;
  void add(std::string path, std::string text);
  // Adds the fault that `table` lacks the key `path`, which is not sound from then on.
  void add_missing(const std::string& table, std::string path, std::string text);
  const std::vector<Fault>& faults() const { return faults_; }

 private:
  std::vector<Fault> faults_;
  std::set<std::string, std::less<>> at_fault_;  // the paths of the faults, and missing keys
  Sound sound_before_;
};

// Adds every fault that concerns a single field: missing, out of bounds, not finite, or given although the value of
// another field excludes it.
void check_fields(const google::protobuf::Message& root, Findings& findings);

// Sets every absent field that has a default, and adds the absent tables whose absence means the same as an empty
// table.
void fill_defaults(google::protobuf::Message& root);

const v1::Rule& rule_of(const google::protobuf::FieldDescriptor& field);

// Returns the path of a field of the table `path`: "path.field", or `path` for a field that is marked `merged`.
std::string path_of(const std::string& path, const google::protobuf::FieldDescriptor& field);

// Whether the tables of a field have names, as [pair.NAME]: the field is a repeated message.
bool has_named_tables(const google::protobuf::FieldDescriptor& field);

// The field of such a message that holds the name of its table.
const google::protobuf::FieldDescriptor& name_field(const google::protobuf::Descriptor& named);

// Returns the keys of a table: its fields and, in place of a message that is marked `merged`, the message's own fields;
// not a field that holds the table's name.
std::vector<const google::protobuf::FieldDescriptor*> keys_of(const google::protobuf::Descriptor& table);

// Returns the bounds of a field as text: "above 0 and at most 1 m", "at least 1"; empty if the field has no bounds.
std::string bounds_of(const google::protobuf::FieldDescriptor& field);

// Returns the usual values of a field as text, "from 1e5 to 5e10 Pa"; empty if its rule names none.
std::string usual_of(const google::protobuf::FieldDescriptor& field);

// Whether a value is among the usual ones of its key, or is 0, or the key has none. The warning about another value, as
// one line that begins with `name`.
bool is_usual(const google::protobuf::FieldDescriptor& field, double value);
std::string unusual_text(const google::protobuf::FieldDescriptor& field, const std::string& name, double value);

// The warnings about all numbers of a message, by the names of their keys.
std::vector<std::string> unusual_values(const google::protobuf::Message& root);

// Returns the names of an enum field's values as scenes write them, in order: "velocity_driven", "force_driven".
const std::vector<std::string>& choices_of(const google::protobuf::FieldDescriptor& field);

// Returns a number as text that reads back to the same bits, e.g. "2e-05".
std::string number_text(double value);

}  // namespace shearbus::scene
