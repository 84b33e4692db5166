// What a request must be before physics sees a number of it. Everything throws wire::Error that names column, nodes and
// value.
#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "proto/wire/batch.hpp"
#include "proto/wire/messages.hpp"
#include "server/shard/node_table.hpp"
#include "server/shard/shard.hpp"

namespace shearbus::service {

// The node ids of an opening: not too many, each once; none only in a domain, where others may come.
std::span<const std::uint64_t> check_opening_nodes(const wire::Batch& batch, const std::string& domain);

// Nodes to register: as in an opening, at least one, and none that is there already.
std::span<const std::uint64_t> check_new_nodes(const wire::Batch& batch, const shard::NodeTable& nodes);

// Nodes to retire or offer: at least one, all there, each once.
shard::Rows check_leaving_nodes(const wire::Batch& batch, const shard::NodeTable& nodes);

// Of a session's nodes together.
void check_session_size(std::size_t nodes);

// A name a client chose, of a mark or a domain.
void check_name(const std::string& name, const std::string& field);

// Refuses a step of which some nodes have no answer.
[[noreturn]] void refuse_failed_step(const wire::Batch& batch, const shard::NodeTable& nodes,
                                     std::span<const std::uint8_t> outcomes);

// The initial temperature of each node, solid and above 0 K: the payload's column where there is one, else the model's.
std::vector<double> check_initial_temperatures(const wire::Batch& batch, const physics::ModelOptions& options);

// A step's options and columns; returns where its rows belong.
shard::Rows check_step(const wire::Downscale& step, const wire::Batch& batch, const physics::ModelOptions& options,
                       const shard::NodeTable& nodes);

// The reply's columns: those wanted, or all of the strategy's.
std::vector<wire::Field> check_wanted(const wire::Downscale& step, const physics::ModelOptions& options);

}  // namespace shearbus::service
