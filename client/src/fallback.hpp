// Internal to the C interface: steps that the host's own law answers while the server is gone, where the user allows it.
#pragma once

#include <chrono>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "client/include/shearbus/shearbus.h"
#include "client/src/options.hpp"

namespace shearbus {

// The time that a user gives the server before the host's law answers, from the text of SHEARBUS_FALLBACK; nothing for
// an empty text. Throws Error{kInvalidValue} for a text that is no time.
std::optional<std::chrono::milliseconds> fallback_patience(const std::string& text);

// A step whose outcome is unknown: the server may have run it. It is repeated before any other request, so that the
// server runs it once, whichever law the host has used.
struct StepInDoubt {
  Batch batch;
  StepOptions options;
};

class Fallback {
 public:
  using Clock = std::chrono::steady_clock;
  // Gives the host's law, or takes it away (nullptr). What the laws have answered stays counted.
  void use(shearbus_fallback_fn law, void* user, std::chrono::milliseconds patience) {
    law_ = law;
    user_ = user;
    patience_ = patience;
  }
  // False if the host has no law, or the user does not allow it.
  bool allowed() const { return law_ != nullptr; }

  // True if a fault says that the server is gone.
  static bool is_gone(Code code);
  // The deadline of the next step: all of the user's patience, or a short one while the server is known to be gone.
  std::chrono::milliseconds deadline() const;
  // True while the server is gone and it is not yet time to look for it again.
  bool waits() const { return away_ && Clock::now() < next_look_; }
  bool away() const { return away_; }

  // Answers a step by the host's law. Throws the fault of the step if the law has no answer. Returns what there is to
  // tell, or "".
  std::string answer(const shearbus_request& request, const wire::Status& fault, std::optional<StepInDoubt> doubt,
                     shearbus_result* result);
  // The server has answered again. Returns what there is to tell, or "".
  std::string came_back();
  // What the whole session had to do without the server; "" if there is nothing, or nothing new since it was told.
  std::string summary();

  const std::optional<StepInDoubt>& doubt() const { return doubt_; }
  void settled() { doubt_.reset(); }
  const shearbus_fallbacks& totals() const { return totals_; }
  const wire::Status& fault() const { return fault_; }

 private:
  shearbus_fallback_fn law_ = nullptr;
  void* user_ = nullptr;
  std::chrono::milliseconds patience_{};
  bool away_ = false;
  Clock::time_point next_look_;
  std::optional<StepInDoubt> doubt_;
  wire::Status fault_;  // of the step that found the server gone
  shearbus_fallbacks totals_ = SHEARBUS_FALLBACKS_INIT;
  shearbus_fallbacks before_ = SHEARBUS_FALLBACKS_INIT;  // the totals when the server was found gone
  std::uint64_t told_ = 0;                               // steps that summary() has told
};

}  // namespace shearbus
