#include "client/src/diagnosis.hpp"

#include <algorithm>
#include <cmath>

namespace shearbus::closure {
namespace {

constexpr double kRelative = 1e-6;  // accepted error of a velocity jump, relative to the jump
constexpr double kAbsolute = 1e-6;  // accepted error of a velocity jump in addition to kRelative  [m/s]
constexpr double kRounding = 1e-8;  // relative error of a velocity jump as a difference of far larger velocities

// A mistake of a host, described by wrong factors on what it computes its new velocity jump from; a correct host has only
// factors of 1. `crossed`: each far stress acts on the mass of the other body.
struct FarField {
  const char* text = nullptr;
  double soft = 1.0, hard = 1.0;            // stress_soft, stress_hard
  double to_soft = 1.0, to_hard = 1.0;      // the answered stress on the soft and hard body
  double mass_soft = 1.0, mass_hard = 1.0;  // masses
  bool crossed = false;

  double new_jump(const Row& row, double dt) const {
    const double of_soft = mass_soft * row.mass_soft, of_hard = mass_hard * row.mass_hard;
    const double own =
        soft * row.stress_soft / (crossed ? of_hard : of_soft) + hard * row.stress_hard / (crossed ? of_soft : of_hard);
    return row.jump + dt * own - dt * row.stress * (to_soft / of_soft + to_hard / of_hard);
  }
};

// A host in far-field form that sends the jump of another time level. `coming`, `own`, ...: factors on what the jump has
// beside the one of the last step: what the host's own stresses add in this step and in the last one, what friction
// takes in the last step and in the one before, and the whole change of the step before.
struct TimeLevel {
  const char* text;
  double coming = 0.0, own = 0.0, friction = 0.0, friction_before = 0.0, change_before = 0.0;

  double new_jump(const Row& row, double dt) const {
    const auto term = [](double factor, double value) { return factor == 0.0 ? 0.0 : factor * value; };
    return row.jump + term(coming, row.coming) +
           own * dt * (row.stress_soft / row.mass_soft + row.stress_hard / row.mass_hard) -
           friction * dt * row.stress * (1.0 / row.mass_soft + 1.0 / row.mass_hard) -
           term(friction_before, row.friction_before) + term(change_before, row.change_before);
  }
};

constexpr const char* kEarlierStep =
    "the jump sent is that of an earlier step: send the one to which the last answered stress was applied";
constexpr const char* kForcesApplied =
    "the jump sent is that after the forces of this step, without friction: send the one before the forces act";

constexpr TimeLevel kTimeLevels[] = {
    {.text = kEarlierStep, .change_before = 1.0},
    {.text = "the jump sent is that without the friction of the last step: send the one with friction",
     .own = 1.0,
     .friction_before = 1.0},
    {.text = kForcesApplied, .coming = 1.0, .friction = 1.0},
};

constexpr FarField kFarField[] = {
    {.text = "stress_soft has the wrong sign", .soft = -1.0},
    {.text = "stress_hard has the wrong sign", .hard = -1.0},
    {.text = "stress_soft and stress_hard both have the wrong sign", .soft = -1.0, .hard = -1.0},
    {.text = "velocity_jump has the wrong sign: it is V_soft - V_hard", .mass_soft = -1.0, .mass_hard = -1.0},
    {.text = "the two sides of the stresses, or of the masses, are swapped", .crossed = true},
    {.text =
         "the answered stress is applied with the wrong sign: it pulls the soft body back where the jump is positive",
     .to_soft = -1.0,
     .to_hard = -1.0},
    {.text = "the answered stress is applied to the soft body only", .to_hard = 0.0},
    {.text = "the answered stress is applied to the hard body only", .to_soft = 0.0},
    {.text = "the answered stress is not applied", .to_soft = 0.0, .to_hard = 0.0},
    {.text = "the answered stress is applied with the wrong sign to the soft body", .to_soft = -1.0},
    {.text = "the answered stress is applied with the wrong sign to the hard body", .to_hard = -1.0},
    {.text = "both masses must be twice those sent, or dt_s half of that sent", .mass_soft = 2.0, .mass_hard = 2.0},
    {.text = "both masses must be half of those sent, or dt_s twice that sent", .mass_soft = 0.5, .mass_hard = 0.5},
    {.text = "mass_soft must be twice that sent", .mass_soft = 2.0},
    {.text = "mass_soft must be half of that sent", .mass_soft = 0.5},
    {.text = "mass_hard must be twice that sent", .mass_hard = 2.0},
    {.text = "mass_hard must be half of that sent", .mass_hard = 0.5},
};

// A mistake of a host that sends stick stress and impedance, described by wrong factors as in FarField. `add_jump` is 1
// if the host left the old jump out of its stick stress. A Newmark scheme with gamma = 1/2 has the predictor
// 2 [V]new - [V]predictor for the next step.
struct Stick {
  const char* text = nullptr;
  double stick = 1.0, answer = 1.0, add_jump = 0.0;

  double new_jump(const Row& row) const {
    return add_jump * row.jump + (stick * row.stick_stress - answer * row.stress) / row.impedance;
  }
};

constexpr Stick kStick[] = {
    {.text = "stick_stress has the wrong sign", .stick = -1.0},
    {.text = "velocity_jump has the wrong sign: it is V_soft - V_hard", .stick = -1.0, .answer = -1.0},
    {.text = "stick_stress lacks the part of the old jump, impedance times velocity_jump", .add_jump = 1.0},
    {.text =
         "the answered stress is applied with the wrong sign: it pulls the soft body back where the jump is positive",
     .answer = -1.0},
    {.text = "the answered stress is not applied, or the jump sent is that without friction", .answer = 0.0},
    {.text = "impedance must be twice that sent, or the answered stress is applied to one side only", .answer = 0.5},
    {.text = "impedance must be half of that sent", .answer = 2.0},
    {.text = "impedance alone must be twice that sent: stick_stress is right", .stick = 0.5, .answer = 0.5},
    {.text = "impedance alone must be half of that sent: stick_stress is right", .stick = 2.0, .answer = 2.0},
    {.text = "velocity_jump is that of the predictor of a Newmark scheme: send that of the whole step before",
     .stick = 2.0,
     .answer = 2.0,
     .add_jump = -1.0},
};

template <typename NewJump>
bool explains(std::span<const Row> rows, const NewJump& new_jump) {
  return std::ranges::all_of(rows, [&](const Row& row) { return std::abs(row.now - new_jump(row)) <= tolerance(row); });
}

// A unit that hosts use, by the factor that it leaves in a change of the jump.
constexpr struct {
  double factor;
  const char* text;
} kUnits[] = {
    {1e-3, "velocity_jump must be in m/s: it looks like km/s or mm/us"},
    {1e3, "velocity_jump must be in m/s: it looks like mm/s"},
    {1e2, "velocity_jump must be in m/s: it looks like cm/s"},
    {1e-4, "velocity_jump must be in m/s: it looks like cm/us"},
    {1e-6, "dt_s must be in s: it looks like us"},
    {1e-9, "dt_s must be in s: it looks like ns"},
    {0.1, "both masses must be in kg/m2, or the impedance in Pa s/m: it looks like that of g/cm2"},
};

// The unit that explains all rows: `term(row)` is the part of the new jump that the unit scales, `rest(row)` all else. A
// unit may leave less of a change than tolerance() accepts: the change is then known to a hundredth of itself.
template <typename Rest, typename Term>
const char* unit_of(std::span<const Row> rows, const Rest& rest, const Term& term) {
  for (const auto& [factor, text] : kUnits) {
    const auto accepted = [&, f = factor](const Row& row) {
      return std::min(tolerance(row), 0.01 * std::abs(f * term(row)) + kRounding * std::abs(row.now));
    };
    const auto differs = [&, f = factor](const Row& row) {
      return std::abs((f - 1.0) * term(row)) > tolerance(row) &&
             std::abs(f * term(row)) > 10.0 * kRounding * std::abs(row.now);
    };
    const auto fits = [&, f = factor](const Row& row) {
      return std::abs(row.now - rest(row) - f * term(row)) <= accepted(row);
    };
    if (std::ranges::any_of(rows, differs) && std::ranges::all_of(rows, fits)) return text;
  }
  return nullptr;
}

// True if two step lengths differ by more than rounding errors.
bool differ(double a, double b) {
  return std::abs(a - b) > 1e-9 * std::abs(b);
}

}  // namespace

double tolerance(const Row& row) {
  return kRelative * std::abs(row.now) + kAbsolute;
}

bool in_another_order(std::span<const Row> rows) {
  std::vector<double> answered, now;
  for (const Row& row : rows) {
    answered.push_back(row.answered);
    now.push_back(row.now);
  }
  std::ranges::sort(answered);
  std::ranges::sort(now);
  return std::ranges::equal(answered, now, [](double a, double b) { return std::abs(b - a) <= tolerance({.now = b}); });
}

std::vector<std::string> far_field_mistakes(std::span<const Row> rows, const Times& times) {
  std::vector<std::string> found;
  for (const FarField& mistake : kFarField)
    if (explains(rows, [&](const Row& row) { return mistake.new_jump(row, times.last); }))
      found.emplace_back(mistake.text);
  for (const TimeLevel& mistake : kTimeLevels)
    if (explains(rows, [&](const Row& row) { return mistake.new_jump(row, times.last); }))
      found.emplace_back(mistake.text);
  const struct {
    double dt;
    const char* text;
  } others[] = {
      {times.now, "the velocities advance by the dt_s of this step, not by that of the last one"},
      {times.before > 0.0 ? 0.0 : times.now, kFirstKick},
      {times.before, "the velocities advance by the dt_s of the step before the last one"},
      {0.5 * (times.last + times.now),
       "dt_s is the step of the positions before; the velocities advance by the mean of the steps before and after"},
      {times.before > 0.0 ? 0.5 * (times.before + times.last) : 0.0,
       "dt_s is the step of the positions after; the velocities advance by the mean of the steps before and after"},
  };
  for (const auto& [dt, text] : others) {
    if (!(dt > 0.0) || !differ(dt, times.last)) continue;
    const FarField right{.text = text};
    if (explains(rows, [&, length = dt](const Row& row) { return right.new_jump(row, length); }))
      found.emplace_back(text);
  }
  const auto jump = [](const Row& row) { return row.jump; };
  const auto change = [](const Row& row) { return row.answered - row.jump; };
  if (const char* unit = found.empty() ? unit_of(rows, jump, change) : nullptr) found.emplace_back(unit);
  return found;
}

std::vector<std::string> stick_mistakes(std::span<const Row> rows) {
  std::vector<std::string> found;
  for (const Stick& mistake : kStick)
    if (explains(rows, [&](const Row& row) { return mistake.new_jump(row); })) found.emplace_back(mistake.text);
  if (explains(rows, [](const Row& row) { return row.answered_before; })) found.emplace_back(kEarlierStep);
  if (explains(rows, [](const Row& row) { return row.coming; })) found.emplace_back(kForcesApplied);
  const auto free = [](const Row& row) { return row.stick_stress / row.impedance; };
  const auto friction = [](const Row& row) { return -row.stress / row.impedance; };
  if (const char* unit = found.empty() ? unit_of(rows, free, friction) : nullptr) found.emplace_back(unit);
  return found;
}

}  // namespace shearbus::closure
