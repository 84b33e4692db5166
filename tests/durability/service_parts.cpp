// Servers that die between the parts of a step, with a store in memory and no sockets. The answers must have the bits
// of a server that never dies.
#include <gtest/gtest.h>

#include <span>
#include <vector>

#include "tests/durability/deaths.hpp"
#include "tests/support/strategies.hpp"

namespace shearbus::service {
namespace {

constexpr std::size_t kNodes = 21;
constexpr std::uint32_t kParts = 3;

// Steps of three parts; every fourth is a trial that is then committed or rolled back. Some nodes are never named.
wire::Request request_at(Strategy strategy, std::uint64_t sequence) {
  const std::uint64_t step = (sequence - 1) / (kParts + 1), place = (sequence - 1) % (kParts + 1);
  const auto ids = support::node_ids(kNodes);
  const bool trial = step % 2 == 0;
  if (place == kParts) {
    if (trial && step % 4 == 0) return ServiceHarness::in_session(wire::Commit{}, sequence);
    return ServiceHarness::in_session(wire::Rollback{}, sequence);
  }
  wire::Request request = ServiceHarness::step(
      sequence, support::step_columns(strategy, std::span(ids).subspan(6 * place, 6), static_cast<int>(step), true),
      trial ? wire::Mode::kTrial : wire::Mode::kAdvance);
  auto& body = std::get<wire::Downscale>(request.body);
  body.part = static_cast<std::uint32_t>(place + 1);
  body.parts = kParts;
  body.absent_nodes = step % 3 == 0 ? wire::AbsentNodes::kOpen : wire::AbsentNodes::kKeep;
  return request;
}

class PartsOfAStep : public testing::TestWithParam<Strategy> {};
INSTANTIATE_TEST_SUITE_P(Strategies, PartsOfAStep, support::both<Strategy>(), support::name_of_strategy);

// Each later part follows the one before, as if it had been sent before that was answered.
TEST_P(PartsOfAStep, SurviveTheDeathOfTheServerBetweenAnyTwo) {
  std::vector<wire::Request> conversation = {
      ServiceHarness::opening(support::scene_of(GetParam()), support::node_ids(kNodes))};
  for (std::uint64_t i = 1; i <= 36; ++i) {
    wire::Request next = request_at(GetParam(), i);
    conversation.push_back(is_later_part(next) ? ServiceHarness::ahead(std::move(next), conversation.back()) : next);
  }
  expect_deaths_change_nothing(conversation, [](const Answer& answer) { return answer.payload(); });
}

}  // namespace
}  // namespace shearbus::service
