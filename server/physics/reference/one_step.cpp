// One step of backward Euler without inertia and film, of either strategy, as one system in the stress magnitude a and
// the slip velocity v of the interface (MODEL.md, "Velocity-driven step", "Force-driven step"), slow and obvious:
//
//   slip      v = (what the host's line leaves at a) - D,   D = sqrt(3) integral(dep)/dt      DLP (37), (56), (61), (64)
//   flow      dep(a, T) by the flow law at each vertex; 0 in a rigid layer                            DLP (42)-(48)
//   heat      T = T_ad + q B + w B_phi: q at z = 0, w where the layer flowed in the step before       DLP (18)-(35)
//   contact   a <= lim(T0, v) and v (a - lim) = 0                                             DLP (5), (51)-(54), (65)
//
// The solver under test brackets one root. This file looks for all of them.
#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>

#include "server/physics/interface/friction_laws.hpp"
#include "server/physics/material/strength.hpp"
#include "server/physics/reference/parts.hpp"

namespace shearbus::physics::reference {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();

// A stress, the slip velocity of the interface under it, and the velocity that the flow of the layer takes.
struct Load {
  double a, v, flow;
};

struct Candidate {
  Load load;
  bool sticks;
};

struct OneStep {
  OneStep(const ModelOptions& model_options, double step, const NodeInputs& inputs, const NodeState& state,
          const Heat& heat_of_step)
      : options(model_options),
        soft(options.soft),
        in(inputs),
        old(state),
        grid(options.grid),
        dt(step),
        heat(heat_of_step),
        forced(options.strategy == Strategy::kForceDriven),
        flows(!forced || options.plastic_layer),
        turns_within(forced && flows && options.tolerance),
        share(conducted_share(options)),
        T_melt(at_pressure(soft, in.pressure).melting_temperature) {
    forced ? pull_by_forces() : shear_the_layer();
    if (forced && options.taylor_quinney_factor) B_work = unit_response(options, dt, old.heat_shape, heat.T_ad);
  }

  // The host's line, DLP (61): the jump that is left at the end of the step falls with the stress, and with it its mean.
  void pull_by_forces() {
    jump_free = in.velocity_jump + dt * (in.stress_soft / in.mass_soft + in.stress_hard / in.mass_hard);
    per_stress = dt * (1.0 / in.mass_soft + 1.0 / in.mass_hard);
    const double shear = host_shear(options, in), most = jump_free + shear;
    direction = (most != 0.0 ? most : old.shear_stress) < 0.0 ? -1.0 : 1.0;
    drive = direction * shear;
    a_trial = std::abs(most) / per_stress;
    if (!states_of(options.interface.friction_law).empty())
      least_slip = least_slip_of_law(direction * in.velocity_jump + drive, std::abs(most));
  }
  // The line of the layer's own elasticity, DLP (56): what the jump has not sheared elastically is flow and slip.
  void shear_the_layer() {
    const double h = options.grid.thickness, V = in.velocity_jump;
    const bool layer_shear = options.drive == Drive::kLayerShear;
    drive = layer_shear ? V : h * in.soft_shear_rate;
    // With INTERFACE_SLIP the stress starts at the yield stress along the jump, unless it is along the jump already.
    double s_old = old.shear_stress;
    if (!layer_shear && V != 0.0 && s_old * V <= 0.0)
      s_old = std::copysign(flow_stress(soft, old.plastic_strain[0], in.pressure, old.temperature[0]) / kSqrt3, V);
    const double trial = s_old + soft.shear_modulus * dt * drive / h;
    direction = (trial != 0.0 ? trial : V) < 0.0 ? -1.0 : 1.0;
    per_stress = h / (soft.shear_modulus * dt);
    a_trial = std::abs(trial);
  }

  // What the line leaves of the jump to slip and flow at the end of the step, and in its mean.
  double end(double a) const { return (a_trial - a) * per_stress; }
  double mean(double a) const {
    if (!forced) return end(a);
    if (turns_within) return travel(a).mean;
    return 0.5 * (direction * in.velocity_jump + direction * jump_free - a * per_stress) + drive;
  }
  // What the flow of a layer takes whose interface sticks: the end's share, or under a tolerance the mean.
  double to_flow(double a) const { return turns_within ? mean(a) : end(a); }
  double jump_new(double a) const {
    return turns_within ? direction * (travel(a).end - drive) : jump_free - direction * a * per_stress;
  }
  // An interface that sticks at the end of the step has slipped by what stops in it.
  Load stuck(double a) const { return slipping(a, forced && !turns_within ? std::max(0.0, mean(a) - end(a)) : 0.0); }

  // Under a tolerance: the path of the jump along the trial direction, pushed by the far stresses and slowed down by the
  // friction a, which may stop it. Then it rests, unless the far stresses are the larger.
  struct Path {
    double mean, net, end;  // mean speed, mean velocity, velocity at the end  [m/s]
  };
  Path travel(double a) const {
    const double push = direction * (jump_free - in.velocity_jump), start = direction * in.velocity_jump + drive;
    const double friction = per_stress * a;
    const bool forwards = start != 0.0 ? start > 0.0 : push > 0.0;
    const double last = start + push + (forwards ? -friction : friction);
    if (forwards ? last >= 0.0 : last <= 0.0) return {std::abs(0.5 * (start + last)), 0.5 * (start + last), last};
    const double stop = start / (start - last);  // time, in parts of the step
    const double after = std::abs(push) > friction ? push - std::copysign(friction, push) : 0.0;
    const double before = 0.5 * start * stop, back = 0.5 * after * (1.0 - stop) * (1.0 - stop);
    return {std::abs(before) + std::abs(back), before + back, after * (1.0 - stop)};
  }
  // The stress from which on the interface surely sticks.
  double rest_stress() const {
    if (!turns_within) return a_trial;
    return direction * in.velocity_jump + drive != 0.0 ? kInfinity : a_trial;
  }
  Load slipping(double a, double v) const { return {a, v, std::max(0.0, mean(a) - v)}; }

  // Friction heat at z = 0  [W/m2]. Velocity-driven the whole imposed jump heats, DLP (18), as `heat` distributes it.
  double flux(const Load& l) const {
    return share * l.a * (forced ? l.v : std::max(0.0, direction * in.velocity_jump));
  }
  double work(const Load& l) const { return B_work.rows.empty() ? 0.0 : l.a * l.flow; }
  double T(int i, const Load& l) const {
    return heat.T_ad[i] + flux(l) * heat.B[i] + (B_work.rows.empty() ? 0.0 : work(l) * B_work[i]);
  }
  int hottest(const Load& l) const {
    int at = 0;
    for (int i = 1; i < grid.num_vertices() && flows; ++i) at = T(i, l) > T(at, l) ? i : at;
    return at;
  }

  // The contact: friction, and the yield strength of the interface or of its junctions, DLP (49)-(54), (65).
  double junction_strain(double v) const {
    return options.junctions ? old.junction_strain + dt * v / (kSqrt3 * options.junctions->height) : 0.0;
  }
  double friction(const Load& l) const {
    return friction_of(options, in.pressure, T(0, l), std::max(l.v, least_slip), dt, old.friction_state);
  }
  double yield(double T0, double v) const {
    if (!forced && !options.junctions) return kInfinity;  // a velocity-driven interface yields as the layer does
    return interface_yield(options, in.pressure, T0, v, dt, old.junction_strain);
  }
  double limit(const Load& l) const { return std::min(friction(l), yield(T(0, l), l.v)); }
  bool follows_slip() const {
    return options.junctions ||
           (has_friction(options) && properties_of(options.interface.friction_law).depends_on_slip());
  }
  bool falls_with_slip() const {
    return has_friction(options) && properties_of(options.interface.friction_law).falls_with_slip;
  }
  // At 0 stress the interface is molten: it carries nothing, however it slips.
  bool molten() const { return limit(slipping(0.0, std::max(0.0, mean(0.0)))) <= 0.0; }

  // The layer: the stress that it carries when fully hardened, and its flow.
  double ceiling(const Load& l) const {
    if (!flows) return kInfinity;
    const double g = softening(soft, in.pressure, T(hottest(l), l)).g;
    return g > 0.0 ? strength_ceiling(soft) / kSqrt3 * g : 0.0;
  }
  double dep(int i, const Load& l) const {
    return strain_increment(soft, l.a, in.pressure, T(i, l), old.plastic_strain[i], dt);
  }
  double flow(const Load& l) const {
    if (!flows || !hardens(soft) || l.a <= 0.0) return 0.0;
    double sum = 0.0;
    for (int i = 0; i < grid.num_vertices(); ++i) sum += grid.weight[i] * dep(i, l);
    return kSqrt3 * sum / dt;
  }

  const ModelOptions& options;
  const Material& soft;
  const NodeInputs& in;
  const NodeState& old;
  Grid grid;
  double dt;
  const Heat& heat;
  bool forced, flows;
  bool turns_within;  // the jump may stop and turn within the step
  double share, T_melt;
  Profile B_work;
  double jump_free = 0.0, per_stress = 0.0, direction = 1.0, drive = 0.0, a_trial = 0.0;
  double least_slip = 0.0;  // for which a friction law with a state is asked
};

// The stress at which the interface sticks at the end of the step: flow takes all that the line leaves.
Candidate stick_of(const OneStep& step) {
  if (!step.flows) return {step.stuck(step.a_trial), true};
  double most = 2.0 * step.a_trial + (step.forced ? 1.0 : 0.0);
  const auto open = [&](double a) { return step.flow(step.stuck(a)) - step.to_flow(a); };
  while (step.turns_within && open(most) < 0.0 && most < 1e15) most *= 2.0;
  const double root = bisect(open, 0.0, most);
  const double ceiling = bisect([&](double a) { return a - step.ceiling(step.stuck(a)); }, 0.0, most);
  return {step.stuck(step.ceiling({}) > 0.0 ? std::min({root, ceiling, step.rest_stress()}) : 0.0), true};
}

// All slips next to a rigid layer, by rising stress: the stress gives the slip, and must be the limit under it.
std::vector<Candidate> slips_next_to_rigid(const OneStep& step, bool can_stick) {
  const auto at = [&](double a) { return step.slipping(a, std::max(0.0, step.mean(a))); };
  const auto spare = [&](double a) { return step.limit(at(a)) - a; };
  // A molten interface carries nothing, nor does one that does not slip under friction that vanishes at rest.
  if (!(spare(0.0) > 0.0)) return {{at(0.0), false}};
  const double most = step.yield(step.heat.T_ad[0], at(0.0).v);
  const double end = std::min(step.a_trial, step.falls_with_slip() ? most : std::min(step.friction(at(0.0)), most));
  std::vector<Candidate> found;
  double before = 0.0;
  for (int i = 1; i <= kScan; ++i) {
    const double now = end * i / kScan;
    if ((spare(before) > 0.0) != (spare(now) > 0.0)) {
      const double sign = spare(before) > 0.0 ? -1.0 : 1.0;
      found.push_back({at(bisect([&](double a) { return sign * spare(a); }, before, now)), false});
    }
    before = now;
  }
  if (found.empty() && !can_stick) found.push_back({at(end), false});
  return found;
}

// Slip velocities at which the search for slips looks, closely spaced where one of the vertices is near melting.
std::vector<double> velocities(const OneStep& step, double most) {
  std::vector<double> all{0.0, most};
  const auto add = [&](double q) {  // by the flux, with the limit at that temperature
    const double T0 = step.heat.T_ad[0] + q * step.heat.B[0];
    const double a = std::min(friction_of(step.options, step.in.pressure, T0, most, step.dt, step.old.friction_state),
                              step.yield(T0, 0.0));
    if (const double v = q / (step.share * a); v > 0.0 && v < most) all.push_back(v);
  };
  for (const int vertex : {0, step.hottest({})}) {
    const double to_melting = step.T_melt - step.heat.T_ad[vertex];
    for (int i = 0; i < kScan / 8 && to_melting > 0.0; ++i) {
      const double at = i / (kScan / 8.0);
      add(to_melting * at / step.heat.B[vertex]);
      add(to_melting * (1.0 - std::exp(-30.0 * at)) / step.heat.B[vertex]);
      add(to_melting * std::exp(-40.0 * at) / step.heat.B[vertex]);
      if (vertex == 0) all.push_back(most * at);
    }
    if (step.hottest({}) == 0) break;
  }
  std::sort(all.begin(), all.end());
  all.erase(std::unique(all.begin(), all.end()), all.end());
  return all;
}

// All slips next to a layer that may flow, by rising slip. The slip gives the stress, since the limit falls with the
// temperature; the flow under both must leave this slip.
std::vector<Candidate> slips_next_to_flow(const OneStep& step, double a_stick) {
  const double most = std::max(0.0, step.mean(0.0));
  const auto at = [&](double v) {
    return step.slipping(bisect([&](double a) { return a - step.limit(step.slipping(a, v)); }, 0.0, a_stick), v);
  };
  if (step.molten()) return {{step.slipping(0.0, most), false}};
  const auto open = [&](const Load& l) { return l.v + step.flow(l) - step.mean(l.a); };
  // Under a stress equal to its ceiling the layer flows by any amount. The interface therefore slips only where its
  // stress limit is not above that ceiling.
  // Nor does it where slip makes it stronger than the stress at which it sticks and the layer flows by any amount.
  constexpr double kAbove = 1.0 + 1e-11;
  const auto at_interface = [&](const Load& l) {
    const double ceiling = step.ceiling(l);
    return l.a <= ceiling && !(step.follows_slip() && ceiling <= l.a * kAbove && step.limit(l) > l.a * kAbove);
  };
  std::vector<Candidate> found;
  const auto add = [&](double v) {
    // a_stick stops the slip exactly at the end of the step
    if (const Load l = at(v); l.a < a_stick) found.push_back({l, false});
  };
  struct Point {
    double v;
    bool at_interface;
    double open;
  };
  const auto point = [&](double v) {
    const Load l = at(v);
    return Point{v, at_interface(l), open(l)};
  };
  const std::vector<double> scanned = velocities(step, most);
  Point next = point(scanned[0]);
  for (std::size_t i = 0; i + 1 < scanned.size(); ++i) {
    Point lo = next, hi = next = point(scanned[i + 1]);
    // Where limit and ceiling are equal, the interface slips and the layer flows.
    if (lo.at_interface != hi.at_interface) {
      const bool first = lo.at_interface;
      const Point both = point(bisect([&](double v) { return at_interface(at(v)) == first ? -1.0 : 1.0; }, lo.v, hi.v));
      if (both.open <= 0.0 && step.follows_slip())
        found.push_back({at(both.v), false});
      else if (both.open <= 0.0)
        add(both.v);
      (first ? hi : lo) = both;
    } else if (!lo.at_interface) {
      continue;
    }
    const bool below = lo.open < 0.0;
    if (i == 0 && !below) add(0.0);
    if (below == (hi.open < 0.0)) continue;
    add(bisect([&](double v) { return (below ? 1.0 : -1.0) * open(at(v)); }, lo.v, hi.v));
  }
  if (scanned.size() == 1) add(0.0);
  return found;
}

// Next to a rigid layer: an interface that rests, or one that cannot slip, sticks if it can.
Candidate choose_next_to_rigid(const OneStep& step, const Candidate& stick, NodeOutputs& out) {
  const bool can_stick = step.limit(stick.load) >= stick.load.a;
  const std::vector<Candidate> slips = slips_next_to_rigid(step, can_stick);
  out.answers = static_cast<int>(slips.size()) + (can_stick ? 1 : 0);
  const bool rests = step.old.regime == Regime::kStick || (step.falls_with_slip() && step.in.velocity_jump == 0.0);
  return can_stick && (rests || slips.empty()) ? stick : slips.front();
}

// Next to a layer that may flow: an interface that sticks goes on sticking if it can. One that slips goes on slipping if
// the layer does not flow in that answer; otherwise it sticks if it can.
Candidate choose_next_to_flow(const OneStep& step, const Candidate& stick, NodeOutputs& out) {
  const bool can_stick = stick.load.a <= step.limit(stick.load) * (1.0 + 1e-13);
  const std::vector<Candidate> slips = slips_next_to_flow(step, stick.load.a);
  const auto rigid_under = [&](Load l, double factor) {
    l.a *= factor;
    return step.flow(l) == 0.0 && l.a <= step.ceiling(l);
  };
  const bool rigid_slip = !slips.empty() && rigid_under(slips.back().load, 1.0 - 1e-11);
  const bool by_rounding = rigid_slip && !rigid_under(slips.back().load, 1.0 + 1e-9);
  const bool sticks = (can_stick && !step.molten() && (step.old.sticking || !rigid_slip)) || slips.empty();
  out.answers = sticks || rigid_slip ? 1 : static_cast<int>(slips.size());
  if (by_rounding && can_stick && !step.old.sticking) out.answers = 2;  // rounding decides whether the node sticks
  // Friction that returns as the slip falls may hold a node that slips, and so may a limit that follows the slip.
  if (step.follows_slip() && slips.size() + (can_stick ? 1 : 0) > 1) out.answers = 2;
  return sticks ? stick : slips.back();
}

// Velocity-driven: the layer carries the jump up to the limit of the interface, past which it slips by what elastic shear
// and flow leave. An interface that sticks goes on sticking if it can, another takes the answer with the most slip.
Candidate choose_velocity_driven(const OneStep& step, const Candidate& stick) {
  const auto under = [&](double a) { return step.slipping(a, std::max(0.0, step.mean(a) - step.flow({a, 0.0, 0.0}))); };
  const bool jump_is_slip = step.options.drive == Drive::kInterfaceSlip;
  const double known = jump_is_slip ? std::abs(step.in.velocity_jump) : 0.0;
  const bool can_stick = stick.load.a <= step.limit({stick.load.a, known, 0.0});
  const auto spare = [&](double a) {
    return step.limit({a, jump_is_slip || !step.follows_slip() ? known : under(a).v, 0.0}) - a;
  };
  if (jump_is_slip || !step.follows_slip()) {
    if (can_stick) return stick;
    return {under(bisect([&](double a) { return -spare(a); }, 0.0, stick.load.a)), false};
  }
  if (can_stick && step.old.sticking) return stick;
  // A slip that is lost in the digits of the jump is none.
  const auto slides = [&](double lo, double hi) {
    Candidate found{under(bisect([&](double a) { return -spare(a); }, lo, hi)), false};
    // Under its ceiling the layer flows by any amount: a contact that slip makes stronger slips until it carries as much.
    if (const double a = found.load.a;
        a >= step.ceiling(found.load) * (1.0 - 1e-9) && step.limit({a, found.load.v, 0.0}) > a * (1.0 + 1e-9))
      found.load = step.slipping(a, bisect([&](double v) { return step.limit({a, v, 0.0}) - a; }, 0.0, found.load.v));
    return found.load.v > 1e-8 * under(0.0).v ? found : stick;
  };
  double before = 0.0;
  for (int i = 1; i <= kScan; ++i) {
    const double now = stick.load.a * i / kScan;
    const bool ends = i == kScan && !can_stick;  // the interface slips however little
    if (ends || (i < kScan && spare(now) < 0.0)) return slides(before, now);
    before = now;
  }
  return stick;
}

// A force-driven step changes suddenly where heat lowers the limit of slip that was slower or colder before, or where
// the slip turns: two opposite stresses act then, of friction as in the step or after half the heat of the slip before.
bool changes_suddenly(const OneStep& step, const Candidate& taken, double jump_new) {
  const NodeInputs& in = step.in;
  const Load& l = taken.load;
  const auto limit = [&](double T0) {
    const double v = std::max(l.v, step.least_slip);
    return std::min(friction_of(step.options, in.pressure, T0, v, step.dt, step.old.friction_state),
                    step.yield(T0, l.v));
  };
  const double T_ad = step.heat.T_ad[0];
  const double allowed = 0.1 * std::max(std::abs(in.velocity_jump), std::abs(step.jump_free));
  const double cold = limit(T_ad);
  const double moved = std::max(std::abs(jump_new - in.velocity_jump),
                                step.per_stress * std::abs(l.a - std::abs(step.old.shear_stress)));
  bool sudden = step.per_stress * (std::min(cold, step.a_trial) - l.a) > allowed && moved > allowed;
  if (in.velocity_jump * step.jump_free >= 0.0) return sudden;
  const double size = std::abs(in.velocity_jump), far = size + std::abs(step.jump_free);
  const double held = taken.sticks ? cold : l.a;
  const double half_heated = limit(T_ad + step.heat.B[0] * step.share * l.a * 0.5 * size);
  for (const double friction : {held, std::min(held, half_heated)}) {
    const double slows = far + step.per_stress * friction, speeds_up = far - step.per_stress * friction;
    const double turned = slows > size && speeds_up > 0.0 ? (1.0 - size / slows) * speeds_up : -1.0;
    sudden = sudden || (turned >= 0.0 && std::abs(turned - step.direction * jump_new) > allowed);
  }
  return sudden;
}

NodeOutputs open_contact(const OneStep& step, NodeState& state) {
  NodeOutputs out;
  const double V = step.in.velocity_jump;
  out.regime = state.regime = Regime::kOpen;
  out.sliding_velocity = step.forced ? 0.5 * (V + step.jump_free) : V;
  out.velocity_jump_new = step.forced ? step.jump_free : V;
  out.interface_temperature = step.heat.T_ad[0];
  heat_up(state, step.heat.T_ad, 0.0, step.heat.B);
  state.shear_stress = 0.0;
  state.sticking = false;
  state.friction_state =
      friction_state_after(step.options, 0.0, std::abs(out.sliding_velocity), step.dt, state.friction_state);
  return out;
}

// Plastic strain by the flow law; at the ceiling the hottest vertex takes the rest. Returns the plastic slip  [m].
double strain_layer(const OneStep& step, const Candidate& taken, NodeState& state) {
  if (!step.flows) return 0.0;
  const Load& l = taken.load;
  const std::vector<double> before = state.plastic_strain;
  double slip = step.flow(l) * step.dt / kSqrt3;
  if (slip > 0.0)
    for (int i = 0; i < step.grid.num_vertices(); ++i) state.plastic_strain[i] += step.dep(i, l);
  const double wanted = taken.sticks ? step.to_flow(l.a) : step.mean(l.a) - l.v;
  const double surplus = std::max(0.0, wanted * step.dt / kSqrt3 - slip);
  if (l.a >= step.ceiling(l) * (1.0 - 1e-9)) {
    state.plastic_strain[step.hottest(l)] += surplus / step.grid.weight[step.hottest(l)];
    slip += surplus;
  }
  // Where the work of the next step becomes heat. Velocity-driven slip of the interface heats z = 0 through the shape.
  if (!step.options.taylor_quinney_factor) return slip;
  const double at_interface = step.forced ? 0.0 : l.v * step.dt / kSqrt3;
  if (const double all = slip + at_interface; all > 0.0) {
    for (int i = 0; i < step.grid.num_vertices(); ++i)
      state.heat_shape[i] =
          *step.options.taylor_quinney_factor * step.grid.weight[i] * (state.plastic_strain[i] - before[i]) / all;
    state.heat_shape[0] += at_interface / all;
  }
  return slip;
}

// The sliding velocity that a velocity-driven step answers.
double velocity_driven_slip(const OneStep& step, const Load& l, double layer_slip) {
  const double V = step.in.velocity_jump, d = step.direction;
  if (step.options.drive == Drive::kLayerShear) return d * (kSqrt3 * layer_slip / step.dt + l.v);
  if (V == 0.0 || d * V <= 0.0) return 0.0;
  return d * std::max(0.0, d * (V + step.drive) - kSqrt3 * layer_slip / step.dt);
}

}  // namespace

NodeOutputs one_step(const ModelOptions& options, double dt, const NodeInputs& in, NodeState& state, const Heat& heat) {
  const NodeState old = state;
  const OneStep step(options, dt, in, old, heat);
  if (in.pressure <= 0.0) return open_contact(step, state);

  // 1. All answers, and the one that the rules of MODEL.md choose.
  NodeOutputs out;
  const Candidate stick = stick_of(step);
  const Candidate taken = !step.forced ? choose_velocity_driven(step, stick)
                          : step.flows ? choose_next_to_flow(step, stick, out)
                                       : choose_next_to_rigid(step, stick, out);

  // 2. The new state.
  const Load& l = taken.load;
  const double share_of_work = std::accumulate(old.heat_shape.begin(), old.heat_shape.end(), 0.0);
  const double layer_slip = strain_layer(step, taken, state);
  Profile T = step.heat.T_ad;
  if (step.work(l) > 0.0)
    for (std::size_t i = 0; i < T.rows.size(); ++i) T.rows[i] += step.work(l) * step.B_work.rows[i];
  heat_up(state, T, step.flux(l), step.heat.B);
  state.shear_stress = step.direction * l.a;
  state.sticking = taken.sticks;
  const double v = options.drive == Drive::kInterfaceSlip && !step.forced ? std::abs(in.velocity_jump) : l.v;
  state.junction_strain = step.junction_strain(v);
  state.friction_state = friction_state_after(options, in.pressure, v, dt, old.friction_state);

  // 3. The answers to the host.
  if (step.turns_within) state.shear_stress = (step.jump_free - step.jump_new(l.a)) / step.per_stress;
  out.shear_stress = state.shear_stress;
  out.interface_slip = v;
  out.sliding_velocity = step.forced ? step.direction * l.v : velocity_driven_slip(step, l, layer_slip);
  out.velocity_jump_new = !step.forced ? in.velocity_jump : taken.sticks && !step.flows ? 0.0 : step.jump_new(l.a);
  const bool by_shape = !step.forced && options.taylor_quinney_factor;
  out.friction_heat = dt * (step.flux(l) * (by_shape ? share_of_work : 1.0) + step.work(l) * share_of_work);
  out.interface_temperature = state.temperature[0];
  const double friction = step.friction({l.a, v, l.flow});
  const bool coulomb = friction > 0.0 && friction <= step.yield(T.rows.empty() ? 0.0 : step.T(0, l), v);
  const bool melting = step.T(taken.sticks ? step.hottest(l) : 0, l) >= 0.99 * step.T_melt;
  const bool at_rest = step.forced ? layer_slip == 0.0 : layer_slip == 0.0 && out.sliding_velocity == 0.0;
  out.regime = state.regime = taken.sticks && at_rest    ? Regime::kStick
                              : !taken.sticks && coulomb ? Regime::kCoulomb
                              : melting                  ? Regime::kMelting
                                                         : Regime::kTresca;
  if (step.turns_within) {
    const OneStep::Path path = step.travel(l.a);
    if (path.mean > 0.0) out.sliding_velocity *= path.net / path.mean;
    if (path.end == 0.0) {
      state.sticking = true;
      out.regime = state.regime = Regime::kStick;
    }
  }
  if (step.forced && !step.flows) out.sudden = changes_suddenly(step, taken, out.velocity_jump_new);
  return out;
}

}  // namespace shearbus::physics::reference
