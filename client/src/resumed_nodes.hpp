// The nodes of a resumed session: what the reply `session_resumed` tells of their pairs and parameters.
#pragma once

#include <cstdint>
#include <span>
#include <string>

#include "client/src/connection.hpp"
#include "client/src/options.hpp"

namespace shearbus {

// Throws Error{kResumeRefused} with the first nodes whose pair or parameters are not as expected, or which the session
// does not have. `where`: a reply `session_resumed`.
void check_resumed_nodes(const Received& where, const ExpectedNodes& expected);

// A warning about nodes of the session that a host which names its nodes leaves out, as one with another mesh does; empty
// where there are none.
std::string nodes_left_out(const Received& where, const ExpectedNodes& expected);

// Copies what the columns of such a reply tell of the nodes.
ResumedNodes resumed_nodes(const Batch& rows, const wire::SessionOpened& session);

}  // namespace shearbus
