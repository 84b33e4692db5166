#include "server/shard/closure.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

namespace shearbus::shard {

using physics::kLanes;

namespace {

constexpr double kUnknown = std::numeric_limits<double>::infinity();
// accepted difference between the growth of the host's time in a step and the step length dt, relative to dt
constexpr double kTimeTolerance = 1e-6;
// accepted rounding error of the host's time, relative to this time
constexpr double kTimeDigits = 4.0 * std::numeric_limits<double>::epsilon();
// The same for a clock in single precision: four roundings (of the time before and now, and of each in another unit) of
// half a unit in the last place. Beyond this share of dt a difference is a mistake, whatever the clock.
constexpr double kSingleDigits = 2.0 * std::numeric_limits<float>::epsilon();
constexpr double kMostOfSingleDigits = 0.25;

bool grew_by(double dt, double before, double now) {
  const double single = std::min(kSingleDigits * std::abs(now), kMostOfSingleDigits * dt);
  return std::abs(now - before - dt) <= kTimeTolerance * dt + kTimeDigits * std::abs(now) + single;
}

}  // namespace

void TileStates::begin_exchange(double* tile) const {
  if (sums_energy()) std::fill_n(tile + friction_energy, 2 * kLanes, 0.0);
  if (!check_closure()) return;
  std::fill_n(tile + answered_jump, components_ * kLanes, kUnknown);
  std::fill_n(tile + layer_time, kLanes, 0.0);
  std::fill_n(tile + host_time, kLanes, kUnknown);
}

bool checks_closure(const States& states) {
  return std::ranges::find(states.columns, TileStates::kAnsweredJump, &StateColumn::name) != states.columns.end();
}

bool sums_energy(const States& states) {
  return std::ranges::find(states.columns, TileStates::kFrictionEnergy, &StateColumn::name) != states.columns.end();
}

Closure& Closure::operator+=(const Closure& other) {
  if (other.largest > largest || (other.largest == largest && other.row < row)) {
    largest = other.largest;
    row = other.row;
  }
  if (other.time_row < time_row) {
    time_row = other.time_row;
    host_time_step = other.host_time_step;
  }
  timed += other.timed;
  agree += other.agree;
  return *this;
}

Closure exchange(const TileStates& states, const HostStep& step, const physics::TileInputs& in,
                 const physics::TileOutputs& out, std::uint32_t named, std::uint32_t open,
                 const std::uint32_t* lane_rows, const double* from, double* to, double (&difference)[2][kLanes]) {
  const std::size_t components = (states.layer_time - states.answered_jump) / kLanes;
  const double(*const jumps[2])[kLanes] = {&in.velocity_jump, &in.second_velocity_jump};
  const double(*const answers[2])[kLanes] = {&out.velocity_jump_new, &out.second_velocity_jump_new};
  std::copy(from + states.answered_jump, from + states.doubles, to + states.answered_jump);
  Closure closure;
  for (const int lane : physics::lanes_of(named | open)) {
    const auto l = static_cast<std::size_t>(lane);
    const bool has_row = physics::contains(named, lane);
    const bool failed = (out.outcome[lane] & physics::kFailed) != 0;
    double size = 0.0;
    for (std::size_t c = 0; c < components; ++c) {
      const double before = from[states.answered_jump + c * kLanes + l];
      const bool known = std::isfinite(before);
      difference[c][lane] = known ? (*jumps[c])[lane] - before : std::numeric_limits<double>::quiet_NaN();
      size = known ? std::hypot(size, difference[c][lane]) : -1.0;
      to[states.answered_jump + c * kLanes + l] = has_row && !failed ? (*answers[c])[lane] : kUnknown;
    }
    const double host_before = from[states.host_time + l];
    if (!failed) to[states.layer_time + l] = from[states.layer_time + l] + step.dt;
    to[states.host_time + l] = has_row && !failed && step.time != 0.0 ? step.time : kUnknown;
    if (!has_row) continue;
    Closure one{.largest = size, .row = lane_rows[lane]};
    if (std::isfinite(host_before) && step.time != 0.0) {
      one.timed = 1;
      one.agree = grew_by(step.dt, host_before, step.time) ? 1 : 0;
      if (one.agree == 0) {
        one.time_row = lane_rows[lane];
        one.host_time_step = step.time - host_before;
      }
    }
    closure += one;
  }
  return closure;
}

}  // namespace shearbus::shard
