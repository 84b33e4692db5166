// Several servers as one: which servers an endpoint text names, which of them has a node, and under which names they
// know a session. The same in every language (proto/WIRE.md, "Several servers").
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "proto/wire/messages.hpp"

namespace shearbus {

// Returns the endpoints in a text: one, or several with a comma between them. A directory of endpoint files (file://DIR)
// stands for its files in the order of their names. Throws Error{kInvalidValue} if an endpoint is empty or named twice,
// or if a directory has no endpoint files or cannot be read.
std::vector<std::string> endpoints_in(const std::string& text);

// Returns the shard of a node, from 0 to shards - 1, by rendezvous hashing: another shard added behind the last one
// takes 1 in (shards + 1) of the nodes and moves no other node.
std::uint32_t shard_of(std::uint64_t node_id, std::uint32_t shards);

// The id and the domain by which shard number `shard` of `shards` knows a session. A server refuses two shards of one
// domain, and a ticket that is used with another list of servers finds no session.
wire::SessionId session_of_shard(const wire::SessionId& session, std::uint32_t shard, std::uint32_t shards);
std::string domain_of_shard(const std::string& domain, std::uint32_t shard, std::uint32_t shards);

}  // namespace shearbus
