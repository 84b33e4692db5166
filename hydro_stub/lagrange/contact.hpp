// Contact and friction of bodies on slide lines: impulses on the nodes of both surfaces.
//
//   1. normal: pressures p_i >= 0 such that no closed gap goes on closing and no pressure acts across an opening gap
//      (a linear complementarity problem)
//   2. tangential: far-field stresses, masses and the jump of DLP (58)-(61) at every interface node; the interface law
//      answers a shear stress
//   3. normal again, with the shear impulses known
//
// All impulses are equal and opposite between the bodies, to rounding. The energy that the impulses of a node take from
// the motion heats the adjoining zones: friction heats the two bodies in proportion to their effusivities (DLP 19), and
// the kinetic energy lost when a gap closes is divided equally between them.
#pragma once

#include <array>
#include <optional>
#include <span>
#include <vector>

#include "hydro_stub/interface_law.hpp"
#include "hydro_stub/lagrange/boundary.hpp"
#include "hydro_stub/lagrange/complementarity.hpp"
#include "hydro_stub/lagrange/heat_depth.hpp"
#include "hydro_stub/lagrange/slide_line.hpp"
#include "hydro_stub/lagrange/state.hpp"

namespace shearbus::lagrange {

struct ContactOptions {
  // The thread that asks the interface law advances zones off the slide lines until it answers. Other threads do so
  // in either case. Changes no result.
  bool overlap = true;
  double soft_share = 0.5;                   // share of the friction heat that enters the soft body
  std::optional<HeatDepth> heat_depth = {};  // how deep friction heat goes; absent: into the zones at the wall
};

class Contact {
 public:
  Contact(Symmetry symmetry, std::vector<SlideLine> lines, const ContactOptions& options, int num_nodes);

  // Finds what depends on the places of the nodes at mid-step and on no force: weights and the matrix of the pressures.
  void prepare(const State& state, const std::vector<Vec2>& middle_position, const Guides& guides);
  // Adds the impulses of the step to `velocity_new`, which on entry holds the velocities after all other forces; only
  // nodes on slide lines change. The work is split in two so that other work can be done while the interface law runs:
  // of the steps at the top of this file, ask() does step 1 and sends the law the inputs of step 2, and answered() does
  // the rest. If `law` is null, the surfaces slip freely.
  void ask(const State& state, const Guides& guides, double dt, std::uint64_t step, hydro::InterfaceLaw* law,
           std::vector<Vec2>& velocity_new);
  void answered(const State& state, const Guides& guides, double dt, hydro::InterfaceLaw* law,
                std::vector<Vec2>& velocity_new);

  // Adds the heat of friction and of closing gaps in an accepted step to the zones' energies and to the totals.
  void deposit_heat(const std::vector<Vec2>& velocity_mean, double dt, const std::vector<double>& mass,
                    std::vector<double>& energy);

  // number of interface nodes on slide lines with friction, for which the law is asked; weights() has these nodes first
  int size() const { return weights_.rubbing(); }
  const InterfaceWeights& weights() const { return weights_; }
  const std::vector<Vec2>& impulse() const { return impulse_; }     // impulse of the step, per mesh node  [kg m/s]
  const hydro::InterfaceInputs& inputs() const { return inputs_; }  // inputs of the law in the last step
  const hydro::InterfaceAnswer& answer() const { return answer_; }
  double friction_heat() const { return heat_[kFriction]; }  // friction heat since the start  [J]
  double closing_heat() const { return heat_[kClosing]; }

  // The contact's state that is carried from one step to the next, for restart dumps (Cycle::memory).
  std::span<double> heat() { return heat_; }
  std::span<double> plastic_strain() { return inputs_.zone_plastic_strain; }
  std::span<double> soft_plastic_strain_rate() { return inputs_.soft_plastic_strain_rate; }
  double& plastic_time() { return plastic_time_; }
  std::span<double> friction_time() { return friction_time_; }

 private:
  void find_compliance(const Guides& guides, const State& state);
  void press(const Guides& guides, const State& state, double dt, std::vector<Vec2>& velocity);
  void ask_law(const State& state, double dt, std::uint64_t step, hydro::InterfaceLaw* law,
               const std::vector<Vec2>& velocity);
  void find_plastic_rates(const State& state);
  void rub(const Guides& guides, const State& state, double dt, std::vector<Vec2>& velocity);
  double wall_temperature(const State& state, int zone, int i) const;
  void find_mean_pressures(double dt);
  double pressure_at(int i) const;
  double opening_rate(int i, const std::vector<Vec2>& velocity) const;
  double jump(int i, const std::vector<Vec2>& velocity) const;
  void give(int node, Vec2 impulse, const Guides& guides, const State& state, std::vector<Vec2>& velocity);

  InterfaceWeights weights_;
  ContactOptions options_;
  hydro::InterfaceInputs inputs_;
  hydro::InterfaceAnswer answer_;
  std::vector<double> pressing_;  // pressure impulse p_i dt of each interface node in the step  [Pa s]
  std::vector<Vec2> impulse_;
  // Work arrays of a step. compliance_[i] is a row of the matrix that turns pressure impulses into the rates at which
  // gaps open; its first entry is that of node i itself  [m3/(s Pa s)].
  std::vector<double> before_, excess_rate_;
  std::vector<std::vector<RowWeight>> compliance_;
  Complementarity pressures_;
  struct Response {
    int row;
    Vec2 velocity;  // velocity of a mesh node per pressure impulse of the interface node `row`  [m/(s Pa s)]
  };
  std::vector<std::vector<Response>> pushed_;  // of each mesh node
  std::vector<double> hard_area_;
  std::vector<double> mean_pressure_;  // mean of the pressure over the area A_i of each node with friction  [Pa]
  std::vector<double> friction_time_;  // time since friction began at each interface node with friction  [s]
  double plastic_time_ = 0.0;          // time to which zone_plastic_strain in inputs_ belongs  [s]
  enum Cause : std::size_t { kFriction, kClosing };
  std::array<double, 2> heat_{};
};

}  // namespace shearbus::lagrange
