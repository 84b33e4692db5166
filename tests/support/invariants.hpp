// server/physics/MODEL.md, "What always holds", as laws of one step that throw what they find broken. The property
// tests, the stability campaign and the controls that must break them are judged by the same ones.
#pragma once

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <string>
#include <vector>

#include "server/physics/reference/parts.hpp"
#include "tests/support/physics_rig.hpp"
#include "tests/support/random_physics.hpp"

namespace shearbus::testing {

// A law did not hold.
class Broken : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

// Conditions are written so that a NaN breaks them.
template <class... Args>
void require(bool held, fmt::format_string<const Args&...> text, const Args&... args) {
  if (!held) throw Broken(fmt::format(text, args...));
}
inline void require_near(double value, double expected, double tolerance, const char* what) {
  require(std::abs(value - expected) <= tolerance, "{}: {:.17g} instead of {:.17g}, more than {:.3g} apart", what,
          value, expected, tolerance);
}

// The worst of a run, over all its node-steps.
struct Figures {
  long node_steps = 0;
  std::array<long, 5> in_regime{};  // by Regime
  long divided = 0;                 // into substeps
  long several = 0;                 // several answers satisfied the step
  long flowing = 0;                 // plastic layers that carry a stress, and those of them whose slip is resolved
  long flowing_resolved = 0;
  double heat_residual = 0.0;  // of the heat balance, relative to the heat that is there
  double nearest_melting = std::numeric_limits<double>::infinity();  // T_melt - T                 [K]
  double over_limit = 0.0;  // of a stress over what its interface or layer carries, relative

  void add(const Figures& other) {
    node_steps += other.node_steps;
    for (std::size_t i = 0; i < in_regime.size(); ++i) in_regime[i] += other.in_regime[i];
    divided += other.divided;
    several += other.several;
    flowing += other.flowing;
    flowing_resolved += other.flowing_resolved;
    heat_residual = std::max(heat_residual, other.heat_residual);
    nearest_melting = std::min(nearest_melting, other.nearest_melting);
    over_limit = std::max(over_limit, other.over_limit);
  }
  long regime(Regime which) const { return in_regime[static_cast<std::size_t>(which)]; }
};

inline constexpr int kMostParts = 1 << 22;  // of a step whose error is controlled; 64 of one with several answers

// What a node was told and what it answered in one step, along the direction of its answer. Nothing here says who
// answered.
struct Answered {
  double dt = 0.0;        // [s]
  double pressure = 0.0;  // [Pa]
  double jump_old = 0.0, jump_new = 0.0, slip = 0.0;
  double jump_length = 0.0;  // of both components: what lies along the answer is known to a last digit of this
  double stress_old = 0.0, stress = 0.0;
  double T0 = 0.0, heat = 0.0;
  double driven = 0.0;         // what the far stresses add to the jump, DLP (61)                    [m/s]
  double driven_size = 0.0;    // the sum of their magnitudes
  double per_stress = 0.0;     // what a stress takes from the jump                                  [m/(s Pa)]
  double plastic_drive = 0.0;  // sqrt(3) h Ep_dot                                                   [m/s]
  double junction_strain = 0.0;
  bool sticks = false;  // plastic layer: the interface ended the step without slip
  Regime regime = Regime::kOpen;
  std::uint8_t outcome = 0;
  bool controlled = false;  // steps of a model with a tolerance: taken in substeps, as many as it needs

  bool divided() const { return (outcome & kSubstepped) != 0; }
  // Into so many substeps at most; their answers are one of means, sums and the last one's.
  int parts() const { return divided() || controlled ? kMostParts : 1; }
  bool in_parts() const { return parts() > 1; }
  double size() const { return std::abs(jump_old) + driven_size + std::abs(stress * per_stress); }
};

// One lane of a rig after a step, whose `trial` is the state before. Of two components what lies along the answer.
inline Answered answered(const Rig& rig, int lane, double dt) {
  const TileInputs& in = rig.inputs;
  const TileOutputs& out = rig.outputs;
  const TileLayout& layout = rig.model.layout();
  double x = 1.0, y = 0.0;
  if (rig.model.options().tangential_components == 2) {
    const auto along = [&](double first, double second) {
      const double largest = std::max(std::abs(first), std::abs(second));
      if (!(largest > 0.0)) return false;
      const double length = std::hypot(first / largest, second / largest);
      x = first / largest / length;
      y = second / largest / length;
      return true;
    };
    along(out.shear_stress[lane], rig.outputs.second_shear_stress[lane]) ||
        along(out.sliding_velocity[lane], rig.outputs.second_sliding_velocity[lane]) ||
        along(out.velocity_jump_new[lane], rig.outputs.second_velocity_jump_new[lane]);
  }
  const auto project = [&](double first, double second) { return y == 0.0 ? first * x : first * x + second * y; };
  Answered a;
  a.dt = dt;
  a.pressure = in.pressure[lane];
  a.jump_old = project(in.velocity_jump[lane], rig.inputs.second_velocity_jump[lane]);
  a.jump_length = std::hypot(in.velocity_jump[lane], rig.inputs.second_velocity_jump[lane]);
  a.jump_new = project(out.velocity_jump_new[lane], rig.outputs.second_velocity_jump_new[lane]);
  a.slip = project(out.sliding_velocity[lane], rig.outputs.second_sliding_velocity[lane]);
  a.stress = project(out.shear_stress[lane], rig.outputs.second_shear_stress[lane]);
  a.stress_old = project(rig.trial[layout.shear_stress + lane],
                         layout.second_stress == TileLayout::kAbsent ? 0.0 : rig.trial[layout.second_stress + lane]);
  a.T0 = out.interface_temperature[lane];
  a.heat = out.friction_heat[lane];
  const double minus = project(in.stress_soft[lane], rig.inputs.second_stress_soft[lane]) / in.mass_soft[lane];
  const double plus = project(in.stress_hard[lane], rig.inputs.second_stress_hard[lane]) / in.mass_hard[lane];
  a.driven = dt * (minus + plus);
  a.driven_size = dt * (std::abs(minus) + std::abs(plus));
  a.per_stress = dt * (1 / in.mass_soft[lane] + 1 / in.mass_hard[lane]);
  a.plastic_drive = kSqrt3 * rig.model.options().grid.thickness * in.soft_plastic_strain_rate[lane];
  if (layout.junction_strain != TileLayout::kAbsent) a.junction_strain = rig.junction_strain(lane);
  if (layout.sticking != TileLayout::kAbsent) a.sticks = rig.committed[layout.sticking + lane] != 0.0;
  a.regime = out.regime[lane];
  a.outcome = out.outcome[lane];
  a.controlled = rig.model.options().tolerance.has_value();
  return a;
}

inline constexpr double kProductOfDenormals = 1e-290;  // products of denormal inputs have no relative accuracy

// ---- The laws ----

inline void require_numbers(const Answered& a) {
  require(!(a.outcome & kFailed), "no answer was found");
  require(std::isfinite(a.stress) && std::isfinite(a.slip) && std::isfinite(a.jump_new) && std::isfinite(a.T0) &&
              std::isfinite(a.heat),
          "not a number: s {}, [v] {}, [V] {}, T0 {}, heat {}", a.stress, a.slip, a.jump_new, a.T0, a.heat);
}

// 1: no temperature reaches melting that was below. `hottest` of the state before.
inline void require_solid(double T, double T_melt, double hottest, Figures& figures) {
  require(T < T_melt || T <= hottest * (1 + 1e-15), "T {:.17g} K, melting {:.17g} K, hottest before {:.17g} K", T,
          T_melt, hottest);
  figures.nearest_melting = std::min(figures.nearest_melting, std::abs(T_melt - T));
}

// 3: friction makes no energy.
inline void require_dissipation(const Answered& a) {
  require(a.stress * a.slip >= 0.0, "s [v] < 0: s {}, [v] {}", a.stress, a.slip);
  require(a.heat >= 0.0, "heat {} < 0", a.heat);
}

// 3: what entered is what is stored.
inline void require_heat_balance(double stored_before, double stored, double heat, Figures& figures) {
  require_near(stored - stored_before, heat, 1e-12 * stored, "stored heat against what entered");
  if (stored > 0.0) {
    figures.heat_residual = std::max(figures.heat_residual, std::abs(stored - stored_before - heat) / stored);
  }
}

// Of a second-order step heat and stress are those of two stages: what is answered at its end is not the whole.
inline bool of_two_stages(const ModelOptions& options, const Answered& a) {
  return options.time_integrator == TimeIntegrator::kSdirk2 && !(a.outcome & kFirstOrder);
}

// 3: heat in is the conducted share of the friction work.
inline void require_heat_of_work(const ModelOptions& options, double share, const Answered& a) {
  if (options.strategy == Strategy::kVelocityDriven) {
    if (a.in_parts() || of_two_stages(options, a)) return;
    const double work = std::max(0.0, a.stress * a.jump_old) * a.dt;
    const double least = options.taylor_quinney_factor.value_or(1.0) * share * work;
    const double noise = 1e-15 * std::abs(a.stress) * a.jump_length * a.dt + kProductOfDenormals;
    require(a.heat >= least * (1 - 1e-13) - noise && a.heat <= share * work * (1 + 1e-13) + noise,
            "heat {:.17g} of work {:.17g}, share {}", a.heat, work, share);
  } else if (!a.in_parts()) {
    const double work = a.stress * a.slip * a.dt;
    require_near(a.heat, share * work, 1e-13 * work + kProductOfDenormals, "heat against friction work");
  }
}

// Laws that temperature softens are held to between the limits of a temperature a few last digits colder and hotter:
// near melting that is all there is to hold to.
struct Limits {
  double lower, upper;
};

// What the interface can carry, whatever holds it.
inline Limits interface_limits(const ModelOptions& options, const Answered& a, double size) {
  const InterfaceOptions& law = options.interface;
  const Material soft = at_pressure(options.soft, a.pressure);
  // Junctions have hardened with the slip, which is known as well as the jumps it is a difference of.
  Limits strength{law.yield_strength, law.yield_strength};
  if (options.junctions) {
    const auto& [fraction, height, metal] = *options.junctions;
    const double grown = kDigits * size * a.dt / (kSqrt3 * height);
    strength = {fraction * hardened_strength(metal, std::max(0.0, a.junction_strain - grown)),
                fraction * hardened_strength(metal, a.junction_strain + grown)};
  }
  const auto limit = [&](double yield, double T) {
    const double mu = reference::friction_coefficient(options, a.pressure, T, std::abs(a.slip));
    return std::min(mu * a.pressure, yield * softening(soft, a.pressure, T).g / kSqrt3);
  };
  return {limit(strength.lower, a.T0 * (1 + kDigits)) * (1 - 1e-10),
          limit(strength.upper, a.T0 * (1 - kDigits)) * (1 + 1e-10)};
}

// What the last digit of the jumps, as heat, makes of T0 [K]: nothing, but for bodies of almost no mass.
inline double heat_grain(const ModelOptions& options, const Answered& a, double size) {
  const double flux = std::numeric_limits<double>::epsilon() * size * std::abs(a.stress);
  return flux * std::sqrt(options.soft.diffusivity * a.dt) / options.soft.conductivity;
}

// Bodies of almost no mass reach jumps of which the last digit melts the interface, or stresses that are less than what
// the last digit of T0 makes of its strength: nothing is resolved there.
inline bool is_resolved(const ModelOptions& options, const Answered& a, double size) {
  constexpr double kGrain = 1e-9;  // [K]
  constexpr double kShare = 1e-3;  // of the stress
  const Limits limit = interface_limits(options, a, size);
  return heat_grain(options, a, size) <= kGrain && limit.upper - limit.lower <= kShare * std::abs(a.stress);
}

// 2 and DLP (61): the jump obeys the momentum of the bodies, the interface its law.
inline void require_interface_law(const ModelOptions& options, const Answered& a, Figures& figures) {
  // Parts of a step may go to and fro, by as much as the host's zone drives them.
  const double size = a.size() + (a.in_parts() ? a.plastic_drive : 0.0);
  require_near(a.jump_new, a.jump_old + a.driven - a.stress * a.per_stress, 1e-13 * size + kProductOfDenormals,
               "[V] against (61)");
  if (a.pressure <= 0.0) {
    require(a.stress == 0.0, "an open contact carries {} Pa", a.stress);
    return;
  }
  const InterfaceOptions& law = options.interface;
  const double most_friction = std::max(law.friction_coefficient, law.friction_coefficient_fast) * a.pressure;
  const double carried = std::abs(a.stress);
  require(carried <= most_friction * (1 + 1e-12), "s {:.17g} above mu P {:.17g}", a.stress, most_friction);
  if (a.in_parts()) return;  // the mean of several answers
  if (options.plastic_layer && !is_resolved(options, a, a.size())) return;
  const Limits limit = interface_limits(options, a, a.size());
  // Of a second-order step s is the mean, and the limit moved: then only sense and stick are held here, the stresses
  // of the stages by the scalar twin.
  const bool mean = of_two_stages(options, a) && a.outcome == 0 && a.regime != Regime::kStick;
  if (!mean) {
    require(carried <= limit.upper, "s {:.17g} above its limit {:.17g} at T0 {:.17g}", a.stress, limit.upper, a.T0);
    if (limit.upper > 0.0) figures.over_limit = std::max(figures.over_limit, carried / limit.upper - 1.0);
  }
  if (options.plastic_layer && a.sticks) return;
  if (a.regime == Regime::kStick) {
    require(a.jump_new == 0.0, "an interface that sticks moves at {} m/s", a.jump_new);
    return;
  }
  require(mean || carried >= limit.lower, "slips under s {:.17g} below its limit {:.17g} at T0 {:.17g}", a.stress,
          limit.lower, a.T0);
  if (options.plastic_layer) return;
  require(a.stress * a.jump_new >= -1e-12 * carried * a.size(), "friction pulls past rest: s {}, [V] {}", a.stress,
          a.jump_new);
}

inline constexpr double kSleeperGrain = 1e-9;  // modes there and back leave so much of a temperature  [K]

// ---- The same and more for a lane of a rig, whose `trial` is the state before ----

// 1, 3, 5: temperatures in their range and falling from the interface where nothing else takes heat from it, heat and
// work balanced, no energy from friction.
inline void require_sound(const Rig& rig, const Answered& a, int lane, Figures& figures) {
  const ModelOptions& options = rig.model.options();
  const TileLayout& layout = rig.model.layout();
  require_numbers(a);
  const bool has_profile = layout.heat_modes == TileLayout::kAbsent;
  const double T_melt = at_pressure(options.soft, a.pressure).melting_temperature;
  const std::vector<double> before = rig.temperatures(rig.trial, lane), after = rig.temperatures(rig.committed, lane);
  const std::size_t interface = layout.num_hard_vertices;
  const double grain = rig.slept(lane) ? kSleeperGrain : 0.0;
  require(std::abs(a.T0 - after[interface]) <= grain, "T0 {:.17g} is not that of the state, {:.17g}", a.T0,
          after[interface]);
  double coldest = *std::min_element(before.begin(), before.end());
  if (!has_profile) coldest = std::min(coldest, rig.trial[layout.heat_modes + lane]);  // where it started
  const double hottest = *std::max_element(before.begin(), before.end());
  const bool falls_inwards = !options.hard_grid && options.time_integrator == TimeIntegrator::kBackwardEuler;
  for (std::size_t i = 0; i < after.size(); ++i) {
    const double T = after[i];
    const int vertex = static_cast<int>(i) - static_cast<int>(interface);
    require(T >= coldest - grain, "vertex {} cools to {:.17g} K, below all before ({:.17g} K)", vertex, T, coldest);
    if (i < interface) {  // the hard body melts elsewhere; but nowhere is hotter than it was somewhere, or than z = 0
      // Substeps were hotter in between; second order extrapolates, and overshoots by a few percent.
      const bool second_order = options.time_integrator == TimeIntegrator::kSdirk2;
      const double there_was = std::max(hottest, a.in_parts() || second_order ? std::max(T_melt, a.T0) : a.T0);
      require(T <= there_was * (second_order ? 1.1 : 1 + 1e-14) + grain,
              "vertex {} heats to {:.17g} K above all there was", vertex, T);
    } else {
      require_solid(T, T_melt, hottest + grain, figures);
    }
    require(i <= interface || !falls_inwards || T <= after[i - 1] * (1 + 1e-15) + grain,
            "T rises with z at vertex {}: {:.17g} K", vertex, T);
  }
  // With inertia the slip is that of the whole layer, whose stresses may have both signs.
  if (options.inertia) {
    require(a.heat >= 0.0, "heat {} < 0", a.heat);
  } else {
    require_dissipation(a);
  }
  // Without a profile only an insulated slab knows what it has: its mode of rate 0 keeps it all.
  if (has_profile || !HeatKernel(options.soft, options.grid).far_face_unfelt(options.modes->longest_time)) {
    require_heat_balance(rig.stored_heat_of(rig.trial, 0.0, lane), rig.stored_heat(0.0, lane), a.heat, figures);
  }
  require_heat_of_work(options, rig.conducted_share(), a);
}

inline std::vector<double> strain_before(const Rig& rig, int lane) {
  std::vector<double> ep(static_cast<std::size_t>(rig.model.grid().num_vertices()));
  for (std::size_t i = 0; i < ep.size(); ++i) ep[i] = rig.ep_of(rig.trial, static_cast<int>(i), lane);
  return ep;
}

// 2, 5: the layer never carries more than its flow stress, and exactly that where it flowed; strain never falls. Its
// temperatures are known to `grain` [K] beside their last digits.
inline void require_complementary_flow(const Rig& rig, const Answered& a, int lane, double grain, Figures& figures) {
  const ModelOptions& options = rig.model.options();
  const TileLayout& layout = rig.model.layout();
  const Material soft = at_pressure(options.soft, a.pressure);
  const std::vector<double> profile = rig.layer_temperatures(lane);
  for (int i = 0; i < rig.model.grid().num_vertices(); ++i) {
    const double carried =
        options.inertia ? std::abs(rig.committed[place(layout.shear_stress, i, lane)]) : std::abs(a.stress);
    const double ep = rig.ep(i, lane), ep_old = rig.ep_of(rig.trial, i, lane);
    require(ep >= ep_old, "ep falls at vertex {}: {:.17g} from {:.17g}", i, ep, ep_old);
    if (a.pressure <= 0.0) continue;
    // The rate of the step, or at most that of its last part, as well as a difference of strains tells it; slower than
    // Johnson and Cook's r0 the stress tells strains by their hardening alone, to its last digits.
    const double dep = a.parts() * (ep - ep_old);
    const double slope = is_johnson_cook(soft) && ep > 0.0 ? hardening_slope(soft, ep, 0.0, a.dt) : 0.0;
    const double noise = 4e-16 * ep + (slope > 0.0 ? kDigits * hardened_strength(soft, ep) / slope : 0.0);
    const double T = profile[static_cast<std::size_t>(i)];
    const auto limit = [&](double temperature, double increment) {
      return flow_stress(soft, ep, a.pressure, temperature, increment / a.dt) / kSqrt3;
    };
    const double most = limit(T * (1 - kDigits) - grain, dep + noise);
    require(carried <= most * (1 + 1e-10), "vertex {} carries {:.17g} Pa, its flow stress {:.17g}, T {:.17g}, ep {}", i,
            carried, most, T, ep);
    if (most > 0.0) figures.over_limit = std::max(figures.over_limit, carried / most - 1.0);
    // Strain resolves to an ulp of itself; a smaller step of it moved the limit by less than it can show.
    const bool held_by_friction = options.inertia && i == 0 && a.regime == Regime::kCoulomb;
    if (a.in_parts()) continue;  // it may have flowed in another part than the last
    if (ep <= ep_old * (1 + 1e-12) + 1e-15 || held_by_friction) continue;
    const double least = limit(T * (1 + kDigits) + grain, dep - noise);
    require(carried >= least * (1 - 1e-10),
            "vertex {} flows under {:.17g} Pa, its flow stress {:.17g}, T {:.17g}, ep {} from {}", i, carried, least, T,
            ep, ep_old);
  }
}

// sqrt(3) integral(dep) = w dt - h ds/G0 where the layer carries all the slip.
inline void require_slip_balance(const Rig& rig, const Answered& a, int lane) {
  const ModelOptions& options = rig.model.options();
  if (options.drive != Drive::kLayerShear || a.pressure <= 0.0 || a.regime == Regime::kCoulomb) return;
  if (a.in_parts() && a.stress_old * a.stress < 0.0) return;  // it may have flowed both ways
  if (a.in_parts() && options.friction_coefficient) return;   // the interface may have slipped in some of the parts
  const double h = options.grid.thickness;
  const double wanted = std::abs(a.jump_old) * a.dt + h * std::abs(a.stress_old) / options.soft.shear_modulus;
  const double elastic = h * (a.stress - a.stress_old) / options.soft.shear_modulus;
  const double direction = a.stress != 0.0 ? std::copysign(1.0, a.stress) : std::copysign(1.0, a.slip);
  const double plastic = direction * (rig.plastic_slip(lane) - rig.plastic_slip_of(rig.trial, lane));
  // Strains are told to their last digits; flow as closely as stress and temperatures are, which in parts of a step may
  // be larger, and nearer to melting, than at its end.
  const double share = a.in_parts() ? 1e-3 : 1e-9;
  const double stress = a.in_parts() ? std::max(std::abs(a.stress), std::abs(a.stress_old)) : a.stress;
  const double resolution = 1e-15 * rig.plastic_slip(lane) +
                            kSqrt3 * flow_grain(rig, strain_before(rig, lane), stress, lane, a.dt) +
                            kProductOfDenormals;
  require_near(plastic + elastic, a.jump_old * a.dt, share * wanted + resolution,
               "slip of the layer against the jump's");
  require_near(a.slip * a.dt, plastic, share * wanted + resolution, "[v] against the slip of the layer");
}

// A flowing layer: DLP (64) at the middle of the step where the interface slips, at its end where it sticks.
inline void require_flowing_slip(const Rig& rig, const Answered& a, int lane, Figures& figures) {
  if (a.pressure <= 0.0 || a.in_parts() || a.stress == 0.0) return;  // no stress: no direction
  const double d = std::copysign(1.0, a.stress);
  const double jump_old = d * a.jump_old, jump_new = d * a.jump_new;
  const double flow = (rig.plastic_slip(lane) - rig.plastic_slip_of(rig.trial, lane)) / a.dt;
  const double size = std::abs(jump_old) + std::abs(jump_new) + a.plastic_drive + flow + a.driven_size;
  const ModelOptions& options = rig.model.options();
  ++figures.flowing;
  if (!is_resolved(options, a, size)) return;
  ++figures.flowing_resolved;
  const double grain = heat_grain(options, a, size) + (rig.slept(lane) ? kSleeperGrain : 0.0);
  require_complementary_flow(rig, a, lane, grain, figures);
  double tolerance = 1e-9 * size + 1e-14 * rig.plastic_slip(lane) / a.dt +
                     kSqrt3 * flow_grain(rig, strain_before(rig, lane), a.stress, lane, a.dt, grain) / a.dt;
  if (a.sticks) {
    require_near(jump_new + a.plastic_drive, flow, tolerance, "(64) of an interface that sticks");
    require_near(d * a.slip, std::max(0.0, 0.5 * (jump_old - jump_new)), 1e-9 * size, "[v] of an interface that stops");
  } else {
    // The heat of the slip makes T0, T0 the stress, the stress the slip: in (61), and by the heat again.
    const Limits limit = interface_limits(options, a, size);
    tolerance += (limit.upper - limit.lower) * (a.per_stress + std::abs(a.slip / a.stress));
    require_near(d * a.slip, std::max(0.0, 0.5 * (jump_old + jump_new) + a.plastic_drive - flow), tolerance, "(64)");
    require(jump_new + a.plastic_drive - flow >= -tolerance, "friction pulls past rest: {} m/s",
            jump_new + a.plastic_drive - flow);
  }
}

// All of them on one lane of the step that the rig has just taken.
inline void require_invariants(const Rig& rig, int lane, double dt, Figures& figures) {
  const ModelOptions& options = rig.model.options();
  const Answered a = answered(rig, lane, dt);
  require_sound(rig, a, lane, figures);
  if (options.strategy == Strategy::kVelocityDriven) {
    require_complementary_flow(rig, a, lane, rig.slept(lane) ? kSleeperGrain : 0.0, figures);
    if (!options.inertia) require_slip_balance(rig, a, lane);
  } else {
    require_interface_law(options, a, figures);
    if (options.plastic_layer) require_flowing_slip(rig, a, lane, figures);
  }
  ++figures.node_steps;
  ++figures.in_regime[static_cast<std::size_t>(a.regime)];
  figures.divided += a.divided();
  figures.several += (a.outcome & kMultipleRoots) != 0;
}

}  // namespace shearbus::testing
