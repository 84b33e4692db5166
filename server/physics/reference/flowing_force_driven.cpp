// Slow reference model of the force-driven step of a layer that flows plastically: it searches for all solutions, not
// only for the one that the fast solver would find.
#include <algorithm>
#include <cmath>

#include "server/physics/material/strength.hpp"
#include "server/physics/reference/parts.hpp"

namespace shearbus::physics::reference {
namespace {

// A candidate solution of the step of a flowing layer.
struct Candidate {
  double stress, flux, slip;
  bool sticks;
};

// The equations of the step of a flowing layer, one function each: DLP (48), (61), (64) and the interface law.
struct FlowingStep {
  FlowingStep(const ModelOptions& model_options, double step, const NodeInputs& inputs, const NodeState& state)
      : options(model_options), soft(options.soft), in(inputs), old(state), grid(options.grid), dt(step) {
    T_ad = conduct(options, dt, {}, profile_of(state));
    B = unit_response(options, dt, {}, T_ad);
    jump_free = in.velocity_jump + dt * (in.stress_soft / in.mass_soft + in.stress_hard / in.mass_hard);
    per_stress = dt * (1.0 / in.mass_soft + 1.0 / in.mass_hard);
    const double leads = jump_free != 0.0 ? jump_free : old.shear_stress;
    direction = leads < 0.0 ? -1.0 : 1.0;
    drive = leads != 0.0 ? kSqrt3 * options.grid.thickness * in.soft_plastic_strain_rate : 0.0;
    ceiling_strength = strength_ceiling(soft);
    T_melt = at_pressure(soft, in.pressure).melting_temperature;
  }

  double T(int vertex, double q) const { return T_ad[vertex] + q * B[vertex]; }
  int hottest(double q) const {
    int at = 0;
    for (int i = 1; i < grid.num_vertices(); ++i) at = T(i, q) > T(at, q) ? i : at;
    return at;
  }
  double jump_new(double a) const { return direction * jump_free - a * per_stress; }
  double jump_mid(double a) const { return 0.5 * (direction * in.velocity_jump + jump_new(a)); }
  double friction(double q) const { return friction_coefficient(options, in.pressure, T(0, q), 0.0) * in.pressure; }
  double limit(double q) const {  // stress limit of the interface under the heat flux q, DLP (65)  [Pa]
    return std::min(friction(q), options.interface.yield_strength / kSqrt3 * softening(soft, in.pressure, T(0, q)).g);
  }
  double ceiling(double q) const {  // stress that the fully hardened layer carries under the heat flux q  [Pa]
    const double g = softening(soft, in.pressure, T(hottest(q), q)).g;
    return g > 0.0 ? ceiling_strength / kSqrt3 * g : 0.0;
  }
  double flow(double a, double q) const {
    if (!hardens(soft) || a <= 0.0) return 0.0;
    double sum = 0.0;
    for (int i = 0; i < grid.num_vertices(); ++i) {
      sum += grid.weight[i] * strain_increment(soft, a, in.pressure, T(i, q), old.plastic_strain[i], dt);
    }
    return kSqrt3 * sum / dt;  // velocity jump across the layer by its plastic flow  [m/s]
  }
  double slip(double a, double q) const { return std::max(0.0, jump_mid(a) + drive - flow(a, q)); }
  double stopping_slip(double a) const { return std::max(0.0, 0.5 * (direction * in.velocity_jump - jump_new(a))); }

  const ModelOptions& options;
  const Material& soft;
  const NodeInputs& in;
  const NodeState& old;
  Grid grid;
  double dt;
  Profile T_ad, B;
  double jump_free, per_stress, direction, drive, ceiling_strength, T_melt;
};

// The sticking solution: the stress that stops the slip of the interface by the end of the step.
Candidate stick_of(const FlowingStep& step, double beta_T) {
  const auto flux = [&](double a) { return beta_T * a * step.stopping_slip(a); };
  const double rigid = (std::abs(step.jump_free) + step.drive) / step.per_stress;
  const double most = bisect([&](double a) { return a - step.ceiling(flux(a)); }, 0.0, 2.0 * rigid + 1.0);
  const double a =
      bisect([&](double x) { return step.flow(x, flux(x)) - step.jump_new(x) - step.drive; }, 0.0, 2.0 * rigid + 1.0);
  const double stress = std::min(a, most);
  return {stress, flux(stress), step.stopping_slip(stress), true};
}

// Appends heat fluxes up to the flux that melts the vertex, closely spaced near melting.
void scan_to_melting(const FlowingStep& step, int vertex, std::vector<double>& fluxes) {
  const double to_melting = step.T_melt - step.T_ad[vertex];
  for (int i = 0; i < kScan / 8 && to_melting > 0.0; ++i) {
    const double at = i / (kScan / 8.0);
    fluxes.push_back(to_melting * at / step.B[vertex]);
    fluxes.push_back(to_melting * (1.0 - std::exp(-30.0 * at)) / step.B[vertex]);
    fluxes.push_back(to_melting * std::exp(-40.0 * at) / step.B[vertex]);
  }
}

// All sliding solutions, by rising heat flux. The flux gives T0 and T0 gives the stress; the work of that stress must
// equal the flux.
std::vector<Candidate> slips_of(const FlowingStep& step, double beta_T, double a_stick) {
  if (step.limit(0.0) <= 0.0) return {{0.0, 0.0, step.slip(0.0, 0.0), false}};  // a molten interface: no stress
  const double melts = (step.T_melt - step.T_ad[0]) / step.B[0];
  std::vector<double> fluxes;
  scan_to_melting(step, 0, fluxes);
  if (step.hottest(0.0) > 0) scan_to_melting(step, step.hottest(0.0), fluxes);
  std::erase_if(fluxes, [&](double q) { return q >= melts; });
  std::sort(fluxes.begin(), fluxes.end());
  fluxes.erase(std::unique(fluxes.begin(), fluxes.end()), fluxes.end());
  const auto stress = [&](double q) { return std::min(step.limit(q), step.ceiling(q)); };
  const auto balance = [&](double q) { return q - beta_T * stress(q) * step.slip(stress(q), q); };
  // Under a stress equal to its ceiling the layer flows by any amount. The interface therefore slips only where its
  // stress limit is not above that ceiling.
  const auto at_interface = [&](double q) { return step.limit(q) <= step.ceiling(q); };
  std::vector<Candidate> found;
  const auto add = [&](double q) {
    if (stress(q) > a_stick) return;  // a_stick stops the slip exactly at the end of the step
    const double a = stress(q);
    found.push_back({a, q, a > 0.0 ? q / (beta_T * a) : step.slip(a, q), false});
  };
  for (std::size_t i = 0; i + 1 < fluxes.size(); ++i) {
    double lo = fluxes[i], hi = fluxes[i + 1];
    // Where limit and ceiling are equal, the interface slips and the layer flows.
    if (at_interface(lo) != at_interface(hi)) {
      const bool from_interface = at_interface(lo);
      const double both = bisect([&](double x) { return at_interface(x) == from_interface ? -1.0 : 1.0; }, lo, hi);
      if (balance(both) <= 0.0) add(both);
      (from_interface ? hi : lo) = both;
    } else if (!at_interface(lo)) {
      continue;
    }
    if (i == 0 && balance(lo) == 0.0) {
      if (balance(hi) >= 0.0) add(0.0);
    } else if ((balance(lo) < 0.0) != (balance(hi) < 0.0)) {
      const double sign = balance(lo) < 0.0 ? 1.0 : -1.0;
      add(bisect([&](double x) { return sign * balance(x); }, lo, hi));
    }
  }
  return found;
}

}  // namespace

NodeOutputs flowing_force_driven(const ModelOptions& options, double dt, const NodeInputs& in, NodeState& state) {
  const FlowingStep step(options, dt, in, state);
  const double beta_T = conducted_share(options);
  NodeOutputs out;
  if (in.pressure <= 0.0) {
    out.regime = state.regime = Regime::kOpen;
    out.sliding_velocity = 0.5 * (in.velocity_jump + step.jump_free);
    out.velocity_jump_new = step.jump_free;
    out.interface_temperature = step.T_ad[0];
    heat_up(state, step.T_ad, 0.0, step.B);
    state.shear_stress = 0.0;
    state.sticking = false;
    return out;
  }

  // 1. Find all solutions and choose one. An interface that sticks goes on sticking if it can. One that slips goes on
  //    slipping if the layer does not flow in that solution; otherwise it sticks if it can.
  const Candidate stick = stick_of(step, beta_T);
  const bool can_stick = stick.stress <= step.limit(stick.flux) * (1.0 + 1e-13);
  const std::vector<Candidate> slips = slips_of(step, beta_T, stick.stress);
  const auto rigid_under = [&](double a, double q) { return step.flow(a, q) == 0.0 && a <= step.ceiling(q); };
  const bool rigid_slip = !slips.empty() && rigid_under(slips.back().stress * (1.0 - 1e-11), slips.back().flux);
  const bool by_rounding = rigid_slip && !rigid_under(slips.back().stress * (1.0 + 1e-9), slips.back().flux);
  const bool molten = step.limit(0.0) <= 0.0;  // a molten interface cannot stick
  const bool sticks = (can_stick && !molten && (state.sticking || !rigid_slip)) || slips.empty();
  const Candidate taken = sticks ? stick : slips.back();
  out.answers = sticks || rigid_slip ? 1 : static_cast<int>(slips.size());
  if (by_rounding && can_stick && !state.sticking) out.answers = 2;  // rounding decides whether the node sticks

  // 2. Strain by DLP (48). If the stress is at the ceiling, the hottest vertex takes the rest of the plastic slip.
  const double a = taken.stress;
  const double wanted = taken.sticks ? step.jump_new(a) + step.drive : step.jump_mid(a) + step.drive - taken.slip;
  const double surplus = std::max(0.0, (wanted - step.flow(a, taken.flux)) * dt / kSqrt3);
  const bool at_ceiling = a >= step.ceiling(taken.flux) * (1.0 - 1e-9);
  const int hottest = step.hottest(taken.flux);
  bool flows = false;
  for (int i = 0; i < step.grid.num_vertices() && hardens(options.soft); ++i) {
    const double dep =
        strain_increment(options.soft, a, in.pressure, step.T(i, taken.flux), state.plastic_strain[i], dt);
    flows = flows || dep > 0.0;
    state.plastic_strain[i] += dep;
  }
  if (at_ceiling) {
    flows = flows || surplus > 0.0;
    state.plastic_strain[hottest] += surplus / step.grid.weight[hottest];
  }

  // 3. The answers to the host, and the new state.
  heat_up(state, step.T_ad, taken.flux, step.B);
  state.shear_stress = out.shear_stress = step.direction * a;
  state.sticking = taken.sticks;
  out.sliding_velocity = step.direction * taken.slip;
  out.velocity_jump_new = step.jump_free - step.direction * a * step.per_stress;
  out.friction_heat = taken.flux * dt;
  out.interface_temperature = state.temperature[0];
  const bool melting = state.temperature[taken.sticks ? hottest : 0] >= 0.99 * step.T_melt;
  const double friction = step.friction(taken.flux);
  const bool coulomb = friction > 0.0 && friction <= step.limit(taken.flux);
  out.regime = taken.sticks && !flows     ? Regime::kStick
               : !taken.sticks && coulomb ? Regime::kCoulomb
               : melting                  ? Regime::kMelting
                                          : Regime::kTresca;
  state.regime = out.regime;
  return out;
}

}  // namespace shearbus::physics::reference
