#include "proto/wire/status.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

namespace shearbus::wire {

const char* name(Code code) {
  switch (code) {
    case Code::kUnspecified:
      return "UNSPECIFIED";
    case Code::kOk:
      return "OK";
    case Code::kBadFraming:
      return "BAD_FRAMING";
    case Code::kMalformed:
      return "MALFORMED";
    case Code::kVersion:
      return "VERSION";
    case Code::kLimit:
      return "LIMIT";
    case Code::kChecksum:
      return "CHECKSUM";
    case Code::kShape:
      return "SHAPE";
    case Code::kUnsupported:
      return "UNSUPPORTED";
    case Code::kUnknownSession:
      return "UNKNOWN_SESSION";
    case Code::kStaleSequence:
      return "STALE_SEQUENCE";
    case Code::kSequenceGap:
      return "SEQUENCE_GAP";
    case Code::kSequenceReused:
      return "SEQUENCE_REUSED";
    case Code::kEpoch:
      return "EPOCH";
    case Code::kNothingToCommit:
      return "NOTHING_TO_COMMIT";
    case Code::kResumeRefused:
      return "RESUME_REFUSED";
    case Code::kSuperseded:
      return "SUPERSEDED";
    case Code::kUnknownMark:
      return "UNKNOWN_MARK";
    case Code::kTrialStands:
      return "TRIAL_STANDS";
    case Code::kUnknownTransfer:
      return "UNKNOWN_TRANSFER";
    case Code::kNotPermitted:
      return "NOT_PERMITTED";
    case Code::kInvalidScene:
      return "INVALID_SCENE";
    case Code::kInvalidValue:
      return "INVALID_VALUE";
    case Code::kUnknownNode:
      return "UNKNOWN_NODE";
    case Code::kDuplicateNode:
      return "DUPLICATE_NODE";
    case Code::kNodeOwned:
      return "NODE_OWNED";
    case Code::kOtherScene:
      return "OTHER_SCENE";
    case Code::kStepFailed:
      return "STEP_FAILED";
    case Code::kShuttingDown:
      return "SHUTTING_DOWN";
    case Code::kInternal:
      return "INTERNAL";
    case Code::kNoSpace:
      return "NO_SPACE";
    case Code::kDraining:
      return "DRAINING";
    case Code::kCheckpointFailed:
      return "CHECKPOINT_FAILED";
    case Code::kUnreachable:
      return "UNREACHABLE";
    case Code::kUnknownOutcome:
      return "UNKNOWN_OUTCOME";
    case Code::kUnexpectedReply:
      return "UNEXPECTED_REPLY";
    case Code::kAuth:
      return "AUTH";
  }
  return "?";
}

std::string describe(const Status& status) {
  std::string line = fmt::format("{}: {}", name(status.code), status.text);
  if (!status.node_ids.empty()) line += fmt::format(" [nodes {}]", fmt::join(status.node_ids, ", "));
  if (!status.remedy.empty()) line += (line.ends_with('.') ? " " : ". ") + status.remedy;
  return line;
}

}  // namespace shearbus::wire
