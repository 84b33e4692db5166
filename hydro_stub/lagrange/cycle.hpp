// A staggered Lagrangian hydrocode in two dimensions: velocities on nodes, everything else in zones, one predictor and
// one evaluation of forces a step, as in PENNANT and the compatible scheme of Caramana, Burton, Shashkov & Whalen (J.
// Comput. Phys. 146 (1998) 227). The work of every force on the nodes is taken from the energy of the zone that exerts
// the force, so that the total energy changes only by the work of the boundaries, to rounding.
#pragma once

#include <array>
#include <cstdint>
#include <limits>
#include <optional>
#include <span>
#include <utility>
#include <vector>

#include "hydro_stub/interface_law.hpp"
#include "hydro_stub/lagrange/boundary.hpp"
#include "hydro_stub/lagrange/contact.hpp"
#include "hydro_stub/lagrange/eos.hpp"
#include "hydro_stub/lagrange/geometry.hpp"
#include "hydro_stub/lagrange/mesh.hpp"
#include "hydro_stub/lagrange/shares.hpp"
#include "hydro_stub/lagrange/state.hpp"
#include "hydro_stub/lagrange/strength.hpp"
#include "hydro_stub/lagrange/time_step.hpp"
#include "hydro_stub/lagrange/viscosity.hpp"
#include "server/physics/material/material.hpp"

namespace shearbus::lagrange {

struct BodyMaterial {
  Eos eos;
  std::optional<physics::Material> strength;  // absent: the body is a fluid
};

struct Bodies {
  explicit Bodies(Mesh blocks)
      : mesh(std::move(blocks)), velocity(mesh.num_nodes()), density(mesh.num_zones()), energy(mesh.num_zones()) {}

  Mesh mesh;
  std::vector<BodyMaterial> materials;  // material of each block
  std::vector<Vec2> velocity;           // velocity of each node  [m/s]
  std::vector<double> density;          // density of each zone  [kg/m3]
  std::vector<double> energy;           // specific internal energy of each zone  [J/kg]
  std::vector<Wall> walls;
  std::vector<PressureLoad> loads;
  std::vector<SlideLine> slide_lines;
  ContactOptions contact;
  TimeStepOptions time_step;
};

// Sums over all bodies. Impulse and work of the boundaries are totals since the start.
struct Ledger {
  Vec2 momentum;               // momentum  [kg m/s]; in axisymmetry only the axial component has a meaning
  double kinetic = 0.0;        // kinetic energy  [J]
  double internal = 0.0;       // internal energy  [J]
  Vec2 impulse_given;          // impulse of walls and loads  [kg m/s]
  double work_given = 0.0;     // work of walls and loads  [J]
  double friction_heat = 0.0;  // part of the internal energy that came from friction on slide lines  [J]
  double closing_heat = 0.0;   // part of the internal energy that came from closing gaps of slide lines  [J]
  double total_energy() const { return kinetic + internal; }
};

// All state of a cycle that its bodies do not contain, by name. If these values are copied into a new cycle of the same
// bodies, the new cycle continues with bitwise the same results.
struct Memory {
  std::vector<std::pair<const char*, std::span<double>>> numbers;
  std::vector<std::pair<const char*, std::span<std::uint64_t>>> counts;
};

class Cycle {
 public:
  // The interface law `law` acts on the slide lines with friction and must outlive the cycle. If it is null, these
  // lines slip freely, too. Throws std::invalid_argument for inconsistent bodies.
  explicit Cycle(Bodies bodies, hydro::InterfaceLaw* law = nullptr);

  // Advances by one step, at most to `end_time`. A step that is too long (it inverts a zone, or changes the volume of a
  // zone by more than twice the limit volume_change) is rejected and repeated with a quarter of its length. Throws
  // std::runtime_error that names the zone if shorter and shorter steps do not help.
  void advance(double end_time);
  void run_to(double end_time);

  const Mesh& mesh() const { return bodies_.mesh; }
  const State& state() const { return state_; }
  std::uint64_t steps() const { return steps_; }
  std::uint64_t rejected_steps() const { return rejected_; }
  const Contact& contact() const { return contact_; }
  Ledger ledger() const;
  Memory memory();

 private:
  bool try_step(double dt);
  // The loops over zones and nodes (cycle_loops.cpp).
  bool predict_middle(double dt);
  void predict_run(const Run& run, double dt);
  void find_forces();
  void accelerate(double dt);
  bool go_to_end(double dt);
  enum Reach : std::size_t { kInner, kRim };  // kInner: zones with no node on a slide line; kRim: all others
  void slide(double dt);
  void finish_step(double dt);
  void advance_stress(double dt, const Run& run);
  void update_state();
  void update_run(const Run& run);
  const BodyMaterial& material(const Run& run) const { return bodies_.materials[run.block]; }

  std::vector<double> of_zones(double value = 0.0) const {
    return std::vector<double>(bodies_.mesh.num_zones(), value);
  }
  std::vector<Vec2> of_nodes() const { return std::vector<Vec2>(bodies_.mesh.num_nodes()); }

  void find_rim();
  void book_boundaries(double dt);
  void choose_step(double end_time);

  Bodies bodies_;
  State state_;
  Guides guides_;
  Contact contact_;
  hydro::InterfaceLaw* law_;
  double dt_ = 0.0;           // [s]
  double unshortened_ = 0.0;  // last step before it was shortened to meet an end time; the next step may grow from it
  int inverted_ = -1;         // first zone for which the last rejected step was too long
  std::uint64_t steps_ = 0;
  std::uint64_t rejected_ = 0;
  Vec2 impulse_given_;
  double work_given_ = 0.0;

  // Work arrays of the current step.
  Shares shares_;
  Geometry middle_ = Geometry(bodies_.mesh.num_zones());  // geometry of the zones at mid-step
  std::vector<Vec2> middle_position_ = of_nodes();
  std::vector<double> middle_density_ = of_zones(), middle_energy_ = of_zones(), middle_pressure_ = of_zones();
  std::vector<double> middle_xx_ = of_zones(), middle_yy_ = of_zones(), middle_xy_ = of_zones();  // deviators  [Pa]
  // rate of the equivalent plastic strain up to mid-step; infinite in fluids  [1/s]
  std::vector<double> plastic_rate_ = of_zones(std::numeric_limits<double>::infinity());
  std::vector<double> sound_squared_ = of_zones();
  CornerVectors corner_force_ = CornerVectors(bodies_.mesh.num_zones());
  std::vector<Vec2> node_force_ = of_nodes();  // force of the zones on each node, the sum of its corners' forces
  // forces of each pressure load on its nodes
  std::vector<std::vector<Vec2>> load_force_ = std::vector<std::vector<Vec2>>(bodies_.loads.size());
  std::vector<Vec2> position_new_ = of_nodes(), velocity_new_ = of_nodes();
  // mean of the velocities at the start and end of the step; it moves the nodes, and the work of forces uses it
  std::vector<Vec2> velocity_mean_ = of_nodes();
  std::vector<double> volume_new_ = of_zones(), energy_new_ = of_zones();
  // velocity gradient of each zone, from the geometry at mid-step and the velocities at the start of the step, later
  // the mean velocities of the step  [1/s]
  Gradients gradient_ = Gradients(bodies_.mesh.num_zones());
  std::vector<double> viscous_rate_ = of_zones();
  std::vector<double> heating_ = of_zones();  // power of viscosity and hourglass forces in the last step  [W]
  std::vector<double> heating_new_ = of_zones();
  std::vector<double> dilatation_ = of_zones();  // relative rate of volume change, dV/dt / V, in the last step  [1/s]
  std::vector<double> xx_new_ = of_zones(), yy_new_ = of_zones(), xy_new_ = of_zones();
  std::vector<double> plastic_strain_new_ = of_zones();
  std::array<std::vector<Run>, 2> runs_;   // by Reach
  std::vector<Vec2> beyond_ = of_nodes();  // impulse of the walls on their nodes  [kg m/s]
};

}  // namespace shearbus::lagrange
