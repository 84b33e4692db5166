// Messages that stay in their process go without the sums of their payloads, and no others do.
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <memory>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "client/src/client.hpp"
#include "client/src/connection.hpp"
#include "proto/wire/codec.hpp"
#include "tests/support/direct_connection.hpp"
#include "tests/support/durable_server.hpp"
#include "tests/support/memory_storage.hpp"
#include "tests/support/refused.hpp"
#include "tests/support/scenes.hpp"
#include "tests/support/service_harness.hpp"

namespace shearbus {
namespace {

using support::code_of;
using support::DurableServer;
using support::MemoryStorage;
using support::ServiceHarness;
using wire::Code;
using wire::PayloadSum;

const service::Caller kInProcess{.identity = "process", .in_process = true};
const std::vector<std::uint64_t> kNodes = support::node_ids(11);

wire::Request step(std::uint64_t sequence, int number) {
  return ServiceHarness::step(sequence, support::step_columns(wire::Strategy::kVelocityDriven, kNodes, number));
}

wire::Request opening() {
  wire::Request request = ServiceHarness::opening(support::velocity_scene(), kNodes);
  std::get<wire::OpenSession>(request.body).resume_token.fill(9);
  return request;
}

// The frames of a request.
struct Message {
  Message(const wire::Request& request, PayloadSum sum)
      : header(wire::encode_header(request, {}, sum)),
        payload(request.batch.bytes().begin(), request.batch.bytes().end()),
        frames{std::as_bytes(std::span(header)), payload} {}
  Message(const Message&) = delete;
  Message& operator=(const Message&) = delete;

  std::string header;
  std::vector<std::byte> payload;
  std::array<std::span<const std::byte>, 2> frames;
};

TEST(PayloadSums, MayBeMissingOnlyWhereTheMessageIsTrusted) {
  const Message without(step(1, 1), PayloadSum::kLeftOut);
  wire::Request found;
  EXPECT_EQ(code_of([&] { wire::decode(without.frames, found); }), Code::kChecksum);
  EXPECT_EQ(wire::decode(without.frames, found, PayloadSum::kLeftOut), PayloadSum::kLeftOut);
  EXPECT_TRUE(std::ranges::equal(found.batch.bytes(), without.payload));

  Message with(step(1, 1), PayloadSum::kGiven);
  EXPECT_EQ(wire::decode(with.frames, found, PayloadSum::kLeftOut), PayloadSum::kGiven);
  with.payload[13] ^= std::byte{4};
  EXPECT_EQ(code_of([&] { wire::decode(with.frames, found, PayloadSum::kLeftOut); }), Code::kChecksum)
      << "a sum that is given is compared";
}

TEST(PayloadSums, OfAnAnswerAreLeftOutWhereThoseOfTheRequestWere) {
  ServiceHarness harness;
  harness.ask(opening(), kInProcess);
  const Message without(step(1, 1), PayloadSum::kLeftOut);
  EXPECT_EQ(harness.ask_bytes(without.frames).code(), Code::kChecksum) << "it comes from outside";
  const auto sum_of_answer = [&](const Message& message) {
    auto answer = harness.service.handle(message.frames, kInProcess);
    wire::Reply reply;
    const std::array<std::span<const std::byte>, 2> frames = {std::as_bytes(std::span(answer->header)),
                                                              answer->payload};
    const PayloadSum sum = wire::decode(frames, reply, PayloadSum::kLeftOut);
    EXPECT_EQ(reply.status.code, Code::kOk) << reply.status.text;
    return sum;
  };
  EXPECT_EQ(sum_of_answer(without), PayloadSum::kLeftOut);
  EXPECT_EQ(sum_of_answer(without), PayloadSum::kLeftOut) << "the kept answer";
  EXPECT_EQ(sum_of_answer(Message(step(2, 2), PayloadSum::kGiven)), PayloadSum::kGiven);
}

TEST(PayloadSums, AreNotMissedByARecovery) {
  const auto run = [](PayloadSum sum) {
    MemoryStorage disk;
    const service::Caller caller = sum == PayloadSum::kLeftOut ? kInProcess : service::Caller{.identity = "process"};
    std::vector<std::byte> last;
    for (std::uint64_t start = 0; start < 3; ++start) {  // the last one recovers from a checkpoint and a journal
      DurableServer server(disk, store::Durability::kProcess, 77 + start);
      const auto ask = [&](const wire::Request& request) {
        const Message message(request, sum);
        auto answer = server.try_ask(message.frames, caller);
        EXPECT_TRUE(answer && answer->code() == Code::kOk);
        return answer->payload();
      };
      if (start == 0) ask(opening());
      for (std::uint64_t i = 1; i <= 2; ++i) last = ask(step(2 * start + i, static_cast<int>(2 * start + i)));
      if (start == 1) {
        EXPECT_TRUE(server.service.checkpoint());
      }
      EXPECT_EQ(ask(step(2 * start + 2, static_cast<int>(2 * start + 2))), last) << "the kept answer";
      disk.die_of_process();
    }
    return last;
  };
  EXPECT_EQ(run(PayloadSum::kLeftOut), run(PayloadSum::kGiven));
}

// A connection within the process that may lose an answer.
class LosingConnection final : public Connection {
 public:
  explicit LosingConnection(ServiceHarness& server) : Connection({}), server_(server) { leave_out_payload_sums(); }
  Received call(const wire::Request& request, std::chrono::milliseconds) override {
    support::Answer answer = server_.ask(request, kInProcess);
    if (std::exchange(lose, false)) throw Error({.code = Code::kUnknownOutcome, .text = "no answer"});
    return support::received(std::move(answer), PayloadSum::kLeftOut);
  }
  void say(const wire::Request&) noexcept override {}

  bool lose = false;

 private:
  ServiceHarness& server_;
};

// Without a sum the headers of two steps may be equal but for their ids.
TEST(PayloadSums, ThatAreLeftOutLetNoOtherStepPassForTheOneWhoseAnswerWasLost) {
  ServiceHarness server;
  auto connection = std::make_shared<LosingConnection>(server);
  Client client(connection);
  Session session = client.open(support::text_of(support::velocity_scene()), "scene", kNodes);
  const auto advance = [&](int number) {
    session.advance(support::step_columns(wire::Strategy::kVelocityDriven, kNodes, number), {.dt_s = 1e-9});
  };
  advance(1);
  connection->lose = true;
  EXPECT_EQ(code_of([&] { advance(2); }), Code::kUnknownOutcome);
  EXPECT_EQ(code_of([&] { advance(3); }), Code::kSequenceReused) << "step 2 has run, and this is another";
  connection->lose = true;
  EXPECT_EQ(code_of([&] { advance(4); }), Code::kUnknownOutcome);
  EXPECT_EQ(code_of([&] { advance(4); }), Code::kOk);
  session.close();
}

}  // namespace
}  // namespace shearbus
