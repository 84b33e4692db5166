// The abstract interface law of a hydrocode: one call per step for all interface nodes (in one dimension: columns).
//
// Signs: [V] = V_soft - V_hard is the jump of the velocities along the interface. A positive shear stress s = sigma_xz
// lowers [V]: it decelerates the soft body and accelerates the hard one. SI units.
#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "proto/files/energy_totals.hpp"
#include "proto/wire/messages.hpp"

namespace shearbus::hydro {

// Inputs of the interface law that the mesh computes for the step t(n-1/2) -> t(n+1/2); one value per node.
struct InterfaceInputs {
  explicit InterfaceInputs(std::size_t nodes)
      : velocity_jump(nodes),
        pressure(nodes),
        stress_soft(nodes),
        stress_hard(nodes),
        mass_soft(nodes),
        mass_hard(nodes) {}

  std::uint64_t step = 0;
  double time = 0.0;                  // time of the velocities after the step, t(n+1/2)  [s]
  double dt = 0.0;                    // step length  [s]
  std::vector<double> velocity_jump;  // velocity jump [V] at t(n-1/2)  [m/s]
  std::vector<double> pressure;       // pressure at t(n), compression positive  [Pa]
  std::vector<double> stress_soft;    // shear stress at t(n) in the soft zone next to the interface  [Pa]
  std::vector<double> stress_hard;    // shear stress at t(n) in the hard zone next to the interface  [Pa]
  std::vector<double> mass_soft;      // mass of half the soft zone per area  [kg/m2]
  std::vector<double> mass_hard;      // mass of half the hard zone per area  [kg/m2]
  // State of the soft zone at the interface, if the host computes it; empty if the law has to compute it.
  std::vector<double> zone_temperature;  // [K]
  std::vector<double> zone_plastic_strain;
  // rate of plastic shear of the soft zone along the interface, with the sign of the shear stress there  [1/s]
  std::vector<double> soft_plastic_strain_rate;
};

// Answers of the interface law for one step, one value per node.
struct InterfaceAnswer {
  explicit InterfaceAnswer(std::size_t nodes)
      : shear_stress(nodes),
        velocity_jump_new(nodes),
        sliding_velocity(nodes),
        interface_temperature(nodes),
        friction_heat(nodes),
        regime(nodes) {}

  std::vector<double> shear_stress;           // shear stress s that acts during the step  [Pa]
  std::vector<double> velocity_jump_new;      // velocity jump [V] at t(n+1/2) under the stress s, DLP (61)  [m/s]
  std::vector<double> sliding_velocity;       // sliding velocity at the interface, mean of the step  [m/s]
  std::vector<double> interface_temperature;  // temperature of the interface at t(n+1/2)  [K]
  std::vector<double> friction_heat;          // heat that entered the soft body in the step  [J/m2]
  std::vector<std::uint8_t> regime;           // wire::Regime of the node: open, stick, Coulomb, Tresca or melting
  files::EnergyTotals energy;                 // energies of the shear layers in the step; empty for laws without layers
  std::uint64_t flagged = 0;  // number of nodes whose answer has a flag (substepped, several roots, failed)
};

// Run time that a law has used so far. The times overlap: a law that computes in the host's own thread may report the
// same time as `solver`, `service`, `waited` and `cpu`.
struct LawTime {
  std::chrono::nanoseconds solver{0};
  // time in the server, from the arrival of each request to the end of its step; includes the solver
  std::chrono::nanoseconds service{0};
  std::chrono::nanoseconds bus{0};     // time of the round trips to the server, less the time in the server's solver
  std::chrono::nanoseconds waited{0};  // time in which the host waited for answers and did no other work
  std::chrono::nanoseconds cpu{0};     // CPU time of the host's thread spent on requests
};

// Optional physics that the scene left switched off in this run, and the memory per node without and with all of it.
// Empty for laws without options.
struct OmittedCost {
  std::vector<std::pair<std::string, std::string>> lines;  // lines that the summary prints, each with label and text
  std::vector<std::string> parts;
  std::uint64_t bytes_per_node = 0;                  // memory per node with the options of this run
  std::uint64_t bytes_per_node_with_everything = 0;  // bytes per node if all options that the scene allows were on
  std::optional<double> share_asleep;  // share of the node-steps spent asleep; absent if no node could sleep
};

class InterfaceLaw {
 public:
  virtual ~InterfaceLaw() = default;
  InterfaceLaw() = default;
  InterfaceLaw(const InterfaceLaw&) = delete;
  InterfaceLaw& operator=(const InterfaceLaw&) = delete;

  virtual void advance(const InterfaceInputs& inputs, InterfaceAnswer& answer) = 0;
  // start() and finish() are the two halves of advance(), for a host that does other work in between. The answer is
  // complete after finish(); until then `inputs` and `answer` must stay at their addresses.
  virtual void start(const InterfaceInputs& inputs, InterfaceAnswer& answer) { advance(inputs, answer); }
  virtual void finish() {}
  // Undoes the last advance(), because the host rejects the step and will repeat it with a shorter one. May be called
  // at most once per advance().
  virtual void take_back() {}
  // Reads the profiles of some nodes across their layers, as the last advance() left them; that step can then not be
  // taken back. The rows are those of wire::Profiles. Throws wire::Error; laws without layers refuse the call.
  virtual wire::Batch profiles(std::span<const std::uint64_t> node_ids, std::span<const double> pressure_pa);
  virtual LawTime time_spent() const { return {}; }

  // Saves the state of the law under `name` and returns a text from which another process restores the state
  // (make_law). The state is kept until two later states have been saved. A law without a state returns an empty text.
  virtual std::string keep(const std::string& /*name*/) { return {}; }
  // Returns an empty text if keep() can be called, otherwise the reason why not and a remedy.
  virtual std::string cannot_keep() const { return {}; }
  // Ends the run: saved states may be deleted.
  virtual void close() {}
  // Returns the optional physics that the scene left switched off, and the memory per node without and with all of
  // it. The share of node-steps that were asleep is known only after close().
  virtual OmittedCost omitted_cost() const { return {}; }
};

// The momentum balance DLP (61) solved for the velocity jump at n+1/2: [V] = jump - s * compliance.
struct FreeJump {
  double jump;        // velocity jump [V] at t(n+1/2) without friction  [m/s]
  double compliance;  // fall of the jump per shear stress, dt (1/m_soft + 1/m_hard)  [m/(s Pa)]
};
inline FreeJump free_jump(const InterfaceInputs& in, std::size_t i) {
  return {in.velocity_jump[i] + in.dt * (in.stress_soft[i] / in.mass_soft[i] + in.stress_hard[i] / in.mass_hard[i]),
          in.dt * (1.0 / in.mass_soft[i] + 1.0 / in.mass_hard[i])};
}

}  // namespace shearbus::hydro
