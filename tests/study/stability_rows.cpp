// The rows of the campaign and the physics they run on.
#include <algorithm>
#include <cmath>
#include <limits>

#include "tests/study/stability.hpp"

namespace shearbus::study::stability {

using namespace shearbus::testing;  // NOLINT(google-build-using-namespace): rigs and draws

namespace {

using Lanes = std::array<double, kLanes>;
using Scenes = std::vector<ModelOptions>;

constexpr double kPaperPressure = 11.2e9;  // [Pa]
constexpr double kDenormal = 5e-324;
constexpr Lanes kVelocities = {0.0, kDenormal, 1e-300, 1e-6, 1.0, 1e2, 1e3, 1e4};  // [m/s]
constexpr Lanes kSlips = {0.1, 1.0, 10.0, 50.0, 1e2, 3e2, 1e3, 1e4};

bool forced(const ModelOptions& o) {
  return o.strategy == Strategy::kForceDriven;
}

// ---- What a row does to a physics ----

Scenes as_it_is(const ModelOptions& o) {
  return {o};
}
Scenes force_driven_only(const ModelOptions& o) {
  return forced(o) ? Scenes{o} : Scenes{};
}

Scenes thicknesses(const ModelOptions& o) {
  Scenes scenes;
  for (const double h : {1e-7, 1e-6, 20e-6, 1e-3, 1e-2}) {
    ModelOptions& scene = scenes.emplace_back(o);
    if (scene.hard_grid) scene.hard_grid->thickness *= h / scene.grid.thickness;
    scene.grid.thickness = h;
  }
  return scenes;
}

// 400 cells of 0.25 nm: alpha dt / dz^2 = 1e8 at 0.13 us.
Scenes fine_grid(const ModelOptions& o) {
  ModelOptions scene = thicknesses(o).front();
  scene.grid.cells = 400;
  scene.grid.grading = 1.0;
  if (o.inertia) {
    scene.grid.cells = 100;
    scene.grid.thickness *= 0.25;
  }
  return {scene};
}

Scenes grids(const ModelOptions& o) {
  Scenes scenes;
  for (const auto& [cells, grading] : {std::pair{1, 1.0}, {2, 1.0}, {40, 1.3}, {60, 1.5}, {1000, 1.0}}) {
    ModelOptions& scene = scenes.emplace_back(o);
    scene.grid.cells = cells;
    scene.grid.grading = grading;
  }
  return scenes;
}

Scenes hardenings(const ModelOptions& o) {
  Scenes scenes;
  for (const double n : {0.01, 0.05, 0.2, 0.5, 1.0}) {
    for (const double beta : {0.0, 1.0, 125.0, 1e4, 1e6}) {
      ModelOptions& scene = scenes.emplace_back(o);
      Material& metal = scene.junctions ? scene.junctions->metal : scene.soft;
      metal.hardening_exponent = n;
      if (is_johnson_cook(metal)) {
        metal.hardening_modulus = metal.yield_strength * std::min(beta, 100.0);
      } else {
        metal.hardening_coefficient = beta;
      }
    }
  }
  return scenes;
}

bool layer_flows(const ModelOptions& o) {
  return !forced(o) || o.plastic_layer;
}

Scenes saturations(const ModelOptions& o) {
  if (is_johnson_cook(o.soft) || !(layer_flows(o) || o.junctions)) return {};  // nothing saturates
  Scenes scenes;
  for (const double share : {0.5, 1.0, 1.0001, 1.5, 3.0}) {
    ModelOptions& scene = scenes.emplace_back(o);
    Material& metal = scene.junctions ? scene.junctions->metal : scene.soft;
    metal.yield_strength_max = share * metal.yield_strength;
  }
  return scenes;
}

Scenes swapped(const ModelOptions& o) {
  ModelOptions scene = o;
  std::swap(scene.soft, scene.hard);
  scene.soft.melting_curve = o.soft.melting_curve;
  scene.soft.pressure_term = o.soft.pressure_term;
  scene.hard.melting_curve = MeltingCurve::kConstant;
  scene.hard.pressure_term = PressureTerm::kLinear;
  if (is_johnson_cook(o.soft)) {
    follow_johnson_cook(scene.soft, o.soft.hardening_modulus, o.soft.rate_coefficient, o.soft.reference_strain_rate,
                        o.soft.thermal_exponent, o.soft.reference_temperature);
  }
  if (!constant_missing_for_options(scene.soft).empty()) return {};
  return {scene};
}

Scenes step_lengths(const ModelOptions& o) {
  return Scenes(8, o);  // 1e-12 to 1e-5 s
}

// The step of zones of 5 um that sticks, or slips with either of two slips, near melting: server/physics/MODEL.md
// section 6.
Scenes near_three_roots(const ModelOptions& o) {
  if (!forced(o) || o.junctions || o.plastic_layer || o.interface.friction_law != FrictionLaw{} ||
      is_johnson_cook(o.soft) || o.soft.varies_with_compression()) {
    return {};
  }
  ModelOptions scene = o;
  scene.grid.far_boundary = FarBoundary::kHalfSpace;
  scene.interface.yield_strength = 0.68e9;
  return Scenes(40, scene);
}

// ---- Starts ----

double melting(const Course& c) {
  return at_pressure(c.rig.model.options().soft, kPaperPressure).melting_temperature;
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

// ---- What happens before a step ----

void slide(Course& c) {
  c.impose_all(kSlips);
}

void all_velocities(Course& c) {
  c.impose_all(kVelocities);
}

void all_pressures(Course& c) {
  constexpr Lanes kPressures = {-20e9, -1.0, 0.0, 1e-3, 1e6, 1e9, 1e11, 200e9};
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
    c.rig.inputs.pressure[l] = kPaperPressure * kShares[(c.step / (l + 1)) % 8];
    c.impose(l, 100.0);
  }
}

void open_and_close(Course& c) {
  for (int l = 0; l < kLanes; ++l) {
    c.rig.inputs.pressure[l] = (c.step / (l + 1)) % 3 == 2 ? -1e8 : kPaperPressure;
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

// From rest under far stresses, or sliding on: about 33.888 m/s without friction.
void meet_three_roots(Course& c) {
  for (int l = 0; l < kLanes; ++l) {
    const double slip = 33.888 * c.draw.uniform(0.95, 1.05);
    if (l % 2 == 0) {
      c.push(l, 2.0 * slip / c.dt * c.rig.inputs.mass_minus[l], 0.0);
      c.go_on(l);
    } else {
      c.impose(l, slip);
    }
  }
}
void start_near_three_roots(Course& c) {
  Lanes T{};
  for (double& one : T) one = c.draw.uniform(1212.0, 1217.0);
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
    c.rig.inputs.mass_minus[l] = kMinus[at];
    c.rig.inputs.mass_plus[l] = kPlus[at];
    c.impose(l, c.step % 7 == 6 ? -50.0 : 100.0);
    c.push(l, c.step % 3 == 2 ? -3e8 : 3e8, 1e8);
    if (c.step > 50) c.go_on(l);
  }
}

void drag_the_layer(Course& c) {
  constexpr Lanes kRates = {1e3, 1e6, 1e9, 1e12, 1e15, 1e15, 1e10, 1e6};  // [1/s]
  for (int l = 0; l < kLanes; ++l) {
    const double rate = kRates[static_cast<std::size_t>(l)];
    c.rig.inputs.soft_shear_rate[l] = (c.step + l) % 4 == 3 ? -rate : rate;
    c.rig.inputs.soft_plastic_rate[l] = c.rig.model.options().plastic_layer ? rate : 0.0;
    c.impose(l, 50.0);
  }
}
Scenes dragged(const ModelOptions& o) {
  const bool takes = forced(o) ? o.plastic_layer : o.drive == Drive::kInterfaceSlip;
  return takes ? Scenes{o} : Scenes{};
}

// ---- What a row must have met ----

bool melts(const ModelOptions&, const Figures& f) {
  return f.regime(Regime::kMelting) > 0 || f.nearest_melting < 25.0;
}
bool opens(const ModelOptions&, const Figures& f) {
  return f.regime(Regime::kOpen) > 0 && f.regime(Regime::kOpen) < f.node_steps;
}
bool rests(const ModelOptions&, const Figures& f) {
  return f.regime(Regime::kStick) > f.node_steps / 10;
}
bool chooses(const ModelOptions&, const Figures& f) {
  return f.divided > 0;
}

}  // namespace

std::vector<Physics> all_physics() {
  const auto base = [](Strategy strategy) {
    ModelOptions o = graded(paper_options(strategy), 40, 1.12);
    o.grid.far_boundary = FarBoundary::kHalfSpace;
    return o;
  };
  const auto under_pressure = [](ModelOptions o) {
    o.soft.melting_curve = MeltingCurve::kLindemann;
    o.soft.pressure_term = PressureTerm::kCompressed;
    return o;
  };
  const auto johnson_cook = [](ModelOptions o) {
    follow_johnson_cook(o.soft, 426e6, 0.015, 1.0, 1.0, 300.0);
    o.soft.hardening_exponent = 0.34;
    return o;
  };
  const auto in_two_directions = [](ModelOptions o) {
    o.tangential_components = 2;
    return o;
  };
  const ModelOptions velocity = base(Strategy::kVelocityDriven);
  const ModelOptions force = base(Strategy::kForceDriven);

  ModelOptions interface_slip = velocity;
  interface_slip.drive = Drive::kInterfaceSlip;
  ModelOptions friction = velocity;
  friction.friction_coefficient = 0.02;
  ModelOptions plastic_heating = two_sided(velocity);
  plastic_heating.taylor_quinney_factor = 0.9;
  ModelOptions inertia = velocity;
  inertia.inertia = true;
  ModelOptions waves_and_friction = under_pressure(friction);
  waves_and_friction.inertia = true;

  ModelOptions insulated = force;
  insulated.grid.far_boundary = FarBoundary::kInsulated;
  ModelOptions plastic_layer = force;
  plastic_layer.plastic_layer = true;
  plastic_layer.interface.yield_strength = 400e6;
  ModelOptions junctions = force;
  junctions.junctions = {0.5, 1e-7, force.soft};
  ModelOptions weakening = force;
  weakening.interface.friction_law = FrictionLaws::place<VelocityWeakening>();
  weakening.interface.friction_coefficient = 0.02;
  weakening.interface.friction_coefficient_fast = 0.002;
  weakening.interface.velocity_decay = 0.01;
  const auto second_order = [](ModelOptions o) {
    o.time_integrator = TimeIntegrator::kSdirk2;
    return o;
  };
  ModelOptions modes = force;
  modes.modes = {.accuracy = 1e-4, .shortest_step = 1e-12, .longest_time = 1e-3};
  ModelOptions slab_modes = modes;
  slab_modes.grid.far_boundary = FarBoundary::kInsulated;

  return {{"layer shear", velocity},
          {"interface slip", interface_slip},
          {"Coulomb limit", friction},
          {"two-sided", two_sided(velocity)},
          {"plastic heating", plastic_heating},
          {"inertia", inertia},
          {"inertia, Coulomb, T_melt(P)", waves_and_friction},
          {"T_melt(P), compressed", under_pressure(velocity)},
          {"Johnson-Cook", johnson_cook(velocity)},
          {"two components", in_two_directions(velocity)},
          {"second order", second_order(velocity)},
          {"force-driven", force},
          {"force, insulated", insulated},
          {"force, plastic layer", plastic_layer},
          {"force, junctions", junctions},
          {"force, weakening", weakening},
          {"force, two-sided", two_sided(force)},
          {"force, T_melt(P), plastic layer", under_pressure(plastic_layer)},
          {"force, Johnson-Cook", johnson_cook(force)},
          {"force, Johnson-Cook, plastic layer", johnson_cook(plastic_layer)},
          {"force, second order", second_order(force)},
          {"force, modes", modes},
          {"force, modes of a slab, 2nd order", second_order(slab_modes)},
          {"force, two components", in_two_directions(force)},
          {"force, all of it", in_two_directions(two_sided(under_pressure(plastic_layer)))}};
}

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
         c.dt = 1.3e-7;
         slide(c);
       },
       true,
       {}},
      {"grid", "one cell, two, cells growing by 1.5, 1000", 60, grids, {}, slide, true, {}},
      {"near_melting", "T_ref within 0.1 K of melting, down to an ulp", 200, as_it_is, start_below_melting, slide, true,
       melts},
      {"above_melting", "T_ref at melting and above", 100, as_it_is, start_above_melting, slide, true, {}},
      {"cold", "T_ref 1e-300 to 77 K", 200, as_it_is, start_cold, slide, true, {}},
      {"hardening", "n 0.01 to 1, beta 0 to 1e6", 60, hardenings, {}, slide, true, {}},
      {"saturation", "Y_max below, at and above Y0", 200, saturations, {}, slide, true, {}},
      {"reversals", "[V] and far stresses turn in every step", 300, as_it_is, {}, to_and_fro, false, {}},
      {"release", "pressure down by fifteen decades and back", 300, as_it_is, {}, release_and_reload, false, {}},
      {"opening", "the contact opens and closes", 300, as_it_is, {}, open_and_close, false, opens},
      {"hovering",
       "[V] about 0 for 100,000 steps",
       100000,
       [](const ModelOptions& o) {
         ModelOptions scene = o;
         scene.grid.cells = 10;
         scene.grid.grading = 1.3;
         return Scenes{scene};
       },
       {},
       hover,
       false,
       rests},
      {"three_roots", "states with several answers near melting", 20, near_three_roots, start_near_three_roots,
       meet_three_roots, false, chooses},
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

// ---- A scene under way ----

Course::Course(Rig& on, int scene_number)
    : rig(on), draw(7001 + static_cast<std::uint64_t>(scene_number)), scene(scene_number) {
  for (int l = 0; l < kLanes; ++l) {
    rig.inputs.pressure[l] = kPaperPressure;
    rig.inputs.mass_minus[l] = 2703 * 2.5e-6;
    rig.inputs.mass_plus[l] = 7900 * 2.5e-6;
    rig.inputs.soft_shear_rate[l] = 1e5;
    rig.inputs.soft_plastic_rate[l] = rig.model.options().plastic_layer ? 1e5 : 0.0;
  }
}

bool Course::forced() const {
  return stability::forced(rig.model.options());
}

namespace {
std::pair<double, double> direction_of(const Course& c, int lane) {
  if (c.rig.model.options().tangential_components == 1) return {1.0, 0.0};
  const double angle = 0.8 * lane + 0.01 * c.step;
  return {std::cos(angle), std::sin(angle)};
}
}  // namespace

void Course::impose(int lane, double jump) {
  const auto [x, y] = direction_of(*this, lane);
  rig.inputs.velocity_jump[lane] = x * jump;
  rig.second.velocity_jump[lane] = y * jump;
}

void Course::impose_all(const std::array<double, kLanes>& jumps) {
  for (int l = 0; l < kLanes; ++l) impose(l, jumps[static_cast<std::size_t>(l)]);
}

void Course::push(int lane, double minus, double plus) {
  const auto [x, y] = direction_of(*this, lane);
  rig.inputs.stress_minus[lane] = x * minus;
  rig.second.stress_minus[lane] = y * minus;
  rig.inputs.stress_plus[lane] = x * plus;
  rig.second.stress_plus[lane] = y * plus;
}

void Course::go_on(int lane) {
  if (!forced() || step == 0) return;
  rig.inputs.velocity_jump[lane] = rig.outputs.velocity_jump_new[lane];
  rig.second.velocity_jump[lane] = rig.second_outputs.velocity_jump_new[lane];
}

}  // namespace shearbus::study::stability
