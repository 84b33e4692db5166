// A scene of several pairs, and new nodes with pairs and parameters.
#pragma once

#include <algorithm>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "tests/support/scenes.hpp"
#include "tests/support/service_harness.hpp"

namespace shearbus::fuzz {

inline const std::vector<std::string> kPairNames = {"", "lead", "copper"};
inline const std::vector<std::string> kParameterKeys = {"soft.yield_strength_pa",
                                                        "soft.thermal_conductivity_w_per_m_k"};

inline std::string scene_of_pairs(const v1::Scene& scene) {
  return support::text_of(scene) +
         "\n[pair.lead.soft]\nmaterial = \"aluminium_dlp\"\nyield_strength_pa = 20e6\n"
         "[pair.copper.hard]\nmaterial = \"copper_ofhc\"\n";
}

// Nodes of all pairs in turn; their parameters differ from node to node.
inline wire::Batch nodes_of_pairs(std::span<const std::uint64_t> nodes) {
  using wire::Field;
  wire::Batch batch = wire::Batch::of(std::vector{Field::kNodeId, Field::kPair, Field::kParameter}, nodes.size(), 2);
  std::ranges::copy(nodes, batch.u64(Field::kNodeId).begin());
  for (std::size_t i = 0; i < nodes.size(); ++i) {
    batch.u64(Field::kPair)[i] = i % kPairNames.size();
    batch.f64(Field::kParameter, 0)[i] = 25e6 + 1e6 * static_cast<double>(i);
    batch.f64(Field::kParameter, 1)[i] = 100.0 + static_cast<double>(i);
  }
  return batch;
}

inline wire::Request opening_of_pairs(const v1::Scene& scene, std::span<const std::uint64_t> nodes,
                                      std::uint8_t session = 1, const std::string& domain = {}) {
  wire::Request request = support::ServiceHarness::opening(scene_of_pairs(scene), nodes, session);
  request.batch = nodes_of_pairs(nodes);
  auto& open = std::get<wire::OpenSession>(request.body);
  open.pairs = kPairNames;
  open.parameters = kParameterKeys;
  open.domain = domain;
  return request;
}

inline wire::Request registration_of_pairs(std::uint64_t sequence, std::span<const std::uint64_t> nodes,
                                           std::uint8_t session = 1) {
  wire::Request request =
      support::ServiceHarness::in_session(wire::RegisterNodes{.pairs = kPairNames}, sequence, session);
  request.batch = nodes_of_pairs(nodes);
  return request;
}

}  // namespace shearbus::fuzz
