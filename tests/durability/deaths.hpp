// Conversations with servers that die after every request.
#pragma once

#include <gtest/gtest.h>

#include <string>
#include <vector>

#include "tests/support/durable_server.hpp"

namespace shearbus::service {

// Requires that servers that die after every request tell what a server tells that never dies, that the next server
// repeats each reply, and that its bytes are those of a repeat before the death: with a checkpoint after every request,
// after every third, and with none. `told` returns what of an answer is compared.
template <typename Told>
void expect_deaths_change_nothing(const std::vector<wire::Request>& conversation, const Told& told) {
  for (const std::size_t each : {1, 3, 1000}) {
    MemoryStorage quiet, disk;
    DurableServer undisturbed(quiet);
    std::size_t number = 0;
    for (const wire::Request& request : conversation) {
      SCOPED_TRACE("request " + std::to_string(number) + ", checkpoint every " + std::to_string(each));
      const Answer expected = undisturbed.ask(request);
      ASSERT_EQ(expected.code(), Code::kOk) << describe(expected.reply.status);
      std::string header;
      {
        DurableServer server(disk, store::Durability::kProcess, 77, 1 + static_cast<unsigned>(number % 3));
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
    }
  }
}

}  // namespace shearbus::service
