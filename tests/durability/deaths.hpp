// Conversations with servers that die after every request.
#pragma once

#include <gtest/gtest.h>

#include <string>
#include <vector>

#include "tests/support/durable_server.hpp"

namespace shearbus::service {

inline bool is_later_part(const wire::Request& request) {
  const auto* step = std::get_if<wire::Downscale>(&request.body);
  return step != nullptr && step->part > 1;
}

// Requires that servers that die after every request tell what a server tells that never dies, that the next server
// repeats each reply, and that its bytes are those of a repeat before the death: with a checkpoint after every request,
// after every third, and with none. Behind a later part of a step, which does not end it, the reply to the part before is
// repeated, too. `told` returns what of an answer is compared.
template <typename Told>
void expect_deaths_change_nothing(const std::vector<wire::Request>& conversation, const Told& told) {
  for (const std::size_t each : {1, 3, 1000}) {
    MemoryStorage quiet, disk;
    DurableServer undisturbed(quiet);
    std::size_t number = 0;
    for (const wire::Request& request : conversation) {
      const bool later = is_later_part(request);
      SCOPED_TRACE("request " + std::to_string(number) + ", checkpoint every " + std::to_string(each));
      const Answer expected = undisturbed.ask(request);
      ASSERT_EQ(expected.code(), Code::kOk) << describe(expected.reply.status);
      std::string header;
      {
        DurableServer server(disk, store::Durability::kProcess, 77, 1 + static_cast<unsigned>(number % 3));
        if (later) {
          EXPECT_EQ(server.ask(ServiceHarness::in_session(wire::Commit{}, request.sequence)).code(),
                    Code::kNothingToCommit);
        }
        ASSERT_EQ(told(server.ask(request)), told(expected));
        ASSERT_EQ(server.service.status().nodes, undisturbed.service.status().nodes);
        ASSERT_EQ(server.service.status().state_bytes, undisturbed.service.status().state_bytes);
        header = server.ask(request).frames.header;
        if (++number % each == 0) {
          ASSERT_TRUE(server.service.checkpoint());
        }
      }
      DurableServer next(disk);
      const Answer again = next.ask(request);
      ASSERT_TRUE(again.reply.replayed);
      ASSERT_EQ(told(again), told(expected));
      ASSERT_EQ(again.frames.header, header);
      ASSERT_EQ(again.frames.has_payload, expected.frames.has_payload) << "a frame of no bytes is a frame";
      if (later) {
        const Answer before = next.ask(conversation[number - 2]);
        ASSERT_TRUE(before.reply.replayed) << describe(before.reply.status);
        ASSERT_EQ(told(before), told(undisturbed.ask(conversation[number - 2])));
      }
    }
  }
}

}  // namespace shearbus::service
