// What a request must be before physics sees a number of it. Everything throws wire::Error that names column, nodes and
// value.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "proto/wire/batch.hpp"
#include "proto/wire/messages.hpp"
#include "proto/wire/scene.hpp"
#include "server/shard/node_table.hpp"

namespace shearbus::service {

// The node ids of an opening: at least one, not too many, each once.
std::span<const std::uint64_t> check_opening_nodes(const wire::Batch& batch);

// The initial temperature of each node, solid and above 0 K: the payload's column where there is one, else the scene's.
std::vector<double> check_initial_temperatures(const wire::Batch& batch, const wire::Scene& effective,
                                               double melting_temperature);

// A step's options and columns; returns where its rows belong.
shard::Rows check_step(const wire::Downscale& step, const wire::Batch& batch, const wire::Scene& effective,
                       const shard::NodeTable& nodes);

// The reply's columns: those wanted, or all of the strategy's.
std::vector<wire::Field> check_wanted(const wire::Downscale& step, const wire::Scene& scene);

}  // namespace shearbus::service
