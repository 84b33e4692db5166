// Printed by proto/print_contract.py from shearbus/v1/*.proto, which explain the values. clang-format does not see this file.
// clang-format off
#pragma once

#include <cstddef>
#include <cstdint>

#include "proto/wire/enum_value.hpp"

namespace shearbus::wire {

enum class AbsentNodes { kKeep = 0, kOpen = 1 };
inline constexpr EnumValue kAbsentNodesValues[] = { {0, "KEEP"}, {1, "OPEN"} };
constexpr EnumNames names_of(AbsentNodes) { return {"AbsentNodes", kAbsentNodesValues}; }

enum class Code : std::uint16_t {
  kUnspecified = 0, kOk = 1, kBadFraming = 100, kMalformed = 101, kVersion = 102, kLimit = 103, kChecksum = 104,
  kShape = 105, kUnsupported = 106, kUnknownSession = 200, kStaleSequence = 201, kSequenceGap = 202,
  kSequenceReused = 203, kEpoch = 204, kNothingToCommit = 205, kResumeRefused = 206, kSuperseded = 207,
  kUnknownMark = 208, kTrialStands = 209, kUnknownTransfer = 210, kNotPermitted = 220, kInvalidScene = 300,
  kInvalidValue = 301, kUnknownNode = 302, kDuplicateNode = 303, kNodeOwned = 304, kOtherScene = 305,
  kStepFailed = 306, kShuttingDown = 400, kInternal = 401, kNoSpace = 402, kDraining = 403, kCheckpointFailed = 404,
  kRecovering = 405, kUnreachable = 500, kUnknownOutcome = 501, kUnexpectedReply = 502, kAuth = 503, kNotClosed = 504,
  kNoMemory = 510, kLibraryFault = 511, kInUse = 512, kOtherProcess = 513, kNoLibrary = 514
};
inline constexpr EnumValue kCodeValues[] = {
  {0, "UNSPECIFIED"}, {1, "OK"}, {100, "BAD_FRAMING"}, {101, "MALFORMED"}, {102, "VERSION"}, {103, "LIMIT"},
  {104, "CHECKSUM"}, {105, "SHAPE"}, {106, "UNSUPPORTED"}, {200, "UNKNOWN_SESSION"}, {201, "STALE_SEQUENCE"},
  {202, "SEQUENCE_GAP"}, {203, "SEQUENCE_REUSED"}, {204, "EPOCH"}, {205, "NOTHING_TO_COMMIT"}, {206, "RESUME_REFUSED"},
  {207, "SUPERSEDED"}, {208, "UNKNOWN_MARK"}, {209, "TRIAL_STANDS"}, {210, "UNKNOWN_TRANSFER"}, {220, "NOT_PERMITTED"},
  {300, "INVALID_SCENE"}, {301, "INVALID_VALUE"}, {302, "UNKNOWN_NODE"}, {303, "DUPLICATE_NODE"}, {304, "NODE_OWNED"},
  {305, "OTHER_SCENE"}, {306, "STEP_FAILED"}, {400, "SHUTTING_DOWN"}, {401, "INTERNAL"}, {402, "NO_SPACE"},
  {403, "DRAINING"}, {404, "CHECKPOINT_FAILED"}, {405, "RECOVERING"}, {500, "UNREACHABLE"}, {501, "UNKNOWN_OUTCOME"},
  {502, "UNEXPECTED_REPLY"}, {503, "AUTH"}, {504, "NOT_CLOSED"}, {510, "NO_MEMORY"}, {511, "LIBRARY_FAULT"},
  {512, "IN_USE"}, {513, "OTHER_PROCESS"}, {514, "NO_LIBRARY"}
};
constexpr EnumNames names_of(Code) { return {"Code", kCodeValues}; }

enum class Element : std::uint32_t { kUnspecified = 0, kFloat64 = 1, kUint64 = 2, kUint8 = 3 };
inline constexpr EnumValue kElementValues[] = { {0, "UNSPECIFIED"}, {1, "FLOAT64"}, {2, "UINT64"}, {3, "UINT8"} };
constexpr EnumNames names_of(Element) { return {"Element", kElementValues}; }

enum class Mode { kUnspecified = 0, kAdvance = 1, kTrial = 2 };
inline constexpr EnumValue kModeValues[] = { {0, "UNSPECIFIED"}, {1, "ADVANCE"}, {2, "TRIAL"} };
constexpr EnumNames names_of(Mode) { return {"Mode", kModeValues}; }

enum Outcome : std::uint8_t {
  kOutcomeOk = 0, kSubstepped = 1, kMultipleRoots = 2, kOutsideDomain = 4, kSudden = 8, kOverBudget = 16, kAsleep = 32,
  kFirstOrder = 64, kFailed = 128
};
inline constexpr EnumValue kOutcomeValues[] = {
  {0, "OK"}, {1, "SUBSTEPPED"}, {2, "MULTIPLE_ROOTS"}, {4, "OUTSIDE_DOMAIN"}, {8, "SUDDEN"}, {16, "OVER_BUDGET"},
  {32, "ASLEEP"}, {64, "FIRST_ORDER"}, {128, "FAILED"}
};
constexpr EnumNames names_of(Outcome) { return {"Outcome", kOutcomeValues}; }

enum class Policy { kUnspecified = 0, kAccept = 1, kAllOrNothing = 2 };
inline constexpr EnumValue kPolicyValues[] = { {0, "UNSPECIFIED"}, {1, "ACCEPT"}, {2, "ALL_OR_NOTHING"} };
constexpr EnumNames names_of(Policy) { return {"Policy", kPolicyValues}; }

enum class Regime : std::uint8_t { kOpen = 0, kStick = 1, kCoulomb = 2, kTresca = 3, kMelting = 4 };
inline constexpr EnumValue kRegimeValues[] = {
  {0, "OPEN"}, {1, "STICK"}, {2, "COULOMB"}, {3, "TRESCA"}, {4, "MELTING"}
};
constexpr EnumNames names_of(Regime) { return {"Regime", kRegimeValues}; }

enum class Strategy { kUnspecified = 0, kVelocityDriven = 1, kForceDriven = 2 };
inline constexpr EnumValue kStrategyValues[] = { {0, "UNSPECIFIED"}, {1, "VELOCITY_DRIVEN"}, {2, "FORCE_DRIVEN"} };
constexpr EnumNames names_of(Strategy) { return {"Strategy", kStrategyValues}; }

enum class Top { kUnspecified = 0, kHottest = 1, kFastest = 2, kMolten = 3 };
inline constexpr EnumValue kTopValues[] = { {0, "UNSPECIFIED"}, {1, "HOTTEST"}, {2, "FASTEST"}, {3, "MOLTEN"} };
constexpr EnumNames names_of(Top) { return {"Top", kTopValues}; }

inline constexpr std::size_t kRegimeCount = 5;
inline constexpr std::uint32_t kFirstClientCode = 500;

}  // namespace shearbus::wire
