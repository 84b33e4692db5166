#include "tests/fuzz/mutate.hpp"

#include <google/protobuf/stubs/logging.h>
#include <xxhash.h>

#include <algorithm>
#include <cstring>
#include <limits>

#include "shearbus/v1/envelope.pb.h"
#include "tests/fuzz/target.hpp"

namespace shearbus::fuzz {
namespace {

using google::protobuf::FieldDescriptor;
using google::protobuf::Message;
using google::protobuf::Reflection;

constexpr std::size_t kLengthBytes = 2;
constexpr std::size_t kLongestPart = 0xffff;

std::string mutated_text(std::string text, Random& random) {
  if (random.one_in(16)) return std::string(5000, 'x');
  mutate_bytes(text, text.size() + 16);
  return text;
}

void set_number(Message& message, const Reflection& at, const FieldDescriptor* field, Random& random) {
  switch (field->cpp_type()) {
    case FieldDescriptor::CPPTYPE_UINT32:
      return at.SetUInt32(&message, field, static_cast<std::uint32_t>(random.number()));
    case FieldDescriptor::CPPTYPE_UINT64:
      return at.SetUInt64(&message, field, random.number());
    case FieldDescriptor::CPPTYPE_DOUBLE:
      return at.SetDouble(&message, field,
                          random.one_in(2) ? random.real() : at.GetDouble(message, field) * random.real());
    case FieldDescriptor::CPPTYPE_BOOL:
      return at.SetBool(&message, field, random.one_in(2));
    case FieldDescriptor::CPPTYPE_ENUM:
      return at.SetEnumValue(
          &message, field,
          random.one_in(8)
              ? static_cast<int>(random.number() & 0x7fffffff)
              : field->enum_type()
                    ->value(static_cast<int>(random.below(static_cast<std::size_t>(field->enum_type()->value_count()))))
                    ->number());
    case FieldDescriptor::CPPTYPE_STRING:
      return at.SetString(&message, field, mutated_text(at.GetString(message, field), random));
    default:
      return;
  }
}

void add_or_remove(Message& message, const Reflection& at, const FieldDescriptor* field, Random& random) {
  const int size = at.FieldSize(message, field);
  if (size > 0 && random.one_in(3)) return at.RemoveLast(&message, field);
  if (size > 1 && random.one_in(3))
    return at.SwapElements(&message, field, 0, 1 + static_cast<int>(random.below(static_cast<std::size_t>(size - 1))));
  switch (field->cpp_type()) {
    case FieldDescriptor::CPPTYPE_MESSAGE: {
      if (size > 0 && !random.one_in(4))
        return mutate(
            *at.MutableRepeatedMessage(&message, field, static_cast<int>(random.below(static_cast<std::size_t>(size)))),
            random);
      Message& added = *at.AddMessage(&message, field);
      if (size > 0) added.CopyFrom(at.GetRepeatedMessage(message, field, 0));
      return;
    }
    case FieldDescriptor::CPPTYPE_UINT64:
      return at.AddUInt64(&message, field, random.number());
    case FieldDescriptor::CPPTYPE_DOUBLE:
      return at.AddDouble(&message, field, random.real());
    case FieldDescriptor::CPPTYPE_ENUM:
      return at.AddEnumValue(
          &message, field,
          field->enum_type()
              ->value(static_cast<int>(random.below(static_cast<std::size_t>(field->enum_type()->value_count()))))
              ->number());
    case FieldDescriptor::CPPTYPE_STRING:
      return at.AddString(&message, field, mutated_text("x", random));
    default:
      return;
  }
}

template <typename Header>
void mutate_as(std::string& frame, Random& random) {
  Header header;
  const google::protobuf::LogSilencer quiet;
  if (!header.ParsePartialFromString(frame)) return mutate_bytes(frame, frame.size() + 64);
  mutate(header, random);
  frame = header.SerializeAsString();
}

template <typename Header>
void mend_as(std::string& frame, const std::string& payload) {
  Header header;
  const google::protobuf::LogSilencer quiet;
  if (!header.ParseFromString(frame) || !header.has_payload()) return;
  header.mutable_payload()->set_size_bytes(payload.size());
  header.mutable_payload()->set_xxh3(XXH3_64bits(payload.data(), payload.size()));
  frame = header.SerializeAsString();
}

}  // namespace

Parts unpack(const std::uint8_t* data, std::size_t size) {
  Parts parts;
  for (std::size_t at = 0; at + kLengthBytes <= size;) {
    const std::size_t wanted = data[at] + 256U * data[at + 1];
    at += kLengthBytes;
    const std::size_t length = std::min(wanted, size - at);
    parts.emplace_back(reinterpret_cast<const char*>(data) + at, length);
    at += length;
  }
  return parts;
}

std::string pack(const Parts& parts) {
  std::string input;
  for (const std::string& part : parts) {
    const std::size_t length = std::min(part.size(), kLongestPart);
    input += static_cast<char>(length & 0xff);
    input += static_cast<char>(length >> 8);
    input.append(part, 0, length);
  }
  return input;
}

std::vector<std::span<const std::byte>> views_of(const Parts& parts) {
  std::vector<std::span<const std::byte>> views;
  for (const std::string& part : parts) views.push_back(std::as_bytes(std::span(part)));
  return views;
}

std::uint64_t Random::number() {
  const std::uint64_t any = std::uniform_int_distribution<std::uint64_t>()(engine_);
  switch (below(4)) {
    case 0:
      return below(20);
    case 1:
      return (std::uint64_t{1} << below(64)) - below(2);
    case 2:
      return ~std::uint64_t{0} - below(3);
    default:
      return any >> below(64);
  }
}

double Random::real() {
  using Limits = std::numeric_limits<double>;
  constexpr double kEdges[] = {0.0,
                               -0.0,
                               1.0,
                               -1.0,
                               Limits::quiet_NaN(),
                               Limits::infinity(),
                               -Limits::infinity(),
                               1e-9,
                               1e-12,
                               1e-5,
                               300.0,
                               1219.9999999,
                               1220.0,
                               Limits::denorm_min(),
                               1e308,
                               1e11,
                               2e11,
                               1e4,
                               -2e10,
                               0.5,
                               2.0,
                               1e-300};
  if (!one_in(4)) return kEdges[below(std::size(kEdges))];
  const std::uint64_t bits = std::uniform_int_distribution<std::uint64_t>()(engine_);
  double value = 0.0;
  std::memcpy(&value, &bits, sizeof value);
  return value;
}

void mutate_bytes(std::string& bytes, std::size_t longest) {
  std::vector<std::uint8_t> room(std::max<std::size_t>(longest, 1));
  std::copy_n(bytes.begin(), std::min(bytes.size(), room.size()), room.begin());
  const std::size_t size = LLVMFuzzerMutate(room.data(), std::min(bytes.size(), room.size()), room.size());
  bytes.assign(room.begin(), room.begin() + static_cast<std::ptrdiff_t>(size));
}

void mutate_reals(std::string& payload, Random& random) {
  if (payload.size() < 8) return;
  const std::size_t at = 8 * random.below(payload.size() / 8);
  double value = 0.0;
  std::memcpy(&value, payload.data() + at, sizeof value);
  value = random.one_in(2) ? random.real() : value * (random.one_in(2) ? -1.0 : random.real());
  std::memcpy(payload.data() + at, &value, sizeof value);
}

void mutate_places(std::string& payload, Random& random) {
  if (payload.size() < 8) return;
  const std::uint64_t place = random.one_in(8) ? random.number() : random.below(5);
  std::memcpy(payload.data() + 8 * random.below(payload.size() / 8), &place, sizeof place);
}

void mutate(Message& message, Random& random) {
  const auto& type = *message.GetDescriptor();
  const auto& at = *message.GetReflection();
  if (type.field_count() == 0) return;
  // Chooses the field to mutate: with probability 1/2 among the fields that are set, otherwise among all fields.
  std::vector<const FieldDescriptor*> present;
  at.ListFields(message, &present);
  const FieldDescriptor* field =
      !present.empty() && random.one_in(2)
          ? present[random.below(present.size())]
          : type.field(static_cast<int>(random.below(static_cast<std::size_t>(type.field_count()))));
  if (field->is_repeated()) return add_or_remove(message, at, field, random);
  if (random.one_in(16)) return at.ClearField(&message, field);
  if (field->cpp_type() != FieldDescriptor::CPPTYPE_MESSAGE) return set_number(message, at, field, random);
  // To set another member of a oneof would discard the present member, so the mutator does it rarely.
  if (field->containing_oneof() != nullptr && !at.HasField(message, field) && !random.one_in(8)) return;
  mutate(*at.MutableMessage(&message, field), random);
}

void mutate_header(std::string& frame, bool reply, Random& random) {
  if (reply)
    mutate_as<v1::ReplyHeader>(frame, random);
  else
    mutate_as<v1::RequestHeader>(frame, random);
}

void mend_payload(std::string& header, const std::string& payload, bool reply) {
  if (reply)
    mend_as<v1::ReplyHeader>(header, payload);
  else
    mend_as<v1::RequestHeader>(header, payload);
}

std::size_t give(const std::string& input, std::uint8_t* data, std::size_t before, std::size_t max_size) {
  if (input.empty() || input.size() > max_size) return before;
  std::memcpy(data, input.data(), input.size());
  return input.size();
}

}  // namespace shearbus::fuzz
