// What operators look at, values to messages and back.
#pragma once

#include "proto/wire/messages.hpp"

namespace shearbus::v1 {
class ServerStatus;
class Inspected;
}  // namespace shearbus::v1

namespace shearbus::wire {

// Texts are cut to kMaxTextBytes and to valid UTF-8.
void to_message(const ServerStatus& from, v1::ServerStatus& to);
void to_message(const Inspected& from, v1::Inspected& to);

// Throws Error{kMalformed} for an id of another length.
ServerStatus from_message(const v1::ServerStatus& from);
Inspected from_message(const v1::Inspected& from);

}  // namespace shearbus::wire
