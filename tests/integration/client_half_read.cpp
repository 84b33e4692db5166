// A server that dies while its reply is being read. libzmq 4.3.4 aborts a process (fq.cpp:112) that reads a frame of a
// message when the loss of the connection is noticed after an earlier frame of the message; see receive() in
// client/src/connection.cpp. This program's own zmq_msg_recv() lets the server die at that moment.
#include <dlfcn.h>
#include <gtest/gtest.h>
#include <zmq.h>

#include <chrono>
#include <functional>
#include <thread>

#include "tests/support/scenes.hpp"
#include "tests/support/server_process.hpp"

namespace {
thread_local std::function<void()> after_first_frame;  // called between the frames of a message
}

extern "C" int zmq_msg_recv(zmq_msg_t* message, void* socket, int flags) {
  static const auto receive = reinterpret_cast<int (*)(zmq_msg_t*, void*, int)>(::dlsym(RTLD_NEXT, "zmq_msg_recv"));
  const int size = receive(message, socket, flags);
  if (size >= 0 && after_first_frame && zmq_msg_more(message) != 0) after_first_frame();
  return size;
}

namespace shearbus {
namespace {

using namespace std::chrono_literals;

// libzmq looks for lost connections at every hundredth call of zmq_msg_recv() on a socket. The replies to hello and to
// the opening have one frame and those to steps have two, so that the hundredth call reads the second frame of step 49.
TEST(HalfReadReply, DoesNotEndTheHost) {
  for (const int dies_in : {48, 49, 50}) {
    const support::ScratchDirectory scratch;
    support::ServerProcess server({"--bind", scratch.ipc()});
    ASSERT_TRUE(server.ready()) << server.log();
    Client client({.endpoint = scratch.ipc(), .reply_deadline = 300ms, .retry_after = 100ms});
    const auto nodes = support::node_ids(100);
    Session session = client.open(support::text_of(support::force_scene()), "scene", nodes);
    for (int step = 1; step <= dies_in; ++step) {
      if (step == dies_in)
        after_first_frame = [&] {
          server.process().signal(SIGKILL);
          server.process().exit_code(10s);
          std::this_thread::sleep_for(100ms);  // until libzmq's thread has noticed
        };
      const auto columns = support::step_columns(wire::Strategy::kForceDriven, nodes, step);
      EXPECT_EQ(session.advance(columns, {.dt_s = 1e-9}).upscale().nodes, nodes.size()) << "the reply was complete";
      after_first_frame = nullptr;
    }
    EXPECT_THROW(session.commit(), Error);
    session.leave();
  }
}

}  // namespace
}  // namespace shearbus
