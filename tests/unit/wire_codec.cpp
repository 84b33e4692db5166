#include "proto/wire/codec.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <map>

#include "shearbus_places.hpp"
#include "tests/support/refused.hpp"
#include "tests/support/wire_samples.hpp"

namespace shearbus::wire {
namespace {

using samples::Bytes;
using samples::Frames;
using ::testing::HasSubstr;

template <typename Message>
Message decoded(const Frames& frames) {
  Message message;
  decode(frames.views(), message);
  return message;
}

// Returns the status with which decode() refuses the frames, kOk if it accepts them.
template <typename Message>
Status refusal(const Frames& frames) {
  return support::fault_of([&] { decoded<Message>(frames); });
}

TEST(Codec, EveryRequestArrivesAsItWasSent) {
  for (const auto& [name, request] : samples::requests()) {
    SCOPED_TRACE(name);
    const Frames frames = samples::frames_of(request);
    const Request again = decoded<Request>(frames);
    EXPECT_EQ(again.request_id, request.request_id);
    EXPECT_EQ(again.session_id, request.session_id);
    EXPECT_EQ(again.sequence, request.sequence);
    EXPECT_EQ(again.epoch, request.epoch);
    EXPECT_EQ(again.body.index(), request.body.index());
    EXPECT_EQ(samples::frames_of(again).frames, frames.frames);  // every field survives encoding and decoding
  }
}

TEST(Codec, EveryReplyArrivesAsItWasSent) {
  for (const auto& [name, reply] : samples::replies()) {
    SCOPED_TRACE(name);
    const Frames frames = samples::frames_of(reply);
    const Reply again = decoded<Reply>(frames);
    EXPECT_EQ(again.status.code, reply.status.code);
    EXPECT_EQ(again.status.node_ids, reply.status.node_ids);
    EXPECT_EQ(again.replayed, reply.replayed);
    EXPECT_EQ(again.body.index(), reply.body.index());
    EXPECT_EQ(samples::frames_of(again).frames, frames.frames);
  }
}

// ---- message bytes built by hand, as another implementation or an attacker would build them ----

std::string varint(std::uint64_t value) {
  std::string out;
  for (; value >= 0x80; value >>= 7) out += static_cast<char>(value | 0x80);
  return out + static_cast<char>(value);
}
std::string field(std::uint32_t number, std::uint64_t value) {
  return varint(number << 3 | 0) + varint(value);
}
std::string field(std::uint32_t number, const std::string& bytes) {
  return varint(number << 3 | 2) + varint(bytes.size()) + bytes;
}
std::string fixed32(std::uint32_t number, std::uint32_t value) {
  std::string out = varint(number << 3 | 5);
  for (int i = 0; i < 4; ++i) out += static_cast<char>(value >> (8 * i));
  return out;
}
std::string fixed64(std::uint32_t number, std::uint64_t value) {
  std::string out = varint(number << 3 | 1);
  for (int i = 0; i < 8; ++i) out += static_cast<char>(value >> (8 * i));
  return out;
}

constexpr std::uint32_t kHelloField = 16;
constexpr std::uint32_t kDownscaleField = 18;
constexpr std::uint32_t kCommitField = 19;

std::string envelope(std::uint64_t major = kProtocolMajor, std::uint64_t minor = kProtocolMinor) {
  return fixed32(1, kMagic) + field(2, major) + field(3, minor) + fixed64(4, 77) + field(6, 5);
}

Frames header_only(const std::string& bytes) {
  return {{samples::to_bytes(bytes)}};
}

Code code_of(const std::string& header) {
  return refusal<Request>(header_only(header)).code;
}

TEST(Codec, BytesMadeByHandAreUnderstood) {
  const Request request = decoded<Request>(header_only(envelope() + field(kCommitField, std::string())));
  EXPECT_TRUE(std::holds_alternative<Commit>(request.body));
  EXPECT_EQ(request.request_id, 77U);
  EXPECT_EQ(request.sequence, 5U);
  // The fields of a message may come in any order.
  const std::string backwards = field(kCommitField, std::string()) + field(6, 9) + field(2, 1) + fixed32(1, kMagic);
  EXPECT_EQ(decoded<Request>(header_only(backwards)).sequence, 9U);
}

TEST(Codec, WhatIsNoMessageIsMalformed) {
  EXPECT_THAT(refusal<Request>(header_only("")).text, HasSubstr("the header frame is empty"));
  EXPECT_EQ(code_of("GET / HTTP/1.1\r\nHost: localhost\r\n\r\n"), Code::kMalformed);
  EXPECT_EQ(code_of("hello"), Code::kMalformed);
  EXPECT_EQ(code_of(std::string(100, '\0')), Code::kMalformed);
  // a message without the magic number
  EXPECT_EQ(code_of(field(2, 1) + field(kCommitField, std::string())), Code::kMalformed);
  EXPECT_THAT(refusal<Request>(header_only(fixed32(1, 0x31425354) + field(2, 1))).text,
              HasSubstr("magic 0x31425354, expected 0x31425353"));
  EXPECT_EQ(code_of(envelope()), Code::kMalformed);                      // a header without a body
  EXPECT_EQ(code_of(field(1, kMagic) + field(2, 1)), Code::kMalformed);  // magic number as varint, not as fixed32
  EXPECT_EQ(code_of(envelope() + field(kCommitField, std::string()) + varint(50 << 3 | 3)),
            Code::kMalformed);  // wire type 3, the start of a group
}

TEST(Codec, TwoMessagesInOneFrameAreNotMerged) {
  const std::string one = envelope() + field(kCommitField, std::string());
  EXPECT_THAT(refusal<Request>(header_only(one + one)).text, HasSubstr("stands twice"));
  for (const auto& [name, request] : samples::requests()) {
    const std::string header = encode_header(request);
    EXPECT_EQ(code_of(header + header), Code::kMalformed) << name;
    EXPECT_EQ(code_of(header + one), Code::kMalformed) << name;
  }
  EXPECT_THAT(refusal<Request>(header_only(one + field(kHelloField, std::string()))).text, HasSubstr("two bodies"));
}

TEST(Codec, OtherMajorVersionIsNamedBesideOurs) {
  const Status status = refusal<Request>(header_only(envelope(7, 3) + field(kCommitField, std::string())));
  EXPECT_EQ(status.code, Code::kVersion);
  EXPECT_THAT(status.text, HasSubstr("message of protocol 7.3, this side speaks 1.0"));
  // The version is reported even if the rest of the message has a form that this version of the protocol cannot read.
  EXPECT_EQ(code_of(envelope(7, 3) + envelope(7, 3)), Code::kVersion);
}

TEST(Codec, NewerMinorVersionMayAddFieldsButNotMeanings) {
  const std::string extra = field(200, 1) + field(kCommitField, field(9, 1));
  EXPECT_EQ(code_of(envelope() + extra), Code::kMalformed);
  EXPECT_EQ(code_of(envelope(1, kProtocolMinor + 1) + extra), Code::kOk);
  const std::string mode_of_tomorrow = field(kDownscaleField, field(5, 9));
  EXPECT_EQ(code_of(envelope(1, kProtocolMinor + 1) + mode_of_tomorrow), Code::kMalformed);
}

// A field of a later version may have another type: then it is not the one that is required here.
TEST(Codec, ARequiredFieldOfAnotherTypeIsMissing) {
  constexpr std::uint32_t kStatusField = 9, kResumedField = 23;
  const std::string status = field(kStatusField, field(1, 1));  // OK
  const Status fault =
      refusal<Reply>(header_only(envelope(1, kProtocolMinor + 1) + status + field(kResumedField, field(1, 13))));
  EXPECT_EQ(fault.code, Code::kMalformed);
  EXPECT_EQ(fault.field, "session_resumed.session");
}

TEST(Codec, VerbOfALaterVersionIsUnsupported) {
  constexpr std::uint32_t kLast = 47;  // of the numbers that are reserved for them
  EXPECT_EQ(code_of(envelope() + field(kLast, std::string())), Code::kUnsupported);
  EXPECT_EQ(code_of(envelope(1, 9) + field(kLast, std::string())), Code::kUnsupported);
}

TEST(Codec, IdentityIsLeftForTheAnswer) {
  Request request = samples::request("downscale");
  std::string header = encode_header(request);
  header.back() = static_cast<char>(header.back() ^ 0x40);  // flips one bit in the body of the message
  header += field(200, 1);
  Request found;
  EXPECT_THROW(decode(header_only(header).views(), found), Error);
  EXPECT_EQ(found.request_id, request.request_id);
  EXPECT_EQ(found.session_id, request.session_id);
  EXPECT_EQ(found.sequence, request.sequence);
  EXPECT_THROW(decode(header_only(header.substr(0, 30)).views(), found), Error);
  EXPECT_EQ(found.request_id, request.request_id);
}

TEST(Codec, SessionIdsHaveSixteenBytesOrNone) {
  const std::string body = field(kCommitField, std::string());
  EXPECT_EQ(code_of(envelope() + field(5, std::string(16, 'a')) + body), Code::kOk);
  EXPECT_EQ(code_of(envelope() + field(5, std::string()) + body), Code::kOk);
  for (std::size_t size : {1U, 15U, 17U, 4000U})
    EXPECT_EQ(code_of(envelope() + field(5, std::string(size, 'a')) + body), Code::kMalformed) << size;
  constexpr std::uint32_t kOpenField = 17;
  EXPECT_EQ(code_of(envelope() + field(kOpenField, field(1, std::string()) + field(2, std::string(15, 'a')))),
            Code::kMalformed);
  EXPECT_THAT(refusal<Request>(header_only(envelope() + field(kOpenField, field(2, std::string(16, 'a'))))).text,
              HasSubstr("open_session.scene is not given"));
}

TEST(Codec, ValuesOutsideTheirEnumAreRefused) {
  EXPECT_EQ(code_of(envelope() + field(kDownscaleField, field(5, 3))), Code::kMalformed);  // 3 is no number of a mode
  EXPECT_THAT(refusal<Request>(header_only(envelope() + field(kDownscaleField, std::string()))).text,
              HasSubstr("downscale.mode is not given"));
  // A request may ask for column 30, which replies have, but not for column 5, which they lack.
  EXPECT_EQ(code_of(envelope() + field(kDownscaleField, field(5, 1) + field(7, 5))), Code::kShape);
  EXPECT_EQ(code_of(envelope() + field(kDownscaleField, field(5, 1) + field(7, 30))), Code::kOk);
  EXPECT_THAT(refusal<Request>(header_only(envelope() + field(kDownscaleField, field(5, 3)))).text,
              HasSubstr("downscale.mode = 3 is no value of Mode"));
}

TEST(Codec, TextIsBoundedAndValid) {
  const auto hello = [](const std::string& name) { return envelope() + field(kHelloField, field(3, name)); };
  EXPECT_EQ(code_of(hello(std::string(kMaxTextBytes, 'x'))), Code::kOk);
  EXPECT_EQ(code_of(hello(std::string(kMaxTextBytes + 1, 'x'))), Code::kLimit);
  EXPECT_EQ(code_of(hello("\xFF\xFE")), Code::kMalformed);
}

TEST(Codec, LimitsHoldBeforeAnythingIsParsed) {
  EXPECT_EQ(code_of(std::string(kMaxHeaderBytes + 1, '\0')), Code::kLimit);
  Frames frames = samples::frames_of(samples::request("downscale"));
  frames.frames[1].resize(kMaxPayloadBytes + 1);
  EXPECT_EQ(refusal<Request>(frames).code, Code::kLimit);
}

TEST(Codec, UnknownFieldBombsAreRefused) {
  std::string small;
  while (small.size() < kMaxHeaderBytes - 100) small += field(100, 1);
  EXPECT_EQ(code_of(envelope() + small), Code::kMalformed);
  std::string columns;  // empty sub-messages, which take 20 bytes of memory for each byte sent
  while (columns.size() < kMaxHeaderBytes - 200) columns += field(3, std::string());
  Frames frames = header_only(envelope() + field(8, field(1, 8) + columns) + field(kDownscaleField, field(5, 1)));
  frames.frames.emplace_back(8);
  EXPECT_EQ(refusal<Request>(frames).code, Code::kShape);
  std::string wanted;
  while (wanted.size() < kMaxHeaderBytes - 200) wanted += varint(30);
  EXPECT_EQ(code_of(envelope() + field(kDownscaleField, field(5, 1) + field(7, wanted))), Code::kShape);
  std::string nested = field(1, std::string());  // messages nested deeper than any message of the protocol
  for (int i = 0; i < 200; ++i) nested = field(1, nested);
  EXPECT_EQ(code_of(envelope() + field(kHelloField, field(77, nested))), Code::kMalformed);
}

TEST(Codec, FramesAreOneOrTwoAndAsDeclared) {
  const Frames whole = samples::frames_of(samples::request("downscale"));
  EXPECT_EQ(refusal<Request>(Frames{}).code, Code::kBadFraming);
  EXPECT_EQ(refusal<Request>(Frames{{whole.frames[0]}}).code, Code::kBadFraming);
  EXPECT_EQ(refusal<Request>(Frames{{whole.frames[0], whole.frames[1], {}}}).code, Code::kBadFraming);
  const Frames hello = samples::frames_of(samples::request("hello"));
  EXPECT_EQ(refusal<Request>(Frames{{hello.frames[0], {}}}).code, Code::kBadFraming);
  EXPECT_EQ(refusal<Request>(Frames{{whole.frames[1], whole.frames[0]}}).code, Code::kMalformed);  // frames swapped
  Request commit = samples::request("commit");
  commit.batch = samples::step_columns(1);
  EXPECT_EQ(refusal<Request>(samples::frames_of(commit)).code, Code::kShape);  // a commit has no payload
}

TEST(Codec, ReplyHasABodyExactlyWhenItIsOk) {
  Reply reply = samples::reply("committed");
  reply.status.code = Code::kShape;
  EXPECT_EQ(refusal<Reply>(samples::frames_of(reply)).code, Code::kMalformed);
  reply = samples::reply("committed");
  reply.body = std::monostate{};
  EXPECT_EQ(refusal<Reply>(samples::frames_of(reply)).code, Code::kMalformed);
  reply.status.code = Code::kUnspecified;
  EXPECT_EQ(refusal<Reply>(samples::frames_of(reply)).code, Code::kMalformed);
  reply.status.code = Code::kUnreachable;  // a code that only the client library itself uses, never a server
  EXPECT_EQ(refusal<Reply>(samples::frames_of(reply)).code, Code::kMalformed);
}

TEST(Codec, StatusTextsAreCutNotRefused) {
  Reply reply = samples::reply("refusal");
  reply.status.text = std::string(kMaxSceneBytes - 1, 'x') + "\xC3\xA9 and more";
  reply.status.remedy = "a byte \xFF that is no text";
  reply.status.node_ids.assign(1000, 7);
  const Reply again = decoded<Reply>(samples::frames_of(reply));
  EXPECT_EQ(again.status.text.size(), kMaxSceneBytes);
  EXPECT_TRUE(again.status.text.ends_with("x..."));
  EXPECT_EQ(again.status.remedy, "a byte ? that is no text");
  EXPECT_EQ(again.status.node_ids.size(), kMaxNodesNamed);
}

TEST(Codec, ASceneArrivesAsItWasWritten) {
  Request request = samples::request("open_session");
  auto& opening = std::get<OpenSession>(request.body);
  opening.scene = std::string(kMaxSceneBytes, '#');
  opening.scene[100] = '\r';
  opening.scene[101] = '\n';
  const Request again = decoded<Request>(samples::frames_of(request));
  EXPECT_EQ(std::get<OpenSession>(again.body).scene, opening.scene);
  EXPECT_EQ(std::get<OpenSession>(again.body).scene_file, "sample.toml");
  const auto refused = [&](std::string scene) {
    opening.scene = std::move(scene);
    return support::fault_of([&] { encode_header(request); });
  };
  EXPECT_EQ(refused(std::string(kMaxSceneBytes + 1, '#')).code, Code::kLimit);
  EXPECT_EQ(refused("name = \"\xFF\"").code, Code::kInvalidScene) << "nothing is mended in a scene";
  EXPECT_EQ(refused("name = \"\xFF\"").field, "open_session.scene");
  constexpr std::uint32_t kOpenField = 17;
  const std::string long_scene = field(1, std::string(kMaxSceneBytes + 1, '#'));
  EXPECT_EQ(code_of(envelope() + field(kOpenField, long_scene)), Code::kLimit);
}

TEST(Codec, NumbersArriveAsTheyWereSent) {
  Request request = samples::request("downscale");
  for (double value : {std::nan(""), HUGE_VAL, -HUGE_VAL, -0.0, 5e-324}) {
    std::get<Downscale>(request.body).dt_s = value;
    request.batch.f64(Field::kPressure)[1] = value;
    const Frames frames = samples::frames_of(request);
    const Request again = decoded<Request>(frames);
    EXPECT_EQ(std::bit_cast<std::uint64_t>(std::get<Downscale>(again.body).dt_s), std::bit_cast<std::uint64_t>(value));
    EXPECT_EQ(std::bit_cast<std::uint64_t>(again.batch.f64(Field::kPressure)[1]), std::bit_cast<std::uint64_t>(value));
  }
}

TEST(Codec, PayloadIsReadFromAnyAddress) {
  const Request request = samples::request("downscale");
  const Frames frames = samples::frames_of(request);
  for (std::size_t shift = 0; shift < 8; ++shift) {
    Bytes memory(frames.frames[1].size() + 16);
    std::byte* base = memory.data() + (8 - reinterpret_cast<std::uintptr_t>(memory.data()) % 8) % 8 + shift;
    std::memcpy(base, frames.frames[1].data(), frames.frames[1].size());
    const std::span<const std::byte> views[] = {frames.frames[0], {base, frames.frames[1].size()}};
    Request again;
    decode(views, again);
    EXPECT_TRUE(std::ranges::equal(again.batch.f64(Field::kPressure), request.batch.f64(Field::kPressure)));
    EXPECT_TRUE(std::ranges::equal(again.batch.u64(Field::kNodeId), request.batch.u64(Field::kNodeId)));
  }
}

// ---- damaged frames ----

template <typename Message>
void expect_no_truncation_passes(const std::vector<std::pair<std::string, Message>>& messages) {
  for (const auto& [name, message] : messages) {
    const Frames whole = samples::frames_of(message);
    for (std::size_t size = 0; size < whole.frames[0].size(); ++size) {
      Frames cut = whole;
      cut.frames[0].resize(size);
      EXPECT_NE(refusal<Message>(cut).code, Code::kOk) << name << " header cut to " << size;
    }
    for (std::size_t size = 0; whole.frames.size() == 2 && size < whole.frames[1].size(); ++size) {
      Frames cut = whole;
      cut.frames[1].resize(size);
      EXPECT_EQ(refusal<Message>(cut).code, Code::kChecksum) << name << " payload cut to " << size;
    }
  }
}

TEST(Codec, TruncationAtAnyByteIsRefused) {
  // No header of a sample is a valid message when its end is cut off: the last field of each is the body or a field
  // after the body.
  expect_no_truncation_passes(samples::requests());
  expect_no_truncation_passes(samples::replies());
}

template <typename Message>
void expect_flips_are_seen(const std::vector<std::pair<std::string, Message>>& messages) {
  for (const auto& [name, message] : messages) {
    const Frames whole = samples::frames_of(message);
    for (std::size_t bit = 0; whole.frames.size() == 2 && bit < 8 * whole.frames[1].size(); ++bit) {
      Frames flipped = whole;
      flipped.frames[1][bit / 8] ^= std::byte(1U << bit % 8);
      EXPECT_EQ(refusal<Message>(flipped).code, Code::kChecksum) << name << " payload bit " << bit;
    }
    // The header of a message has no checksum of its own (it relies on that of the transport). A flipped bit makes
    // decode() refuse the message, or changes the decoded message, or turns the 1 of a bool into another nonzero
    // number, which decodes to the same message.
    std::size_t unseen = 0;
    for (std::size_t bit = 0; bit < 8 * whole.frames[0].size(); ++bit) {
      Frames flipped = whole;
      flipped.frames[0][bit / 8] ^= std::byte(1U << bit % 8);
      Message found;
      try {
        decode(flipped.views(), found);
      } catch (const Error&) {
        continue;
      }
      if (samples::frames_of(found).frames == whole.frames) ++unseen;
    }
    EXPECT_LE(unseen, 2 * 6U) << name;  // a sample has at most two bools, and 6 flips of a bool change nothing
  }
}

TEST(Codec, EveryFlippedBitIsSeen) {
  expect_flips_are_seen(samples::requests());
  expect_flips_are_seen(samples::replies());
}

// ---- stability of the format: tests/golden/wire/messages.txt holds the bytes of every kind of message ----

std::string hex(const Bytes& bytes) {
  std::string out;
  for (std::byte byte : bytes) {
    constexpr const char* kDigits = "0123456789abcdef";
    out += kDigits[std::to_integer<int>(byte) >> 4];
    out += kDigits[std::to_integer<int>(byte) & 15];
  }
  return out;
}

TEST(Codec, BytesOnTheWireAreThoseOfTheGoldenFile) {
  std::map<std::string, std::string> found;
  const auto add = [&](const std::string& name, const Frames& frames) {
    found[name + " header"] = hex(frames.frames[0]);
    if (frames.frames.size() == 2) found[name + " payload"] = hex(frames.frames[1]);
  };
  for (const auto& [name, request] : samples::requests()) add("request " + name, samples::frames_of(request));
  for (const auto& [name, reply] : samples::replies()) add("reply " + name, samples::frames_of(reply));

  const std::string path = std::string(SHEARBUS_SOURCE_DIR) + "/tests/golden/wire/messages.txt";
  if (std::getenv("SHEARBUS_UPDATE_GOLDEN")) {
    std::ofstream out(path);
    for (const auto& [name, bytes] : found) out << name << ' ' << bytes << '\n';
  }
  std::ifstream golden(path);
  ASSERT_TRUE(golden);
  std::map<std::string, std::string> expected;
  std::string side, name, part, bytes;
  while (golden >> side >> name >> part >> bytes)
    expected[side.append(" ").append(name).append(" ").append(part)] = bytes;
  EXPECT_EQ(found, expected)
      << "The wire changed. If that is meant: is the minor version raised, does WIRE.md say so? Then "
         "run this test with SHEARBUS_UPDATE_GOLDEN=1.";
}

TEST(Hash, KnowsFramesApart) {
  const Bytes a = samples::to_bytes("abcd");
  const Bytes b = samples::to_bytes("efgh");
  const auto hash = [](std::vector<Bytes> frames) { return hash_of(Frames{std::move(frames)}.views()); };
  EXPECT_EQ(hash({a, b}), hash({a, b}));
  EXPECT_NE(hash({a, b}), hash({b, a}));
  EXPECT_NE(hash({a, b}), hash({samples::to_bytes("abcdefgh")}));
  EXPECT_NE(hash({a, b}), hash({samples::to_bytes("abcde"), samples::to_bytes("fgh")}));
  EXPECT_NE(hash({a}), hash({a, {}}));
}

}  // namespace
}  // namespace shearbus::wire
