// Names the mistake of a force-driven host whose velocity jump is not the one that its last step answered. These are
// pure functions of what the host sent and received in that step and of its jump now, so that every client library can
// use them.
#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <vector>

namespace shearbus::closure {

// One tangential component of one node. With the old jump [V] and the answered stress s, the momentum balance of the
// host, DLP (61), gives in far-field form the next jump
//   [V] + dt (stress_soft/mass_soft + stress_hard/mass_hard) - dt s (1/mass_soft + 1/mass_hard),
// in stick form (stick_stress - s) / impedance.
struct Row {
  double jump = 0.0;      // jump [V] that the last step was sent with  [m/s]
  double stress = 0.0;    // stress s that the last step answered       [Pa]
  double answered = 0.0;  // new jump that the last step answered       [m/s]
  double now = 0.0;       // jump that the host sends with this step    [m/s]
  // Inputs of the last step, if it was in far-field form:
  double stress_soft = 0.0, stress_hard = 0.0;  // [Pa]
  double mass_soft = 1.0, mass_hard = 1.0;      // [kg/m2]
  // Inputs of the last step, if it was in stick form:
  double stick_stress = 0.0;  // [Pa]
  double impedance = 1.0;     // [Pa s/m]

  double difference() const { return now - answered; }
};

// Lengths of three steps in a row  [s]; 0: not known.
struct Times {
  double before = 0.0;  // length of the step before the last
  double last = 0.0;
  double now = 0.0;
};

// The largest accepted difference between the host's jump and the answered one  [m/s].
double tolerance(const Row& row);

// The mistakes, each of which alone explains all rows; empty if there is none. Mistakes that have the same effect on
// the balance are one text.
std::vector<std::string> far_field_mistakes(std::span<const Row> rows, const Times& times);
std::vector<std::string> stick_mistakes(std::span<const Row> rows);

}  // namespace shearbus::closure
