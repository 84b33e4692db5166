// The scene inside of a header, as the bytes of its protobuf message.
#include <fmt/format.h>
#include <google/protobuf/descriptor.h>
#include <google/protobuf/stubs/logging.h>
#include <google/protobuf/unknown_field_set.h>

#include <utility>

#include "proto/wire/field_codec.hpp"
#include "proto/wire/scene_message.hpp"
#include "proto/wire/with_message.hpp"
#include "shearbus/v1/scene.pb.h"

namespace shearbus::wire {
namespace {

using google::protobuf::FieldDescriptor;
using google::protobuf::Message;

[[noreturn]] void refuse(Code code, std::string text, std::string remedy = {}, std::string field = {}) {
  throw Error({.code = code, .text = std::move(text), .remedy = std::move(remedy), .field = std::move(field)});
}

// What protobuf lets pass: fields nobody knows (`strict`), enum values nobody knows, text of any length.
void check_parts(const Message& message, const std::string& path, bool strict) {
  const auto& reflection = *message.GetReflection();
  const auto named = [&](const FieldDescriptor* field) {
    return path.empty() ? field->name() : path + "." + field->name();
  };
  if (strict && !reflection.GetUnknownFields(message).empty())
    refuse(Code::kMalformed,
           fmt::format("{} has a field number {} that protocol {}.{} does not know", path.empty() ? "the header" : path,
                       reflection.GetUnknownFields(message).field(0).number(), kProtocolMajor, kProtocolMinor),
           "A sender with newer fields says so in protocol_minor.", path);
  std::vector<const FieldDescriptor*> present;
  reflection.ListFields(message, &present);
  std::string scratch;
  for (const FieldDescriptor* field : present) {
    if (field->cpp_type() == FieldDescriptor::CPPTYPE_MESSAGE) {
      if (!field->is_repeated()) check_parts(reflection.GetMessage(message, field), named(field), strict);
      for (int i = 0; field->is_repeated() && i < reflection.FieldSize(message, field); ++i)
        check_parts(reflection.GetRepeatedMessage(message, field, i), named(field), strict);
    } else if (field->cpp_type() == FieldDescriptor::CPPTYPE_ENUM && !field->is_repeated()) {
      const int number = reflection.GetEnumValue(message, field);
      if (!field->enum_type()->FindValueByNumber(number))
        refuse(Code::kMalformed,
               fmt::format("{} = {} is no value of {}", named(field), number, field->enum_type()->name()), {},
               named(field));
    } else if (field->cpp_type() == FieldDescriptor::CPPTYPE_STRING) {
      const int count = field->is_repeated() ? reflection.FieldSize(message, field) : 1;
      for (int i = 0; i < count; ++i) {
        const std::string& text = field->is_repeated()
                                      ? reflection.GetRepeatedStringReference(message, field, i, &scratch)
                                      : reflection.GetStringReference(message, field, &scratch);
        if (text.size() > kMaxTextBytes)
          refuse(Code::kLimit,
                 fmt::format("{} has {} bytes, at most {} allowed", named(field), text.size(), kMaxTextBytes), {},
                 named(field));
      }
    }
  }
}

}  // namespace

std::string scene_bytes(const Scene& scene) {
  return with_message<v1::Scene>([&](v1::Scene& message) {
    to_message(scene, message);
    message.clear_hydro();  // the guest's own business
    return message.SerializeAsString();
  });
}

Scene read_scene(std::span<const std::byte> bytes, const std::string& path, bool strict) {
  const google::protobuf::LogSilencer quiet;  // a stranger's bytes are no reason to write to stderr
  return with_message<v1::Scene>([&](v1::Scene& message) {
    if (!message.ParseFromArray(bytes.data(), static_cast<int>(bytes.size())))
      refuse(Code::kMalformed, path + " does not parse", {}, path);
    check_parts(message, path, strict);
    Scene scene = from_message(message);
    scene.hydro.reset();
    return scene;
  });
}

}  // namespace shearbus::wire
