#include "hydro_stub/lagrange/cycle.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <optional>
#include <stdexcept>
#include <utility>

namespace shearbus::lagrange {

Cycle::Cycle(Bodies bodies, hydro::InterfaceLaw* law)
    : bodies_(std::move(bodies)),
      state_(bodies_.mesh.num_nodes(), bodies_.mesh.num_zones()),
      guides_(bodies_.mesh.num_nodes(), bodies_.walls),
      contact_(bodies_.mesh.symmetry(), bodies_.slide_lines, bodies_.contact, bodies_.mesh.num_nodes()),
      law_(law) {
  const Mesh& mesh = bodies_.mesh;
  if (bodies_.materials.size() != mesh.blocks().size()) {
    throw std::invalid_argument(
        fmt::format("{} materials for {} blocks; give one for each", bodies_.materials.size(), mesh.blocks().size()));
  }
  find_rim();
  state_.position = mesh.places();
  state_.velocity = bodies_.velocity;
  state_.energy = bodies_.energy;
  std::vector<double> corner_mass = corner_volumes(mesh, state_.position);
  measure_volumes(mesh, state_.position, state_.volume);
  for (int zone = 0; zone < mesh.num_zones(); ++zone) {
    const double density = bodies_.density[zone];
    if (!(density > 0.0)) throw std::invalid_argument(fmt::format("zone {} has density {} kg/m3", zone, density));
    state_.mass[zone] = density * state_.volume[zone];
    for (int k = 0; k < 4; ++k) corner_mass[4 * zone + k] *= density;
  }
  mesh.gather(corner_mass, state_.node_mass);
  update_state();
  measure(mesh, state_.position, middle_);
  middle_position_ = state_.position;
  middle_density_ = state_.density;
  middle_pressure_ = state_.pressure;
  find_gradients(mesh, middle_, state_.velocity, gradient_);
  for (std::size_t body = 0; body < bodies_.materials.size(); ++body) {
    const Block& block = mesh.blocks()[body];
    if (bodies_.materials[body].strength) std::fill_n(plastic_rate_.begin() + block.first_zone, block.num_zones(), 0.0);
  }
  find_forces();  // computes the viscous rates, which limit the first step
}

void Cycle::run_to(double end_time) {
  while (state_.time < end_time) advance(end_time);
}

void Cycle::advance(double end_time) {
  choose_step(end_time);
  constexpr int kMostTries = 8;
  for (int tries = 0; !try_step(dt_); ++tries) {
    ++rejected_;
    if (tries == kMostTries) {
      throw std::runtime_error(fmt::format("step {} at t = {:.6g} s: zone {} turns inside out even with dt = {:.3g} s",
                                           steps_ + 1, state_.time, inverted_, dt_));
    }
    dt_ *= 0.25;
    unshortened_ = dt_;
  }
  // The last step of a run ends exactly at the end time.
  state_.time = dt_ == end_time - state_.time ? end_time : state_.time + dt_;
  ++steps_;
}

// The scheme of one step. Returns false, with the state unchanged, if the step is too long.
bool Cycle::try_step(double dt) {
  // 1. moves the nodes for half a step with the old velocities; finds the volumes of the zones at mid-step, and the
  //    weights of their corners in gradients and forces
  // 2. predicts the state at mid-step: density, energy (by the work of the old stresses), deviators, pressure
  if (!predict_middle(dt)) return false;
  // 3. computes the corner forces of stress, viscosity and hourglass control, and meanwhile the weights of the contact
  find_forces();
  // 4. sums them on the nodes and advances the velocities by the momentum balance, with the forces of the pressure
  //    loads, constrained by the walls
  accelerate(dt);
  // 5. adds the impulses of contact and friction on the slide lines, and meanwhile advances the deviators of the zones
  //    away from the slide lines
  slide(dt);
  // 6. moves the nodes to the end of the step with the mean velocities
  // 7. adds to the energy of each zone the work of its forces with the mean velocities
  if (!go_to_end(dt)) {
    if (law_ != nullptr) law_->take_back();
    return false;
  }
  state_.energy.swap(energy_new_);
  state_.volume.swap(volume_new_);
  // 8. adds the heat of the slide lines to their zones and the work of walls and loads to the ledger, and meanwhile
  //    advances the deviators of the zones on slide lines; updates density, pressure, sound speed and temperature
  finish_step(dt);
  state_.deviator_xx.swap(xx_new_);
  state_.deviator_yy.swap(yy_new_);
  state_.deviator_xy.swap(xy_new_);
  state_.plastic_strain.swap(plastic_strain_new_);
  state_.position.swap(position_new_);
  state_.velocity.swap(velocity_new_);
  heating_.swap(heating_new_);
  return true;
}

void Cycle::choose_step(double end_time) {
  dt_ = unshortened_ = next_time_step(bodies_.mesh, bodies_.time_step, middle_, state_.position, state_.sound_speed,
                                      viscous_rate_, dilatation_, unshortened_);
  if (!std::isfinite(dt_) || !(dt_ > 0.0))
    throw std::runtime_error(fmt::format("step {}: no time step follows from the state (dt = {})", steps_ + 1, dt_));
  // The end time is reached in one step or in two equal steps, never in a much shorter last step: in a very short step
  // slide lines would close their gaps at an unphysical speed.
  const double left = end_time - state_.time;
  if (2.0 * dt_ > left) dt_ = dt_ >= left ? left : 0.5 * left;
}

// The impulse of the walls on a node is the change of its momentum that zones, slide lines and loads do not explain.
void Cycle::book_boundaries(double dt) {
  for (const Wall& wall : bodies_.walls) {
    for (const int n : wall.nodes) {
      beyond_[n] =
          state_.node_mass[n] * (velocity_new_[n] - state_.velocity[n]) - dt * node_force_[n] - contact_.impulse()[n];
    }
  }
  for (std::size_t l = 0; l < bodies_.loads.size(); ++l) {
    const std::vector<int>& loaded = bodies_.loads[l].nodes;
    for (std::size_t i = 0; i < loaded.size(); ++i) {
      const Vec2 impulse = dt * load_force_[l][i];
      impulse_given_ += impulse;
      work_given_ += dot(impulse, velocity_mean_[loaded[i]]);
      beyond_[loaded[i]] -= impulse;
    }
  }
  for (const Wall& wall : bodies_.walls) {
    for (const int n : wall.nodes) {
      const Vec2 impulse = dot(beyond_[n], wall.normal) * wall.normal;
      impulse_given_ += impulse;
      work_given_ += dot(impulse, velocity_mean_[n]);
    }
  }
}

// Divides the runs of the mesh into runs of zones with and without a node on a slide line.
void Cycle::find_rim() {
  std::vector<bool> on_line(bodies_.mesh.num_nodes(), false);
  for (const SlideLine& line : bodies_.slide_lines) {
    for (const int n : line.soft.nodes) on_line[n] = true;
    for (const int n : line.hard.nodes) on_line[n] = true;
  }
  for (const Run& run : bodies_.mesh.runs()) {
    std::optional<Reach> before;
    for (int z = run.first; z < run.first + run.count; ++z) {
      const int* n = bodies_.mesh.zone_nodes(z);
      const Reach reach = std::any_of(n, n + 4, [&](int node) { return on_line[node]; }) ? kRim : kInner;
      if (reach != before) runs_[reach].push_back({.first = z, .count = 0, .block = run.block});
      ++runs_[reach].back().count;
      before = reach;
    }
  }
}

Memory Cycle::memory() {
  const auto flat = [](std::vector<Vec2>& v) {
    static_assert(sizeof(Vec2) == 2 * sizeof(double));
    return std::span<double>(&v.data()->x, 2 * v.size());
  };
  const auto one = [](auto& value) { return std::span(&value, 1); };
  const auto pair = [](Vec2& v) { return std::span<double>(&v.x, 2); };
  return {.numbers = {{"time", one(state_.time)},
                      {"step_before", one(unshortened_)},
                      {"impulse_given", pair(impulse_given_)},
                      {"work_given", one(work_given_)},
                      {"contact_heat", contact_.heat()},
                      {"contact_plastic_strain", contact_.plastic_strain()},
                      {"contact_plastic_rate", contact_.soft_plastic_strain_rate()},
                      {"contact_plastic_time", one(contact_.plastic_time())},
                      {"contact_friction_time", contact_.friction_time()},
                      {"position", flat(state_.position)},
                      {"velocity", flat(state_.velocity)},
                      {"volume", state_.volume},
                      {"density", state_.density},
                      {"energy", state_.energy},
                      {"pressure", state_.pressure},
                      {"sound_speed", state_.sound_speed},
                      {"temperature", state_.temperature},
                      {"deviator_xx", state_.deviator_xx},
                      {"deviator_yy", state_.deviator_yy},
                      {"deviator_xy", state_.deviator_xy},
                      {"plastic_strain", state_.plastic_strain},
                      {"heating", heating_},
                      {"middle_area", middle_.area},
                      {"viscous_rate", viscous_rate_},
                      {"dilatation", dilatation_}},
          .counts = {{"steps", one(steps_)}, {"rejected", one(rejected_)}}};
}

Ledger Cycle::ledger() const {
  Ledger sum{.impulse_given = impulse_given_,
             .work_given = work_given_,
             .friction_heat = contact_.friction_heat(),
             .closing_heat = contact_.closing_heat()};
  for (int n = 0; n < bodies_.mesh.num_nodes(); ++n) {
    sum.momentum += state_.node_mass[n] * state_.velocity[n];
    sum.kinetic += 0.5 * state_.node_mass[n] * dot(state_.velocity[n], state_.velocity[n]);
  }
  for (int z = 0; z < bodies_.mesh.num_zones(); ++z) sum.internal += state_.mass[z] * state_.energy[z];
  return sum;
}

}  // namespace shearbus::lagrange
