// The C++ enums are the proto's, number by number: checked when this is compiled.
#include "proto/wire/messages.hpp"
#include "shearbus/v1/envelope.pb.h"

namespace shearbus::wire {
namespace {

template <typename Ours, typename Theirs>
constexpr bool same(Ours ours, Theirs theirs) {
  return static_cast<long>(ours) == static_cast<long>(theirs);
}
static_assert(same(Element::kFloat64, v1::ELEMENT_FLOAT64) && same(Element::kUint64, v1::ELEMENT_UINT64) &&
              same(Element::kUint8, v1::ELEMENT_UINT8));
static_assert(same(Mode::kAdvance, v1::MODE_ADVANCE) && same(Mode::kTrial, v1::MODE_TRIAL) &&
              same(Policy::kAccept, v1::POLICY_ACCEPT) && same(Policy::kAllOrNothing, v1::POLICY_ALL_OR_NOTHING));
static_assert(same(Regime::kOpen, v1::REGIME_OPEN) && same(Regime::kStick, v1::REGIME_STICK) &&
              same(Regime::kCoulomb, v1::REGIME_COULOMB) && same(Regime::kTresca, v1::REGIME_TRESCA) &&
              same(Regime::kMelting, v1::REGIME_MELTING));
static_assert(same(kOutcomeOk, v1::OUTCOME_OK) && same(kSubstepped, v1::OUTCOME_SUBSTEPPED) &&
              same(kMultipleRoots, v1::OUTCOME_MULTIPLE_ROOTS) && same(kOutsideDomain, v1::OUTCOME_OUTSIDE_DOMAIN) &&
              same(kAsleep, v1::OUTCOME_ASLEEP) && same(kFirstOrder, v1::OUTCOME_FIRST_ORDER) &&
              same(kFailed, v1::OUTCOME_FAILED));
static_assert(same(Strategy::kVelocityDriven, v1::STRATEGY_VELOCITY_DRIVEN) &&
              same(Strategy::kForceDriven, v1::STRATEGY_FORCE_DRIVEN));
static_assert(same(Code::kOk, v1::CODE_OK) && same(Code::kBadFraming, v1::CODE_BAD_FRAMING) &&
              same(Code::kMalformed, v1::CODE_MALFORMED) && same(Code::kVersion, v1::CODE_VERSION) &&
              same(Code::kLimit, v1::CODE_LIMIT) && same(Code::kChecksum, v1::CODE_CHECKSUM) &&
              same(Code::kShape, v1::CODE_SHAPE) && same(Code::kUnsupported, v1::CODE_UNSUPPORTED) &&
              same(Code::kUnknownSession, v1::CODE_UNKNOWN_SESSION) &&
              same(Code::kStaleSequence, v1::CODE_STALE_SEQUENCE) && same(Code::kSequenceGap, v1::CODE_SEQUENCE_GAP) &&
              same(Code::kSequenceReused, v1::CODE_SEQUENCE_REUSED) && same(Code::kEpoch, v1::CODE_EPOCH) &&
              same(Code::kNothingToCommit, v1::CODE_NOTHING_TO_COMMIT) &&
              same(Code::kInvalidScene, v1::CODE_INVALID_SCENE) && same(Code::kInvalidValue, v1::CODE_INVALID_VALUE) &&
              same(Code::kUnknownNode, v1::CODE_UNKNOWN_NODE) && same(Code::kDuplicateNode, v1::CODE_DUPLICATE_NODE) &&
              same(Code::kShuttingDown, v1::CODE_SHUTTING_DOWN) && same(Code::kInternal, v1::CODE_INTERNAL) &&
              same(Code::kResumeRefused, v1::CODE_RESUME_REFUSED) && same(Code::kSuperseded, v1::CODE_SUPERSEDED) &&
              same(Code::kUnknownMark, v1::CODE_UNKNOWN_MARK) && same(Code::kNoSpace, v1::CODE_NO_SPACE) &&
              same(Code::kTrialStands, v1::CODE_TRIAL_STANDS) &&
              same(Code::kUnknownTransfer, v1::CODE_UNKNOWN_TRANSFER) && same(Code::kNodeOwned, v1::CODE_NODE_OWNED) &&
              same(Code::kOtherScene, v1::CODE_OTHER_SCENE) && same(Code::kStepFailed, v1::CODE_STEP_FAILED) &&
              same(Code::kNotPermitted, v1::CODE_NOT_PERMITTED) && same(Code::kDraining, v1::CODE_DRAINING) &&
              same(Code::kCheckpointFailed, v1::CODE_CHECKPOINT_FAILED));
static_assert(same(Top::kHottest, v1::TOP_HOTTEST) && same(Top::kFastest, v1::TOP_FASTEST) &&
              same(Top::kMolten, v1::TOP_MOLTEN));

}  // namespace
}  // namespace shearbus::wire
