#include "proto/wire/codec.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

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

// The status decode() refuses with; kOk where it does not.
template <typename Message>
Status refusal(const Frames& frames) {
  Message message;
  try {
    decode(frames.views(), message);
  } catch (const Error& error) {
    return error.status();
  }
  return {};
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
    EXPECT_EQ(samples::frames_of(again).frames, frames.frames);  // every field survives, payload included
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

}  // namespace
}  // namespace shearbus::wire
