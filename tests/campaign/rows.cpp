// The rows of the stability campaign.
#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "tests/campaign/campaign.hpp"

namespace shearbus::study::stability {

using namespace shearbus::testing;  // NOLINT(google-build-using-namespace): rigs, draws of tests/support

namespace {

using Lanes = std::array<double, kLanes>;
using Scenes = std::vector<ModelOptions>;

constexpr double kDenormal = 5e-324;
constexpr double kMostPressure = 200e9;                                            // highest pressure of the rows  [Pa]
constexpr Lanes kVelocities = {0.0, kDenormal, 1e-300, 1e-6, 1.0, 1e2, 1e3, 1e4};  // velocity jump of each lane  [m/s]
constexpr Lanes kSlips = {0.1, 1.0, 10.0, 50.0, 1e2, 3e2, 1e3, 1e4};

bool forced(const ModelOptions& o) {
  return o.strategy == Strategy::kForceDriven;
}

// ---- Scenes that the rows (load histories) of the campaign run ----

Scenes as_it_is(const Physics& p) {
  return {p.options};
}
Scenes force_driven_only(const Physics& p) {
  return forced(p.options) ? Scenes{p.options} : Scenes{};
}

// With a tolerance, chooses grid and methods again, because `o` has another thickness or other materials than before.
ModelOptions remade(const ModelOptions& o) {
  return o.tolerance ? discretised(o, *o.tolerance) : o;
}

ModelOptions with_thickness(ModelOptions o, double h) {
  if (o.hard_grid) o.hard_grid->thickness *= h / o.grid.thickness;
  o.grid.thickness = h;
  return remade(o);
}

Scenes thicknesses(const Physics& p) {
  Scenes scenes;
  for (const double h : {1e-7, 1e-6, p.options.grid.thickness, 1e-3, 1e-2})
    scenes.push_back(with_thickness(p.options, h));
  return scenes;
}

// In a step of 0.13 us heat diffuses through about 1e4 cells of fine_grid(); in aluminium a cell is 0.25 nm wide.
constexpr double kFourierStep = 1.3e-7;  // step length of the row "fourier_number"  [s]
Scenes fine_grid(const Physics& p) {
  const ModelOptions& o = p.options;
  if (o.modes || o.tolerance) return {};  // with modes or a tolerance a scene cannot set the number of cells
  const int cells = o.inertia ? 100 : 400;
  ModelOptions scene = with_thickness(o, cells * 1e-4 * std::sqrt(o.soft.diffusivity * kFourierStep));
  scene.grid.cells = cells;
  scene.grid.grading = 1.0;
  return {scene};
}

// Scenes that differ in the grid. If the physics has a tolerance, the scenes differ in the tolerance instead, because
// it determines the grid.
Scenes grids(const Physics& p) {
  const ModelOptions& o = p.options;
  Scenes scenes;
  if (o.tolerance) {
    for (const double tolerance : {1e-1, 1e-2, 1e-3, 1e-4}) scenes.push_back(discretised(o, tolerance));
    return scenes;
  }
  if (o.modes) return {};
  // With sleep a grid of 1,000 cells would cost too much: a node that falls asleep is expanded into all modes of its
  // grid.
  const int most = o.sleep ? 400 : 1000;
  for (const auto& [cells, grading] : {std::pair{1, 1.0}, {2, 1.0}, {40, 1.3}, {60, 1.5}, {most, 1.0}}) {
    ModelOptions& scene = scenes.emplace_back(o);
    scene.grid.cells = cells;
    scene.grid.grading = grading;
  }
  return scenes;
}

bool layer_flows(const ModelOptions& o) {
  return !forced(o) || o.plastic_layer;
}

Scenes hardenings(const Physics& p) {
  const ModelOptions& o = p.options;
  if (!(layer_flows(o) || o.junctions)) return {};  // no metal hardens under these options
  Scenes scenes;
  for (const double n : {0.01, 0.05, 0.2, 0.5, 1.0}) {
    for (const double beta : {0.0, 1.0, 125.0, 1e4, 1e6}) {
      ModelOptions& scene = scenes.emplace_back(o);
      Material& metal = scene.junctions ? scene.junctions->metal : scene.soft;
      const auto has = [&](double Material::*constant) { return has_constant(metal.flow_law, constant); };
      if (has(&Material::hardening_exponent)) metal.hardening_exponent = n;
      if (has(&Material::hardening_coefficient)) metal.hardening_coefficient = beta;
      if (has(&Material::hardening_modulus)) metal.hardening_modulus = metal.yield_strength * std::min(beta, 100.0);
      if (has(&Material::work_hardening_rate)) metal.work_hardening_rate = 0.1 * n;
      if (has(&Material::work_hardening_curvature)) metal.work_hardening_curvature = std::min(beta, 100.0);
    }
  }
  return scenes;
}

Scenes saturations(const Physics& p) {
  const ModelOptions& o = p.options;
  const bool ceiling = layer_flows(o) && properties_of(o.soft.flow_law).has_ceiling;
  if (!ceiling && !o.junctions) return {};  // under these options no flow is limited by Y_max, which this row varies
  Scenes scenes;
  for (const double share : {0.5, 1.0, 1.0001, 1.5, 3.0}) {
    ModelOptions& scene = scenes.emplace_back(o);
    Material& metal = scene.junctions ? scene.junctions->metal : scene.soft;
    metal.yield_strength_max = share * metal.yield_strength;
  }
  return scenes;
}

Scenes swapped(const Physics& p) {
  const ModelOptions& o = p.options;
  if (o.hard.flow_law != FlowLaw{} && o.hard.flow_law != o.soft.flow_law)
    return {};  // after the swap the layer would have another flow law, that is, be another physics
  ModelOptions scene = o;
  std::swap(scene.soft, scene.hard);
  scene.soft.melting_curve = o.soft.melting_curve;
  scene.soft.pressure_term = o.soft.pressure_term;
  scene.hard.melting_curve = MeltingCurve::kConstant;
  scene.hard.pressure_term = PressureTerm::kLinear;
  if (o.soft.flow_law != o.hard.flow_law) adopt_flow_law(scene.soft, o.soft);
  if (scene.junctions) {  // the junctions now consist of the other metal, but keep their strength and hardening
    const Material& old = o.junctions->metal;
    Material& metal = scene.junctions->metal;
    metal = scene.soft;
    metal.flow_law = old.flow_law;
    metal.yield_strength = old.yield_strength;
    metal.yield_strength_max = old.yield_strength_max;
    metal.hardening_coefficient = old.hardening_coefficient;
    metal.hardening_exponent = old.hardening_exponent;
  }
  if (!constant_missing_for_options(scene.soft).empty()) return {};
  return {remade(scene)};
}

Scenes step_lengths(const Physics& p) {
  return Scenes(8, p.options);  // one scene for each step length from 1e-12 to 1e-5 s
}

Scenes near_several_answers(const Physics& p) {
  if (p.options.melt_film) return {};  // film and contact in series have one answer (MODEL.md, "Melt film")
  return several_answers(p) ? Scenes(40, p.options) : Scenes{};
}

// ---- Initial states with which the rows (load histories) begin ----

double melting(const Course& c) {
  return at_pressure(c.rig.model.options().soft, c.host.pressure).melting_temperature;
}

void start_at(Course& c, const Lanes& temperatures) {
  double T[kLanes];
  std::copy_n(temperatures.begin(), kLanes, T);
  c.rig.start(T);
}

void start_below_melting(Course& c) {
  const double T = melting(c);
  start_at(c, {std::nextafter(T, 0.0), T - 1e-9, T - 1e-6, T - 1e-3, T - 1e-2, T - 0.05, T - 0.1, T - 10.0});
}
void start_above_melting(Course& c) {
  const double T = melting(c);
  start_at(c, {T, std::nextafter(T, 1e9), T + 1e-6, T + 1e-3, T + 0.1, T + 1.0, T + 10.0, T + 1000.0});
}
void start_cold(Course& c) {
  start_at(c, {1e-300, 1e-6, 1e-3, 0.1, 1.0, 4.2, 20.0, 77.0});
}

// ---- Inputs that the rows set before a step ----

void slide(Course& c) {
  c.impose_all(kSlips);
}

void all_velocities(Course& c) {
  c.impose_all(kVelocities);
}

void all_pressures(Course& c) {
  constexpr Lanes kPressures = {-20e9, -1.0, 0.0, 1e-3, 1e6, 1e9, 1e11, kMostPressure};
  for (int l = 0; l < kLanes; ++l) {
    c.rig.inputs.pressure[l] = kPressures[static_cast<std::size_t>(l)];
    c.impose(l, 100.0);
  }
}

void longer_and_longer(Course& c) {
  c.dt = std::pow(10.0, -12.0 + 7.0 * c.step / 350.0);
  slide(c);
}

void steps_of_the_scene(Course& c) {
  c.dt = std::pow(10.0, -12.0 + c.scene);
  c.impose_all({1e3, 2e3, 3e3, 5e3, 7e3, 8e3, 9e3, 1e4});
}

void any_step(Course& c) {
  c.dt = c.draw.log_uniform(1e-11, 1e-7);
  for (int l = 0; l < kLanes; ++l) c.impose(l, kSlips[static_cast<std::size_t>(l)] * c.draw.uniform(0.5, 1.5));
}

void to_and_fro(Course& c) {
  const double sign = c.step % 2 == 0 ? 1.0 : -1.0;
  for (int l = 0; l < kLanes; ++l) {
    c.impose(l, sign * kSlips[static_cast<std::size_t>(l)]);
    c.push(l, sign * 5e8, -sign * 2e8);
    c.rig.inputs.soft_shear_rate[l] = sign * 1e6;
  }
}

void release_and_reload(Course& c) {
  constexpr double kShares[] = {1.0, 0.5, 1e-3, 1e-9, 1e-15, 0.1, 2.0, 17.0};
  for (int l = 0; l < kLanes; ++l) {
    c.rig.inputs.pressure[l] = std::min(kMostPressure, c.host.pressure * kShares[(c.step / (l + 1)) % 8]);
    c.impose(l, 100.0);
  }
}

void open_and_close(Course& c) {
  for (int l = 0; l < kLanes; ++l) {
    c.rig.inputs.pressure[l] = (c.step / (l + 1)) % 3 == 2 ? -1e8 : c.host.pressure;
    c.impose(l, (c.step / 5 + l) % 2 == 0 ? 100.0 : -30.0);
    c.push(l, 1e8, 0.0);
  }
}

void hover(Course& c) {
  constexpr Lanes kAround = {0.0, kDenormal, 1e-300, 1e-12, 1e-9, 1e-6, 1e-3, 0.1};
  for (int l = 0; l < kLanes; ++l) {
    if (c.forced()) {
      c.push(l, c.draw.sign() * c.draw.log_uniform(1.0, 1e9), c.draw.sign() * 1e6);
      c.go_on(l);
    } else {
      c.impose(l, c.draw.sign() * kAround[static_cast<std::size_t>(l)]);
    }
  }
}

// Loads the lanes for a step with several solutions. `several->slip` is the slip velocity that such a step would have
// without friction. Even lanes get the far stress that would drive them from rest to this velocity; odd lanes slide at
// this velocity. For each lane the velocity is changed at random by up to 5 %.
void meet_several_answers(Course& c) {
  c.dt = c.several->dt;
  for (int l = 0; l < kLanes; ++l) {
    const double slip = c.several->slip * c.draw.uniform(0.95, 1.05);
    if (l % 2 == 0) {
      c.push(l, 2.0 * slip / c.dt * c.rig.inputs.mass_soft[l], 0.0);
      c.go_on(l);
    } else {
      c.impose(l, slip);
    }
  }
}
void start_near_several_answers(Course& c) {
  c.several = several_answers({.name = {}, .options = c.rig.model.options(), .host = c.host});
  Lanes T{};
  for (double& one : T) one = c.several->temperature + c.several->below * c.draw.uniform(-0.6, 0.4);
  start_at(c, T);
}

void push_hard(Course& c) {
  constexpr Lanes kMinus = {1e12, -1e12, 1e12, -1e12, 1e9, 0.0, 1e12, 1e12};
  constexpr Lanes kPlus = {1e12, -1e12, -1e12, 1e12, -1e9, 1e12, 0.0, -1e12};
  for (int l = 0; l < kLanes; ++l) {
    const auto at = static_cast<std::size_t>(l);
    c.push(l, kMinus[at], kPlus[at]);
    if (c.step % 2 == 0 || c.step > 60) c.go_on(l);
  }
}

void all_masses(Course& c) {
  constexpr Lanes kMinus = {1e-30, 1e30, 1e-30, 1e-9, 1e9, 1e-3, 1e-15, 1e-30};
  constexpr Lanes kPlus = {1e-30, 1e30, 1e30, 1e-9, 1e9, 1e30, 1e15, 1e-3};
  for (int l = 0; l < kLanes; ++l) {
    const auto at = static_cast<std::size_t>(l);
    c.rig.inputs.mass_soft[l] = kMinus[at] + mass_of_waves(c.rig.model.options()).soft;
    c.rig.inputs.mass_hard[l] = kPlus[at] + mass_of_waves(c.rig.model.options()).hard;
    c.impose(l, c.step % 7 == 6 ? -50.0 : 100.0);
    c.push(l, c.step % 3 == 2 ? -3e8 : 3e8, 1e8);
    if (c.step > 50) c.go_on(l);
  }
}

void drag_the_layer(Course& c) {
  constexpr Lanes kRates = {1e3, 1e6, 1e9, 1e12, 1e15, 1e15, 1e10, 1e6};  // shear rate of each lane  [1/s]
  for (int l = 0; l < kLanes; ++l) {
    const double rate = ((c.step + l) % 4 == 3 ? -1.0 : 1.0) * kRates[static_cast<std::size_t>(l)];
    c.rig.inputs.soft_shear_rate[l] = rate;
    c.rig.inputs.soft_plastic_strain_rate[l] = c.rig.model.options().plastic_layer ? rate : 0.0;
    c.impose(l, 50.0);
  }
}
Scenes dragged(const Physics& p) {
  const ModelOptions& o = p.options;
  const bool takes = forced(o) ? o.plastic_layer : o.drive == Drive::kInterfaceSlip;
  return takes ? Scenes{o} : Scenes{};
}

// ---- Checks that a row (a load history) has reached the regime for which it is meant ----

std::string melts(const Figures& f) {
  if (f.regime(Regime::kMelting) > 0 || f.nearest_melting < 25.0) return {};
  return fmt::format("no layer came nearer to melting than {:.3g} K", f.nearest_melting);
}
std::string opens(const Figures& f) {
  const long open = f.regime(Regime::kOpen);
  return open > 0 && open < f.node_steps ? "" : "no contact opened, or all did";
}
std::string rests(const Figures& f) {
  if (f.regime(Regime::kStick) > f.node_steps / 10) return {};
  return fmt::format("{} of {} node-steps stuck", f.regime(Regime::kStick), f.node_steps);
}
std::string chooses(const Figures& f) {
  return f.divided + f.several > 0 ? "" : "no step had several answers";
}

}  // namespace

std::vector<Row> all_rows() {
  return {
      {"velocity", "[V] 0, denormal, to 1e4 m/s", 300, as_it_is, {}, all_velocities, true, melts},
      {"pressure", "P -20 to 200 GPa", 200, as_it_is, {}, all_pressures, true, opens},
      {"step_length", "dt 1e-12 to 1e-5 s, longer and longer", 350, as_it_is, {}, longer_and_longer, false, melts},
      {"runaway",
       "[V] 1 to 10 km/s from cold, with dt of every decade",
       100,
       step_lengths,
       {},
       steps_of_the_scene,
       true,
       melts},
      {"variable_step", "dt drawn anew in each step, over four decades", 400, as_it_is, {}, any_step, false, melts},
      {"thickness", "h 0.1 um to 10 mm", 200, thicknesses, {}, slide, true, {}},
      {"fourier_number",
       "alpha dt/dz^2 = 1e8",
       60,
       fine_grid,
       {},
       [](Course& c) {
         c.dt = kFourierStep;
         slide(c);
       },
       true,
       {}},
      {"grid", "one cell, two, cells growing by 1.5, 1000; any tolerance", 60, grids, {}, slide, true, {}},
      {"near_melting", "T_ref within 0.1 K of melting, down to an ulp", 200, as_it_is, start_below_melting, slide, true,
       melts},
      {"above_melting", "T_ref at melting and above", 100, as_it_is, start_above_melting, slide, true, {}},
      {"cold", "T_ref 1e-300 to 77 K", 200, as_it_is, start_cold, slide, true, {}},
      {"hardening", "n 0.01 to 1, beta 0 to 1e6", 60, hardenings, {}, slide, true, {}},
      {"saturation", "Y_max below, at and above Y0", 200, saturations, {}, slide, true, {}},
      {"reversals", "[V] and far stresses turn in every step", 300, as_it_is, {}, to_and_fro, false, {}},
      {"release", "pressure down by fifteen decades and back", 300, as_it_is, {}, release_and_reload, false, {}},
      {"opening", "the contact opens and closes", 300, as_it_is, {}, open_and_close, false, opens},
      {"hovering", "[V] about 0 for many steps", 100000, as_it_is, {}, hover, false, rests},
      {"three_roots", "states with several answers near melting", 20, near_several_answers, start_near_several_answers,
       meet_several_answers, false, chooses},
      {"far_stress", "far stresses of 1e12 Pa", 120, force_driven_only, {}, push_hard, false, {}},
      {"masses", "masses 1e-30 to 1e30 kg/m2", 120, force_driven_only, {}, all_masses, false, {}},
      {"swapped", "the hard metal named soft", 200, swapped, {}, slide, true, {}},
      {"host_shear",
       "shear and plastic rates of the host's zone to 1e15 1/s",
       120,
       dragged,
       {},
       drag_the_layer,
       false,
       {}},
  };
}

}  // namespace shearbus::study::stability
