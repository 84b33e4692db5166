// The codec must write the same bytes of a header as protobuf. The test writes random messages of the schema by
// protobuf, reads them by the codec, writes them by the codec and compares the bytes.
#include <gtest/gtest.h>

#include <cmath>
#include <random>
#include <set>
#include <string>

#include "proto/wire/codec.hpp"
#include "proto/wire/columns.hpp"
#include "proto/wire/limits.hpp"
#include "shearbus/v1/envelope.pb.h"

namespace shearbus::wire {
namespace {

using google::protobuf::FieldDescriptor;
using google::protobuf::Message;
using google::protobuf::Reflection;

class RandomMessages {
 public:
  explicit RandomMessages(unsigned seed) : random_(seed) {}

  // Returns a header that the codec accepts. Optional fields are set or not at random, with values of various lengths.
  template <typename Header>
  Header header(std::set<std::string>& bodies) {
    Header made;
    made.set_magic(kMagic);
    made.set_protocol_major(kProtocolMajor);
    made.set_protocol_minor(kProtocolMinor);
    made.set_request_id(number());
    if (one_in(2)) made.set_session_id(bytes(kSessionIdBytes));
    made.set_sequence(number());
    made.set_epoch(number());
    const auto* oneof = Header::descriptor()->oneof_decl(0);
    const FieldDescriptor* body =
        oneof->field(static_cast<int>(below(static_cast<std::uint64_t>(oneof->field_count()))));
    fill(*made.GetReflection()->MutableMessage(&made, body));
    bodies.insert(body->name());
    if constexpr (std::is_same_v<Header, v1::ReplyHeader>) {
      if (one_in(4)) {
        made.clear_body();
        fill(*made.mutable_status());
        if (made.status().code() == v1::CODE_OK) made.mutable_status()->set_code(v1::CODE_LIMIT);
      } else {
        made.mutable_status()->set_code(v1::CODE_OK);
      }
      made.set_replayed(one_in(2));
    }
    return made;
  }

 private:
  std::uint64_t below(std::uint64_t end) { return std::uniform_int_distribution<std::uint64_t>(0, end - 1)(random_); }
  bool one_in(std::uint64_t n) { return below(n) == 0; }
  std::uint64_t number() { return std::uniform_int_distribution<std::uint64_t>()(random_) >> below(65 - 1); }
  std::string bytes(std::size_t size) {
    std::string made(size, '\0');
    for (char& byte : made) byte = static_cast<char>(1 + below(255));
    return made;
  }
  std::string text() {
    std::string made(one_in(8) ? 200 + below(200) : below(8), '\0');
    for (char& character : made) character = static_cast<char>(' ' + below(95));
    if (one_in(4)) made += "\xC3\xA9\xE2\x82\xAC";
    return made;
  }
  double real() {
    return std::ldexp(static_cast<double>(below(1U << 20)) - (1U << 19), static_cast<int>(below(80)) - 40);
  }

  // Returns a random number of an enum, but not that of its first value (0, unspecified), which the codec may refuse.
  int enum_number(const FieldDescriptor* field) {
    const auto* type = field->enum_type();
    return type->value(1 + static_cast<int>(below(static_cast<std::uint64_t>(type->value_count() - 1))))->number();
  }

  void fill(Message& message) {
    for (int i = 0; i < message.GetDescriptor()->field_count(); ++i) set(message, message.GetDescriptor()->field(i));
  }

  void set(Message& message, const FieldDescriptor* field) {
    const Reflection& at = *message.GetReflection();
    const bool required = field->name() == "scene" || field->name() == "effective_scene" || field->name() == "mode" ||
                          field->name() == "code" ||
                          (field->cpp_type() == FieldDescriptor::CPPTYPE_MESSAGE && !field->is_repeated());
    if (!required && one_in(3)) return;
    if (field->is_repeated()) {
      for (std::uint64_t n = below(4); n > 0; --n) add(message, field, at);
      return;
    }
    switch (field->cpp_type()) {
      case FieldDescriptor::CPPTYPE_BOOL:
        return at.SetBool(&message, field, one_in(2));
      case FieldDescriptor::CPPTYPE_UINT32:
        return at.SetUInt32(&message, field, static_cast<std::uint32_t>(number()));
      case FieldDescriptor::CPPTYPE_UINT64:
        return at.SetUInt64(&message, field, number());
      case FieldDescriptor::CPPTYPE_DOUBLE:
        return at.SetDouble(&message, field, real());
      case FieldDescriptor::CPPTYPE_ENUM:
        return at.SetEnumValue(&message, field, enum_number(field));
      case FieldDescriptor::CPPTYPE_MESSAGE:
        return fill(*at.MutableMessage(&message, field));
      case FieldDescriptor::CPPTYPE_STRING:
        return at.SetString(
            &message, field,
            field->type() == FieldDescriptor::TYPE_BYTES ? bytes(kSessionIdBytes) : text() + (required ? "x" : ""));
      default:
        FAIL() << "a type that the schema did not have: " << field->full_name();
    }
  }

  void add(Message& message, const FieldDescriptor* field, const Reflection& at) {
    const auto columns = column_rows();
    switch (field->cpp_type()) {
      case FieldDescriptor::CPPTYPE_UINT32:  // every list of uint32 in the schema is a list of columns
        return at.AddUInt32(&message, field, static_cast<std::uint32_t>(columns[below(columns.size())].field));
      case FieldDescriptor::CPPTYPE_UINT64:
        return at.AddUInt64(&message, field, number());
      case FieldDescriptor::CPPTYPE_ENUM:
        return at.AddEnumValue(&message, field, enum_number(field));
      case FieldDescriptor::CPPTYPE_MESSAGE:
        return fill(*at.AddMessage(&message, field));
      case FieldDescriptor::CPPTYPE_STRING:
        return at.AddString(&message, field,
                            field->type() == FieldDescriptor::TYPE_BYTES ? bytes(kSessionIdBytes) : text());
      default:
        FAIL() << "a list that the schema did not have: " << field->full_name();
    }
  }

  std::mt19937_64 random_;
};

template <typename Ours, typename Header>
void check_bytes(unsigned seed, std::size_t messages) {
  RandomMessages random(seed);
  std::set<std::string> bodies;
  for (std::size_t i = 0; i < messages; ++i) {
    const Header header = random.header<Header>(bodies);
    const std::string written = header.SerializeAsString();
    Ours message;
    const std::span<const std::byte> frame = std::as_bytes(std::span(written));
    ASSERT_NO_THROW(decode(std::span(&frame, 1), message)) << header.ShortDebugString();
    ASSERT_EQ(encode_header(message), written) << header.ShortDebugString();
  }
  EXPECT_EQ(bodies.size(), static_cast<std::size_t>(Header::descriptor()->oneof_decl(0)->field_count()));
}

TEST(Protobuf, WritesTheSameRequests) {
  check_bytes<Request, v1::RequestHeader>(1, 4000);
}
TEST(Protobuf, WritesTheSameReplies) {
  check_bytes<Reply, v1::ReplyHeader>(2, 4000);
}

}  // namespace
}  // namespace shearbus::wire
