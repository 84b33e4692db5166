// Names the mistake of a force-driven host whose jump is not the jump that its last step answered: a pure function of
// what the host sent and received in that step and of what it brings now, so that every client library can use it.
#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <vector>

namespace shearbus::closure {

// One tangential component of one node. In far-field form the momentum balance of the host, DLP (61), is
//   [V]now = [V] + dt (s_soft/m_soft + s_hard/m_hard) - dt s (1/m_soft + 1/m_hard),
// in stick form [V]now = (stick stress - s) / Z.
struct Row {
  double jump = 0.0;      // [V] of the last step                         [m/s]
  double stress = 0.0;    // s that the last step answered                [Pa]
  double answered = 0.0;  // new jump that the last step answered         [m/s]
  double now = 0.0;       // jump that the host brings with this step     [m/s]
  // Of the last step, in far-field form:
  double stress_soft = 0.0, stress_hard = 0.0;  // [Pa]
  double mass_soft = 1.0, mass_hard = 1.0;      // [kg/m2]
  // and in stick form:
  double stick_stress = 0.0;  // [Pa]
  double impedance = 1.0;     // [Pa s/m]

  double difference() const { return now - answered; }
};

// Lengths of the steps  [s]; 0: not known.
struct Times {
  double before = 0.0;  // of the step before the last
  double last = 0.0;
  double now = 0.0;
};

// The largest accepted difference of the jumps  [m/s].
double tolerance(const Row& row);

// The mistakes, each of which alone explains all rows; empty if there is none. Mistakes that have the same effect on
// the balance are one text.
std::vector<std::string> far_field_mistakes(std::span<const Row> rows, const Times& times);
std::vector<std::string> stick_mistakes(std::span<const Row> rows);

}  // namespace shearbus::closure
