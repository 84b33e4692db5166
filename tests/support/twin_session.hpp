// A session on the server under test, and its twin on a server that runs undisturbed.
#pragma once

#include <gtest/gtest.h>

#include <algorithm>
#include <utility>
#include <vector>

#include "client/src/client.hpp"
#include "server/embedded.hpp"
#include "tests/support/scenes.hpp"

namespace shearbus::support {

class TwinSession {
 public:
  TwinSession(ClientOptions options, wire::Strategy strategy, std::vector<std::uint64_t> nodes)
      : strategy_(strategy),
        nodes_(std::move(nodes)),
        client_(std::move(options)),
        quiet_client_({.endpoint = quiet_.endpoint(), .context = quiet_.context()}),
        session_(client_.open(text_of(scene_of(strategy)), "scene", nodes_)),
        twin_(quiet_client_.open(text_of(scene_of(strategy)), "scene", nodes_)) {}

  // Makes the next step in both sessions, whose answers must have the same bits. An exception of the client is passed
  // on; the next call then repeats the step.
  void step() {
    const auto columns = step_columns(strategy_, nodes_, steps_);
    const auto& here = session_.advance(columns, {.dt_s = 1e-9});
    const auto& there = twin_.advance(columns, {.dt_s = 1e-9});
    ASSERT_TRUE(std::ranges::equal(here.batch().bytes(), there.batch().bytes())) << "step " << steps_;
    ++steps_;
  }
  void steps(int count) {
    for (int i = 0; i < count; ++i) step();
  }
  int steps_done() const { return steps_; }
  Client& client() { return client_; }
  // Requires that the server has run each step exactly once, and `foreign` node-steps besides. The count is valid only
  // if the server was not restarted.
  void expect_each_step_once(std::uint64_t foreign = 0) {
    EXPECT_EQ(client_.server_status().node_steps - foreign, static_cast<std::uint64_t>(steps_) * nodes_.size());
  }

 private:
  wire::Strategy strategy_;
  std::vector<std::uint64_t> nodes_;
  server::Embedded quiet_;
  Client client_;
  Client quiet_client_;
  Session session_;
  Session twin_;
  int steps_ = 0;
};

}  // namespace shearbus::support
