// A force-driven host must arrive at the velocity jump that the server answered to its last step. If it does not, these
// functions name its mistake. They depend only on what the host sent and received in the last step and on its jump now,
// so that every client library can use them.
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
  double jump = 0.0;      // velocity jump [V] that the host sent with the last step  [m/s]
  double stress = 0.0;    // shear stress s that the server answered to the last step  [Pa]
  double answered = 0.0;  // new jump that the server answered to the last step  [m/s]
  double now = 0.0;       // jump that the host sends with this step  [m/s]
  // Inputs of the last step, if it was in far-field form:
  double stress_soft = 0.0, stress_hard = 0.0;  // [Pa]
  double mass_soft = 1.0, mass_hard = 1.0;      // [kg/m2]
  // Inputs of the last step, if it was in stick form:
  double stick_stress = 0.0;  // [Pa]
  double impedance = 1.0;     // [Pa s/m]
  // Of the step before the last one, to recognise a jump of another time level; NaN: not known. The first step of a
  // session follows a rest: no change, no friction, and the jump that it begins with.
  double change_before = 0.0;    // new jump that was answered less the jump that was sent  [m/s]
  double friction_before = 0.0;  // what the answered stress took from the jump, in far-field form  [m/s]
  double answered_before = 0.0;  // new jump that was answered  [m/s]
  // Of this step, NaN if it has another form: what the host's own stresses add to the jump in far-field form, or the jump
  // without friction in stick form  [m/s].
  double coming = 0.0;

  double difference() const { return now - answered; }
};

// Lengths of three consecutive steps; 0: not known  [s].
struct Times {
  double before = 0.0;  // length of the step before the last
  double last = 0.0;
  double now = 0.0;
};

// The mistake of the first step alone: the steps after it close.
inline constexpr const char* kFirstKick =
    "the first step moved the velocities by the dt_s of this one: if your first kick is a whole step, send its length";

// The largest accepted difference between the jump that the host sends and the one answered to the last step  [m/s].
double tolerance(const Row& row);

// True if the jumps that the host brings are those that were answered, in another order.
bool in_another_order(std::span<const Row> rows);

// Return a text for each mistake of the host that by itself explains the jumps of all rows. Mistakes that change the
// momentum balance in the same way share a text.
std::vector<std::string> far_field_mistakes(std::span<const Row> rows, const Times& times);
std::vector<std::string> stick_mistakes(std::span<const Row> rows);

}  // namespace shearbus::closure
