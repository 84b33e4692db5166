#include "hydro_stub/lagrange/cycle.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <utility>

#include "hydro_stub/lagrange/hourglass.hpp"

namespace shearbus::lagrange {

Cycle::Cycle(Bodies bodies, hydro::InterfaceLaw* law)
    : bodies_(std::move(bodies)),
      state_(bodies_.mesh.num_nodes(), bodies_.mesh.num_zones()),
      guides_(bodies_.mesh.num_nodes(), bodies_.walls),
      contact_(bodies_.mesh.symmetry(), bodies_.slide_lines, bodies_.contact, bodies_.mesh.num_nodes()),
      law_(law),
      middle_(bodies_.mesh.num_zones()),
      middle_position_(bodies_.mesh.num_nodes()),
      middle_density_(bodies_.mesh.num_zones()),
      middle_energy_(bodies_.mesh.num_zones()),
      middle_pressure_(bodies_.mesh.num_zones()),
      middle_xx_(bodies_.mesh.num_zones()),
      middle_yy_(bodies_.mesh.num_zones()),
      middle_xy_(bodies_.mesh.num_zones()),
      plastic_rate_(bodies_.mesh.num_zones(), std::numeric_limits<double>::infinity()),
      sound_squared_(bodies_.mesh.num_zones()),
      corner_force_(4 * static_cast<std::size_t>(bodies_.mesh.num_zones())),
      node_force_(bodies_.mesh.num_nodes()),
      load_force_(bodies_.loads.size()),
      position_new_(bodies_.mesh.num_nodes()),
      velocity_new_(bodies_.mesh.num_nodes()),
      velocity_mean_(bodies_.mesh.num_nodes()),
      volume_new_(bodies_.mesh.num_zones()),
      gradient_(bodies_.mesh.num_zones()),
      viscous_rate_(bodies_.mesh.num_zones(), 0.0),
      heating_(bodies_.mesh.num_zones(), 0.0),
      heating_new_(bodies_.mesh.num_zones(), 0.0),
      dilatation_(bodies_.mesh.num_zones(), 0.0),
      xx_new_(bodies_.mesh.num_zones(), 0.0),
      yy_new_(bodies_.mesh.num_zones(), 0.0),
      xy_new_(bodies_.mesh.num_zones(), 0.0),
      plastic_strain_new_(bodies_.mesh.num_zones(), 0.0),
      zones_(bodies_.materials.size()) {
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
  update_state(state_.volume, state_.energy, state_.density, state_.pressure);
  find_sound_speed_and_temperature();
  measure(mesh, state_.position, middle_);
  middle_position_ = state_.position;
  middle_density_ = state_.density;
  middle_pressure_ = state_.pressure;
  find_gradients();
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
  for (int tries = 0; !try_step(step_.dt); ++tries) {
    ++rejected_;
    if (tries == kMostTries) {
      throw std::runtime_error(fmt::format("step {} at t = {:.6g} s: zone {} turns inside out even with dt = {:.3g} s",
                                           steps_ + 1, state_.time, step_.zone, step_.dt));
    }
    step_.dt *= 0.25;
    step_.limit = StepLimit::kRejected;
    unshortened_ = step_;
  }
  // The last step of a run ends exactly at the end time.
  state_.time = step_.dt == end_time - state_.time ? end_time : state_.time + step_.dt;
  ++steps_;
}

// The scheme of one step. Returns false, with the state unchanged, if the step is too long.
bool Cycle::try_step(double dt) {
  // 1. moves the nodes for half a step with the old velocities; finds the volumes of the zones at mid-step, and the
  //    weights of their corners in gradients and forces
  if (!go_to_middle(dt)) return false;
  find_gradients();
  // 2. predicts the state at mid-step: density, energy (by the work of the old stresses), deviators, pressure
  predict_state(dt);
  // 3. computes the corner forces of stress, viscosity and hourglass control, their sums on the nodes, and the
  //    forces of the pressure loads
  find_forces();
  // 4. advances the velocities by the momentum balance, constrained by the walls
  accelerate(dt);
  // 5. adds the impulses of contact and friction on the slide lines; while the interface law computes, the deviators of
  //    the zones away from the slide lines are advanced
  contact_.ask(state_, middle_position_, guides_, dt, steps_ + 1, law_, velocity_new_);
  find_mean_velocities();
  advance_stress(dt, Reach::kInner);
  contact_.answered(state_, guides_, dt, law_, velocity_new_);
  // 6. moves the nodes to the end of the step with the mean velocities
  if (!go_to_end(dt)) {
    if (law_ != nullptr) law_->take_back();
    return false;
  }
  // 7. adds to the energy of each zone the work of its forces with the mean velocities, and the heat of the
  //    slide lines; adds the work of walls and loads to the ledger
  do_work(dt);
  contact_.deposit_heat(velocity_mean_, dt, state_.mass, state_.energy);
  book_boundaries(dt);
  // 8. advances the deviators of the zones on slide lines; updates density, pressure, sound speed and temperature
  advance_stress(dt, Reach::kRim);
  state_.deviator_xx.swap(xx_new_);
  state_.deviator_yy.swap(yy_new_);
  state_.deviator_xy.swap(xy_new_);
  state_.plastic_strain.swap(plastic_strain_new_);
  state_.position.swap(position_new_);
  state_.velocity.swap(velocity_new_);
  state_.volume.swap(volume_new_);
  heating_.swap(heating_new_);
  update_state(state_.volume, state_.energy, state_.density, state_.pressure);
  find_sound_speed_and_temperature();
  return true;
}

void Cycle::choose_step(double end_time) {
  const TimeStep next = next_time_step(bodies_.mesh, bodies_.time_step, middle_, state_.position, state_.sound_speed,
                                       viscous_rate_, dilatation_, unshortened_);
  step_ = next;
  unshortened_ = next;
  if (!std::isfinite(step_.dt) || !(step_.dt > 0.0)) {
    throw std::runtime_error(
        fmt::format("step {}: no time step follows from the state (dt = {})", steps_ + 1, step_.dt));
  }
  // The end time is reached in one step or in two equal steps, never in a much shorter last step: in a very short step
  // slide lines would close their gaps at an unphysical speed.
  const double left = end_time - state_.time;
  if (2.0 * step_.dt > left) step_ = {.dt = step_.dt >= left ? left : 0.5 * left, .limit = StepLimit::kEnd};
}

bool Cycle::go_to_middle(double dt) {
  const int nodes = bodies_.mesh.num_nodes();
#pragma omp parallel for schedule(static) if (nodes >= kFewestForThreads)
  for (int n = 0; n < nodes; ++n) middle_position_[n] = state_.position[n] + (0.5 * dt) * state_.velocity[n];
  measure(bodies_.mesh, middle_position_, middle_);
  const auto inverted = std::ranges::find_if_not(middle_.volume, [](double v) { return v > 0.0; });
  if (inverted == middle_.volume.end()) return true;
  step_.zone = static_cast<int>(inverted - middle_.volume.begin());
  return false;
}

void Cycle::find_gradients() {
  const int zones = bodies_.mesh.num_zones();
#pragma omp parallel for schedule(static) if (zones >= kFewestForThreads)
  for (int z = 0; z < zones; ++z) gradient_[z] = velocity_gradient(bodies_.mesh, middle_, state_.velocity, z);
}

void Cycle::predict_state(double dt) {
  const double half = 0.5 * dt;
  for (std::size_t body = 0; body < bodies_.materials.size(); ++body) {
    const Block& block = bodies_.mesh.blocks()[body];
    const BodyMaterial& material = bodies_.materials[body];
    const int first = block.first_zone;
    const int last = first + block.num_zones();
#pragma omp parallel for schedule(static) if (last - first >= kFewestForThreads)
    for (int z = first; z < last; ++z) {
      const Gradient& d = gradient_[z];
      const double shear_power = state_.deviator_xx[z] * (d.xx - d.tt) + state_.deviator_yy[z] * (d.yy - d.tt) +
                                 state_.deviator_xy[z] * (d.xy + d.yx);
      const double power = middle_.volume[z] * (shear_power - state_.pressure[z] * d.dilatation()) + heating_[z];
      middle_density_[z] = state_.mass[z] / middle_.volume[z];
      middle_energy_[z] = state_.energy[z] + half * power / state_.mass[z];
    }
    if (material.strength) {
      for (const Reach reach : {Reach::kInner, Reach::kRim}) {
        advance_strips(body, reach, half, state_.pressure, gradient_, [&](int z, const StrengthStep& step) {
          middle_xx_[z] = step.deviator.xx;
          middle_yy_[z] = step.deviator.yy;
          middle_xy_[z] = step.deviator.xy;
          plastic_rate_[z] = step.plastic_strain_increment / half;
        });
      }
    }
    material.eos.evaluate(middle_density_, middle_energy_, first, last, middle_pressure_, sound_squared_);
  }
}

void Cycle::find_forces() {
  const Mesh& mesh = bodies_.mesh;
  const int zones = mesh.num_zones();
  std::ranges::fill(corner_force_, Vec2{});
  for (std::size_t body = 0; body < bodies_.materials.size(); ++body) {
    const Block& block = mesh.blocks()[body];
    add_viscosity(mesh, bodies_.viscosity, bodies_.materials[body].eos.half_shock_slope(), middle_, middle_position_,
                  gradient_, middle_density_, state_.sound_speed, plastic_rate_, block.first_zone,
                  block.first_zone + block.num_zones(), corner_force_, viscous_rate_);
  }
  add_hourglass(mesh, bodies_.hourglass, middle_, middle_position_, state_.velocity, middle_density_,
                state_.sound_speed, corner_force_);
#pragma omp parallel for schedule(static) if (zones >= kFewestForThreads)
  for (int z = 0; z < zones; ++z) {
    const int* n = mesh.zone_nodes(z);
    const double xx = middle_xx_[z] - middle_pressure_[z];
    const double yy = middle_yy_[z] - middle_pressure_[z];
    const double tt = -(middle_xx_[z] + middle_yy_[z]) - middle_pressure_[z];
    const double xy = middle_xy_[z];
    double heating = 0.0;
    for (int k = 0; k < 4; ++k) {
      const std::size_t c = 4 * static_cast<std::size_t>(z) + k;
      heating -= dot(corner_force_[c], state_.velocity[n[k]]);
      const Vec2 b = middle_.gradient_weight[c];
      corner_force_[c] -= Vec2{xx * b.x + xy * b.y + tt * middle_.hoop_weight[c], xy * b.x + yy * b.y};
    }
    heating_new_[z] = heating;
  }
  mesh.gather(corner_force_, node_force_);
  for (std::size_t l = 0; l < bodies_.loads.size(); ++l) {
    load_force_[l] = pressure_forces(mesh, bodies_.loads[l], middle_position_);
  }
}

void Cycle::accelerate(double dt) {
  const int nodes = bodies_.mesh.num_nodes();
#pragma omp parallel for schedule(static) if (nodes >= kFewestForThreads)
  for (int n = 0; n < nodes; ++n) {
    velocity_new_[n] = state_.velocity[n] + (dt / state_.node_mass[n]) * node_force_[n];
  }
  for (std::size_t l = 0; l < bodies_.loads.size(); ++l) {
    const std::vector<int>& loaded = bodies_.loads[l].nodes;
    for (std::size_t i = 0; i < loaded.size(); ++i) {
      velocity_new_[loaded[i]] += (dt / state_.node_mass[loaded[i]]) * load_force_[l][i];
    }
  }
  for (const Wall& wall : bodies_.walls) {
    for (const int n : wall.nodes) velocity_new_[n] += (wall.speed - dot(velocity_new_[n], wall.normal)) * wall.normal;
  }
}

void Cycle::find_mean_velocities() {
  const int nodes = bodies_.mesh.num_nodes();
#pragma omp parallel for schedule(static) if (nodes >= kFewestForThreads)
  for (int n = 0; n < nodes; ++n) velocity_mean_[n] = 0.5 * (state_.velocity[n] + velocity_new_[n]);
}

bool Cycle::go_to_end(double dt) {
  const int nodes = bodies_.mesh.num_nodes();
  find_mean_velocities();  // for the second time in the step: the slide lines have changed velocity_new_
#pragma omp parallel for schedule(static) if (nodes >= kFewestForThreads)
  for (int n = 0; n < nodes; ++n) position_new_[n] = state_.position[n] + dt * velocity_mean_[n];
  measure_volumes(bodies_.mesh, position_new_, volume_new_);
  for (int z = 0; z < bodies_.mesh.num_zones(); ++z) {
    const double change = volume_new_[z] - state_.volume[z];
    if (volume_new_[z] > 0.0 && std::abs(change) <= 2.0 * bodies_.time_step.volume_change * state_.volume[z]) continue;
    step_.zone = z;
    return false;
  }
  return true;
}

void Cycle::do_work(double dt) {
  const int zones = bodies_.mesh.num_zones();
#pragma omp parallel for schedule(static) if (zones >= kFewestForThreads)
  for (int z = 0; z < zones; ++z) {
    const int* n = bodies_.mesh.zone_nodes(z);
    const Vec2* force = corner_force_.data() + 4 * static_cast<std::size_t>(z);
    double power = 0.0;
    for (int k = 0; k < 4; ++k) power -= dot(force[k], velocity_mean_[n[k]]);
    state_.energy[z] += dt * power / state_.mass[z];
  }
}

// The impulse of the walls on a node is the change of its momentum that zones, slide lines and loads do not explain.
void Cycle::book_boundaries(double dt) {
  std::vector<Vec2> beyond(bodies_.walls.empty() ? 0 : bodies_.mesh.num_nodes());
  for (std::size_t n = 0; n < beyond.size(); ++n) {
    beyond[n] =
        state_.node_mass[n] * (velocity_new_[n] - state_.velocity[n]) - dt * node_force_[n] - contact_.impulse()[n];
  }
  for (std::size_t l = 0; l < bodies_.loads.size(); ++l) {
    const std::vector<int>& loaded = bodies_.loads[l].nodes;
    for (std::size_t i = 0; i < loaded.size(); ++i) {
      const Vec2 impulse = dt * load_force_[l][i];
      impulse_given_ += impulse;
      work_given_ += dot(impulse, velocity_mean_[loaded[i]]);
      if (!beyond.empty()) beyond[loaded[i]] -= impulse;
    }
  }
  for (const Wall& wall : bodies_.walls) {
    for (const int n : wall.nodes) {
      const Vec2 impulse = dot(beyond[n], wall.normal) * wall.normal;
      impulse_given_ += impulse;
      work_given_ += dot(impulse, velocity_mean_[n]);
    }
  }
}

void Cycle::find_rim() {
  std::vector<bool> on_line(bodies_.mesh.num_nodes(), false);
  for (const SlideLine& line : bodies_.slide_lines) {
    for (const int n : line.soft.nodes) on_line[n] = true;
    for (const int n : line.hard.nodes) on_line[n] = true;
  }
  for (std::size_t body = 0; body < zones_.size(); ++body) {
    const Block& block = bodies_.mesh.blocks()[body];
    for (int z = block.first_zone; z < block.first_zone + block.num_zones(); ++z) {
      const int* n = bodies_.mesh.zone_nodes(z);
      const bool on_rim = std::any_of(n, n + 4, [&](int node) { return on_line[node]; });
      zones_[body][on_rim ? Reach::kRim : Reach::kInner].push_back(z);
    }
  }
}

template <class Store>
void Cycle::advance_strips(std::size_t body, Reach reach, double dt, const std::vector<double>& pressure,
                           const std::vector<Gradient>& gradient, const Store& store) {
  const std::vector<int>& zones = zones_[body][reach];
  const int size = static_cast<int>(zones.size());
#pragma omp parallel for schedule(static) if (size >= kFewestForThreads)
  for (int first = 0; first < size; first += Strip::kMostZones) {
    const std::span<const int> some(zones.data() + first, std::min(Strip::kMostZones, size - first));
    Strip strip;
    for (const int z : some) {
      strip.add({state_.deviator_xx[z], state_.deviator_yy[z], state_.deviator_xy[z]}, gradient[z],
                state_.plastic_strain[z], pressure[z], state_.temperature[z]);
    }
    advance_deviators(*bodies_.materials[body].strength, dt, strip);
    for (std::size_t i = 0; i < some.size(); ++i) store(some[i], strip.step(static_cast<int>(i)));
  }
}

void Cycle::advance_stress(double dt, Reach reach) {
  for (std::size_t body = 0; body < bodies_.materials.size(); ++body) {
    const std::vector<int>& zones = zones_[body][reach];
    const int size = static_cast<int>(zones.size());
#pragma omp parallel for schedule(static) if (size >= kFewestForThreads)
    for (int i = 0; i < size; ++i) {
      gradient_[zones[i]] = velocity_gradient(bodies_.mesh, middle_, velocity_mean_, zones[i]);
      dilatation_[zones[i]] = gradient_[zones[i]].dilatation();
    }
    if (!bodies_.materials[body].strength) continue;
    advance_strips(body, reach, dt, middle_pressure_, gradient_, [&](int z, const StrengthStep& step) {
      xx_new_[z] = step.deviator.xx;
      yy_new_[z] = step.deviator.yy;
      xy_new_[z] = step.deviator.xy;
      plastic_strain_new_[z] = state_.plastic_strain[z] + step.plastic_strain_increment;
    });
  }
}

void Cycle::update_state(const std::vector<double>& volume, const std::vector<double>& energy,
                         std::vector<double>& density, std::vector<double>& pressure) {
  for (std::size_t z = 0; z < volume.size(); ++z) density[z] = state_.mass[z] / volume[z];
  for (std::size_t body = 0; body < bodies_.materials.size(); ++body) {
    const Block& block = bodies_.mesh.blocks()[body];
    bodies_.materials[body].eos.evaluate(density, energy, block.first_zone, block.first_zone + block.num_zones(),
                                         pressure, sound_squared_);
  }
}

void Cycle::find_sound_speed_and_temperature() {
  for (std::size_t body = 0; body < bodies_.materials.size(); ++body) {
    const Block& block = bodies_.mesh.blocks()[body];
    const BodyMaterial& material = bodies_.materials[body];
    const double shear_modulus = material.strength ? material.strength->shear_modulus : 0.0;
    const int last = block.first_zone + block.num_zones();
#pragma omp parallel for schedule(static) if (last - block.first_zone >= kFewestForThreads)
    for (int z = block.first_zone; z < last; ++z) {
      state_.sound_speed[z] = std::sqrt(sound_squared_[z] + 4.0 / 3.0 * shear_modulus / state_.density[z]);
      state_.temperature[z] = material.eos.temperature(state_.density[z], state_.energy[z]);
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
                      {"step_before", one(unshortened_.dt)},
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
