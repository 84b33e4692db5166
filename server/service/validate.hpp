// Checks of a request before physics uses its numbers. A check that fails throws wire::Error, whose text says what was
// expected and what was found.
#pragma once

#include <fmt/format.h>

#include <cstdint>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "proto/wire/batch.hpp"
#include "proto/wire/messages.hpp"
#include "server/shard/node_table.hpp"
#include "server/shard/shard.hpp"

namespace shearbus::service {

// Throws wire::Error; of many nodes at fault it names the first few.
[[noreturn]] void refuse(wire::Code code, std::string field, std::string text, std::string remedy,
                         std::vector<std::uint64_t> node_ids = {});

// Refuses the rows of a request whose value is not valid(row, value), which is false for NaN. text(node, row, value): what
// is wrong with the first of them.
template <typename Value>
void check_rows(wire::Code code, const std::string& field, std::span<const Value> values, const auto& valid,
                const auto& node_of, const auto& text, const char* remedy) {
  std::vector<std::uint64_t> nodes;
  std::size_t first = 0, faults = 0;
  for (std::size_t row = 0; row < values.size(); ++row) {
    if (valid(row, values[row])) continue;
    if (faults++ == 0) first = row;
    if (nodes.size() < wire::kMaxNodesNamed) nodes.push_back(node_of(row));
  }
  if (faults == 0) return;
  std::string first_fault =
      fmt::format("{} ({} of {} rows at fault)", text(nodes.front(), first, values[first]), faults, values.size());
  refuse(code, field, std::move(first_fault), remedy, std::move(nodes));
}

// The node ids of an opening: unique and not too many. They may be absent only if the session has a domain.
std::span<const std::uint64_t> check_opening_nodes(const wire::Batch& batch, const std::string& domain);

// The ids of nodes to register. There must be at least one, and each must be unique and new to the session.
std::span<const std::uint64_t> check_new_nodes(const wire::Batch& batch, const shard::NodeTable& nodes);

// The node-table slots of the nodes to retire or offer: at least one, each named once and present in the session.
shard::Rows check_leaving_nodes(const wire::Batch& batch, const shard::NodeTable& nodes);

// The node-table slots of the nodes whose profiles are read: at least one, each named once and present in the session.
// Checks the optional column of pressures, too.
shard::Rows check_profile_nodes(const wire::Batch& batch, const shard::NodeTable& nodes);

// Refuses a session that would have too many nodes.
void check_session_size(std::size_t nodes);

// Refuses a name of a mark or a domain that is empty or too long.
void check_name(const std::string& name, const std::string& field);
void check_printable(const std::string& text, const std::string& field);  // refuses control characters

// Refuses a step because some of its nodes have no answer.
[[noreturn]] void refuse_failed_step(const wire::Batch& batch, const shard::NodeTable& nodes,
                                     std::span<const std::uint8_t> outcomes);

// The initial temperature of each node [K], above 0 and below melting: from the payload's column, else from the node's
// model. `nodes`: of a session of several pairs; null: all have the model of these options.
std::vector<double> check_initial_temperatures(const wire::Batch& batch, const physics::ModelOptions& options,
                                               const shard::PairsOfNodes* nodes);

// The column pair of new nodes, empty without one; `names`: length of the request's list of names.
std::span<const std::uint64_t> check_pairs(const wire::Batch& batch, std::size_t names);
// The columns parameter of new nodes; `keys`: the parameters of the session.
void check_parameters(const wire::Batch& batch, std::span<const std::string> keys);
// Refuses what only sessions of several pairs have.
void refuse_pair_columns(const wire::Batch& batch, std::size_t names);

// Checks the length and the end time of a step. Scenes with heat modes or a tolerance have a larger shortest step.
void check_times(const wire::Downscale& step, const physics::ModelOptions& options);

// Checks options and columns of a step; returns for each row of the request the slot of its node in the node table.
shard::Rows check_step(const wire::Downscale& step, const wire::Batch& batch, const shard::Shard& shard);

// Refuses closed contacts of force-driven layers with inertia whose half zones have too little mass for a step of dt.
void check_layer_masses(double dt, const wire::Batch& batch, const shard::Rows& rows, const shard::Shard& shard);

// The columns of the reply: the wanted columns, which belong to `step`, or all default columns of the strategy.
std::span<const wire::Field> check_wanted(const wire::Downscale& step, const shard::Shard& shard);

}  // namespace shearbus::service
