// Names of the wire that the files of this room use.
#pragma once

#include "proto/wire/batch.hpp"
#include "proto/wire/status.hpp"

namespace shearbus::replay {

using wire::Batch;
using wire::Code;
using wire::Error;
using wire::Field;
using wire::Form;
using wire::Status;

}  // namespace shearbus::replay
