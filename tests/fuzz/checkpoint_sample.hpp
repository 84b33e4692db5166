// A small checkpoint with every kind of content: sessions of two strategies, a trial step, marks, a closed session,
// nodes of several pairs, a step in parts, offered nodes.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "tests/fuzz/pairs_sample.hpp"
#include "tests/support/durable_server.hpp"
#include "tests/support/memory_storage.hpp"

namespace shearbus::fuzz {

inline constexpr std::uint64_t kSampleGeneration = 1;

inline constexpr wire::TransferId kSampleTransfer = {1};  // of an offer that session 6 may accept

inline std::vector<std::byte> sample_checkpoint() {
  using support::ServiceHarness;
  const auto nodes = support::node_ids(3);
  support::MemoryStorage disk;
  support::DurableServer server(disk, store::Durability::kNone);
  const auto ask = [&](wire::Request request) {
    if (server.ask(request).code() != wire::Code::kOk) throw std::logic_error("the sample's requests are sound");
  };
  const auto step = [&](wire::Strategy strategy, std::uint64_t sequence, wire::Mode mode, std::uint8_t session) {
    ask(ServiceHarness::step(sequence, support::step_columns(strategy, nodes, static_cast<int>(sequence)), mode,
                             session));
  };
  v1::Scene heated = support::velocity_scene(4);
  heated.mutable_velocity_driven()->set_taylor_quinney_factor(0.9);
  heated.mutable_hard_layer();
  ask(ServiceHarness::opening(heated, nodes, 1));
  step(wire::Strategy::kVelocityDriven, 1, wire::Mode::kAdvance, 1);
  ask(ServiceHarness::in_session(wire::Mark{.name = "dump"}, 2, 1));
  step(wire::Strategy::kVelocityDriven, 3, wire::Mode::kTrial, 1);
  ask(ServiceHarness::opening(support::force_scene(4), nodes, 2));
  step(wire::Strategy::kForceDriven, 1, wire::Mode::kAdvance, 2);
  ask(ServiceHarness::opening(support::force_scene(4), nodes, 3));
  ask(ServiceHarness::in_session(wire::CloseSession{}, 1, 3));
  ask(opening_of_pairs(support::force_scene(4), nodes, 4));
  step(wire::Strategy::kForceDriven, 1, wire::Mode::kTrial, 4);

  ask(opening_of_pairs(support::force_scene(4), nodes, 5, "domain"));
  ask(opening_of_pairs(support::force_scene(4), std::vector{nodes.back() + 1}, 6, "domain"));
  ask(ServiceHarness::of_nodes(wire::OfferNodes{kSampleTransfer}, std::span(nodes).last(1), 1, 5));
  const auto part = [&](std::uint32_t number) {
    const auto one = std::span(nodes).subspan(number - 1, 1);
    wire::Request request = ServiceHarness::step(
        1 + number, support::step_columns(wire::Strategy::kForceDriven, one, 2, true), wire::Mode::kAdvance, 5);
    std::get<wire::Downscale>(request.body).part = number;
    std::get<wire::Downscale>(request.body).parts = 3;
    return request;
  };
  ask(part(1));
  ask(ServiceHarness::ahead(part(2), part(1)));
  if (!server.service.checkpoint()) throw std::logic_error("the sample's checkpoint could not be written");
  return disk.bytes(store::checkpoint_name(kSampleGeneration));
}

}  // namespace shearbus::fuzz
