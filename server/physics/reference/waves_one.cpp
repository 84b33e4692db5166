// One step of one layer with inertia, in simple and slow code: the tests compare solver/velocity_driven/waves with it.
#include <Eigen/Dense>
#include <Eigen/SparseCholesky>
#include <Eigen/SparseCore>
#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>

#include "server/physics/interface/friction_laws.hpp"
#include "server/physics/material/flow_laws.hpp"
#include "server/physics/material/strength.hpp"
#include "server/physics/reference/parts.hpp"

namespace shearbus::physics::reference {
namespace {

struct Layer {
  const ModelOptions& options;
  Grid grid;
  double dt;
  NodeInputs in;
  std::vector<double> stress_old, strain_old, velocity_old;
  double drive = 0.0;  // force-driven: slip velocity due to the host's plastic shear  [m/s]
  Material soft = at_pressure(options.soft, in.pressure);
  double limit = std::numeric_limits<double>::infinity();  // the largest stress that the contact carries  [Pa]

  int cells() const { return grid.num_cells(); }
  // What has a velocity: force-driven the hard body, the cells and the mass of the host behind them, in a frame in which
  // the hard body rests before the step; else the cells alone, between velocities that are imposed.
  bool forced() const { return options.strategy == Strategy::kForceDriven; }
  int bodies() const { return cells() + (forced() ? 2 : 0); }
  double mass(int body) const {
    const int cell = forced() ? body - 1 : body;
    if (cell < 0) return in.mass_hard;
    return cell == cells() ? in.mass_soft - soft.density * grid.vertex.back() : soft.density * grid.width[cell];
  }
  // The bodies before and behind a vertex; -1 or bodies(): imposed.
  int before(int vertex) const { return forced() ? vertex : vertex - 1; }
  int behind(int vertex) const { return before(vertex) + 1; }
  double per_velocity(int vertex) const { return soft.shear_modulus * dt / grid.weight[vertex]; }
};

// Finds the zero of f in [lo, hi], where f falls from a value that is not negative, by false position; every third step
// bisects.
double zero_of_falling(const std::function<double(double)>& f, double lo, double hi) {
  double f_lo = f(lo), f_hi = f(hi);
  if (!(f_lo > 0.0)) return lo;
  if (f_hi >= 0.0) return hi;
  double kept = 0.0;
  for (int k = 1; k < 400 && hi - lo > 1e-15 * hi; ++k) {
    double at = k % 3 == 0 ? 0.5 * (lo + hi) : lo + (hi - lo) * (f_lo / (f_lo - f_hi));
    if (!(at > lo && at < hi)) at = 0.5 * (lo + hi);
    const double value = f(at);
    if (value == 0.0) return at;
    if (value > 0.0) {
      if (kept > 0.0) f_hi *= 0.5;
      lo = at, f_lo = value, kept = 1.0;
    } else {
      if (kept < 0.0) f_lo *= 0.5;
      hi = at, f_hi = value, kept = -1.0;
    }
  }
  return lo;
}

// Reduces the trial stress t, which the shear would cause without plastic flow, to the flow stress of a vertex: solves
// s + sqrt(3) G0 dep = t with s = Y(ep + dep, dep/dt)/sqrt(3). The result holds s, dep and ds/dt.
struct Kept {
  double stress, growth, slope;
};
Kept kept(const Layer& layer, int vertex, double t, double T) {
  const Material& m = layer.soft;
  const double ep = layer.strain_old[vertex];
  const double stiffness = kSqrt3 * m.shear_modulus;
  const auto yield = [&](double dep) {
    return flow_stress(m, ep + dep, layer.in.pressure, T, dep / layer.dt) / kSqrt3;
  };
  if (t <= yield(0.0)) return {t, 0.0, 1.0};
  const double lo = zero_of_falling([&](double dep) { return t - stiffness * dep - yield(dep); }, 0.0, t / stiffness);
  if (!properties_of(m.flow_law).has_wave_return) {
    const double more = 1e-6 * lo + 1e-12;
    const double rate = std::max(0.0, (yield(lo + more) - yield(lo)) / more);
    return {t - stiffness * lo, lo, rate / (rate + stiffness)};
  }
  // Derivative of Y/sqrt(3) with respect to dep at the dep found, by Steinberg's law; 0 at Y_max.
  const double hardened = 1.0 + m.hardening_coefficient * (ep + lo);
  const bool capped = m.yield_strength * std::pow(hardened, m.hardening_exponent) >= m.yield_strength_max;
  const double rate = capped ? 0.0 : yield(lo) * m.hardening_exponent * m.hardening_coefficient / hardened;
  return {t - stiffness * lo, lo, rate / (rate + stiffness)};
}

// An iterate of the balance of momentum of the layer; after the last iteration, the solution. It holds the velocity of
// each body and, for each vertex, the stress, the growth of the plastic strain in the step, and the derivative of the
// stress with respect to the trial stress (`slope`).
struct Solved {
  std::vector<double> velocity, stress, growth, slope;
  double interface_slip = 0.0;
};

// Computes from at.velocity the stress of every vertex, its plastic strain growth and `slope`, and the interface slip.
void look(const Layer& layer, const std::vector<double>& T, Solved& at) {
  for (int i = 0; i <= layer.cells(); ++i) {
    const int near = layer.before(i), far = layer.behind(i);
    const double before = near < 0 ? 0.0 : at.velocity[near];
    const double behind = far == layer.bodies() ? layer.in.velocity_jump : at.velocity[far];
    const double drive = i == layer.cells() ? layer.drive : 0.0;
    const double t = layer.stress_old[i] + layer.per_velocity(i) * (behind - before + drive);
    Kept keeps = kept(layer, i, std::abs(t), T[i]);
    if (i == 0) at.interface_slip = 0.0;
    if (i == 0 && keeps.stress > layer.limit) {
      // The vertex flows only until its strength is the limit of the contact; the other shear is slip.
      const double stiffness = kSqrt3 * layer.soft.shear_modulus;
      const auto carries = [&](double dep) {
        return flow_stress(layer.soft, layer.strain_old[0] + dep, layer.in.pressure, T[0], dep / layer.dt);
      };
      const double lo =
          zero_of_falling([&](double dep) { return kSqrt3 * layer.limit - carries(dep); }, 0.0, keeps.growth);
      const double slips = (std::abs(t) - layer.limit - stiffness * lo) / layer.per_velocity(0);
      at.interface_slip = std::copysign(slips, t);
      keeps = {layer.limit, lo, 0.0};
    }
    at.stress[i] = std::copysign(keeps.stress, t);
    at.growth[i] = keeps.growth;
    at.slope[i] = keeps.slope;
  }
}

// Residual of the balance of momentum of each body; of a cell c, rho width (v - v_old) / dt = s[c+1] - s[c], DLP (36).
Eigen::VectorXd residual(const Layer& layer, const Solved& at) {
  Eigen::VectorXd r(layer.bodies());
  for (int b = 0; b < layer.bodies(); ++b) {
    r[b] = -layer.mass(b) / layer.dt * (at.velocity[b] - layer.velocity_old[b]);
  }
  if (layer.forced()) {
    r[0] -= layer.in.stress_hard;
    r[layer.bodies() - 1] += layer.in.stress_soft;
  }
  for (int i = 0; i <= layer.cells(); ++i) {
    if (layer.before(i) >= 0) r[layer.before(i)] += at.stress[i];
    if (layer.behind(i) < layer.bodies()) r[layer.behind(i)] -= at.stress[i];
  }
  return r;
}

// At given temperatures the residual is -1/dt times the gradient of a convex energy. Newton's method minimises this
// energy; each step is cut to the lowest energy along its direction.
void balance(const Layer& layer, const std::vector<double>& T, Solved& at) {
  const int n = layer.bodies();
  look(layer, T, at);
  for (int iteration = 0; iteration < 1000; ++iteration) {
    std::vector<Eigen::Triplet<double>> entries;
    entries.reserve(5 * static_cast<std::size_t>(n));
    for (int b = 0; b < n; ++b) entries.emplace_back(b, b, layer.mass(b) / layer.dt);
    for (int i = 0; i <= layer.cells(); ++i) {
      const double k = at.slope[i] * layer.per_velocity(i);
      const int near = layer.before(i), far = layer.behind(i);
      if (near >= 0) entries.emplace_back(near, near, k);
      if (far < n) entries.emplace_back(far, far, k);
      if (near < 0 || far == n) continue;
      entries.emplace_back(near, far, -k);
      entries.emplace_back(far, near, -k);
    }
    Eigen::SparseMatrix<double> matrix(n, n);
    matrix.setFromTriplets(entries.begin(), entries.end());
    const Eigen::VectorXd step = Eigen::SimplicialLDLT<Eigen::SparseMatrix<double>>(matrix).solve(residual(layer, at));
    const std::vector<double> start = at.velocity;
    const auto slope_at = [&](double part) {
      for (int c = 0; c < n; ++c) at.velocity[c] = start[c] + part * step[c];
      look(layer, T, at);
      return -residual(layer, at).dot(step);
    };
    double size = std::abs(layer.in.velocity_jump);
    for (double v : start) size = std::max(size, std::abs(v));
    const double slope = slope_at(1.0);
    if (step.lpNorm<Eigen::Infinity>() <= 1e-11 * size) return;
    if (slope <= 0.0) continue;
    double lo = 0.0, hi = 1.0;
    for (int k = 0; k < 40; ++k) (slope_at(0.5 * (lo + hi)) > 0.0 ? hi : lo) = 0.5 * (lo + hi);
    slope_at(hi);
  }
}

// What a stage finds in addition to the state at its end.
struct Stage {
  double flux = 0.0;
  double slip_along[2] = {};  // flow and slip at z = 0 along positive and along negative stresses  [m]
  bool interface_slips = false;
  double interface_slip = 0.0;  // at the end, without the flow of the layer  [m/s]
};

// The largest stress that the contact carries, as its papers print it: friction, and the strength of junctions.
double limit_of_contact(const ModelOptions& options, double dt, const NodeInputs& in, const NodeState& old, double T0,
                        double slip) {
  const bool yields = options.strategy == Strategy::kForceDriven;  // an interface with a strength of its own, DLP (65)
  if (yields && !states_of(options.interface.friction_law).empty()) {
    // Slower than this share of what moves the bodies is rest, where a law with a state is asked for its friction.
    const double moves = std::abs(in.velocity_jump) + std::abs(host_shear(options, in)) +
                         dt * (std::abs(in.stress_soft) / in.mass_soft + std::abs(in.stress_hard) / in.mass_hard);
    slip = std::max(slip, 1e-8 * moves);
  }
  const double friction = friction_of(options, in.pressure, T0, slip, dt, old.friction_state);
  if (!options.junctions && !yields) return friction;
  return std::min(friction, interface_yield(options, in.pressure, T0, slip, dt, old.junction_strain));
}

// Backward Euler over dt from `state`, whose temperatures without friction would end at heat.T_ad. Work that heats in
// place is no heat here. `drive`: force-driven, slip velocity due to the host's plastic shear.
Stage advance_stage(const ModelOptions& options, double dt, const NodeInputs& in, const Heat& heat, NodeState& state,
                    double drive) {
  Layer layer{options, Grid(options.grid), dt, in, state.stress_field, state.plastic_strain, state.layer_velocity,
              drive};
  if (layer.forced()) layer.velocity_old.insert(layer.velocity_old.begin(), 0.0);
  const int n = layer.cells();
  Solved at{layer.velocity_old, state.stress_field, state.plastic_strain, state.plastic_strain};
  const double share = options.taylor_quinney_factor ? 0.0 : conducted_share(options);
  const auto limit = [&](double T0, double slip) { return limit_of_contact(options, dt, in, state, T0, slip); };
  const auto T0_of = [&](double q) { return heat.T_ad[0] + q * heat.B[0]; };
  const auto solve_at = [&](double q) {
    std::vector<double> T(n + 1);
    for (int i = 0; i <= n; ++i) T[i] = heat.T_ad[i] + q * heat.B[i];
    balance(layer, T, at);
    return share * std::max(0.0, at.stress[0] * in.velocity_jump) -
           q;  // heat flux that the stress at z = 0 releases, less the flux q that was assumed
  };
  Stage stage;
  const bool has_law = has_friction(options);
  const bool follows_slip =
      options.junctions || (has_law && properties_of(options.interface.friction_law).depends_on_slip());
  // The heat flux at which the layer is in balance, under a limit that the temperature gives, or without one.
  const auto solve_without_slip = [&](bool limited) {
    if (layer.forced()) {  // only slip heats
      layer.limit = std::numeric_limits<double>::infinity();
      stage.flux = 0.0;
      solve_at(0.0);
      return;
    }
    const auto released = [&](double q) {
      layer.limit = limited ? limit(T0_of(q), 0.0) : std::numeric_limits<double>::infinity();
      return solve_at(q);
    };
    stage.flux = 0.0;
    double hi = std::max(0.0, (at_pressure(options.soft, in.pressure).melting_temperature - heat.T_ad[0]) / heat.B[0]);
    if (!(released(0.0) > 0.0 && hi > 0.0)) return;
    double lo = 0.0;
    for (double mid = 0.5 * hi; mid > lo && mid < hi && hi - lo > 1e-15 * hi; mid = 0.5 * (lo + hi))
      (released(mid) > 0.0 ? lo : hi) = mid;
    stage.flux = lo;
    released(stage.flux);
  };
  const bool limit_is_known = !follows_slip && !layer.forced();
  solve_without_slip(limit_is_known);
  if (!limit_is_known) {
    // Under a given stress the heat is known, and the slip that waves and flow leave the interface falls with it.
    const double a_stick = std::abs(at.stress[0]);
    const double direction = std::signbit(at.stress[0]) ? -1.0 : 1.0;
    const double heats = share * std::max(0.0, direction * in.velocity_jump);
    const auto slip_under = [&](double a) {
      layer.limit = a;
      if (layer.forced() && share > 0.0) {
        // The heat is that of the slip, which falls with it.
        const double per_slip = share * a;
        const auto released = [&](double q) {
          solve_at(q);
          return per_slip * std::max(0.0, direction * at.interface_slip);
        };
        stage.flux = zero_of_falling([&](double q) { return released(q) - q; }, 0.0, released(0.0));
        const double made = released(stage.flux), slip = std::max(0.0, direction * at.interface_slip);
        if (made <= stage.flux * (1.0 + 1e-9)) return slip;
        // At this temperature the ceiling of the vertex at z = 0 is the limit: it takes what heats no more.
        const double own = stage.flux / per_slip;
        at.interface_slip = std::copysign(own, direction);
        at.growth[0] += (slip - own) * dt / (kSqrt3 * layer.grid.weight[0]);
        return own;
      }
      stage.flux = heats * a;
      solve_at(stage.flux);
      return std::max(0.0, direction * at.interface_slip);
    };
    const auto spare = [&](double a) {
      const double v = slip_under(a);
      return limit(T0_of(stage.flux), v) - a;
    };
    const bool can_stick = a_stick <= limit(T0_of(layer.forced() ? 0.0 : heats * a_stick), 0.0);
    bool slips = false;
    if (a_stick > 0.0 && !(can_stick && state.sticking)) {
      const double most = slip_under(0.0);
      // More stress leaves less slip. Where less slip carries no more, and more stress heats no less, only one stress is
      // what the contact carries.
      const bool several =
          (has_law && properties_of(options.interface.friction_law).falls_with_slip) || (layer.forced() && share > 0.0);
      double before = 0.0;
      const int points = several ? 100 : 1;
      for (int i = 1; i <= points; ++i) {
        const double now = a_stick * i / points;
        // Where the interface cannot stick it slips, however little.
        if (i == points ? !can_stick : spare(now) < 0.0) {
          const double a = zero_of_falling(spare, before, now);
          const double v = slip_under(a);
          slips = layer.forced() || v > 1e-8 * most;
          // Under its ceiling the layer flows by any amount: a contact that slip makes stronger slips until it carries as
          // much.
          if (const double T0 = T0_of(stage.flux); slips && limit(T0, v) > a * (1.0 + 1e-9)) {
            const double own = bisect([&](double slip) { return limit(T0, slip) - a; }, 0.0, v);
            slips = layer.forced() || own > 1e-8 * most;
            at.interface_slip = std::copysign(own, direction);
            at.growth[0] += (v - own) * dt / (kSqrt3 * layer.grid.weight[0]);
          }
          break;
        }
        before = now;
      }
    }
    if (!slips) solve_without_slip(false);
  }
  stage.interface_slips = at.interface_slip != 0.0;
  stage.interface_slip = std::abs(at.interface_slip);
  stage.slip_along[std::signbit(at.stress[0])] = stage.interface_slip * dt;
  for (int i = 0; i <= n; ++i) {
    stage.slip_along[std::signbit(at.stress[i])] += kSqrt3 * layer.grid.weight[i] * at.growth[i];
    state.plastic_strain[i] += at.growth[i];
  }
  heat_up(state, heat.T_ad, stage.flux, heat.B);
  state.stress_field = at.stress;
  state.layer_velocity = at.velocity;
  if (layer.forced()) {
    for (double& v : state.layer_velocity) v -= at.velocity[0];
    state.layer_velocity.erase(state.layer_velocity.begin());
  }
  return stage;
}

// The same with work that heats where it is done. The heat of a step goes where the step works next to the heat of the step
// before, less and less as a vertex melts, by the amount that makes it the work of the step.
Stage advance_heated_stage(const ModelOptions& options, double dt, const NodeInputs& in, const Heat& heat,
                           NodeState& state, double drive) {
  const Grid grid(options.grid);
  const int n = grid.num_vertices();
  const double T_melt = at_pressure(options.soft, in.pressure).melting_temperature;
  Eigen::MatrixXd G(n, n);  // the rise of each vertex by heat at each
  std::vector<Profile> responses;
  for (int j = 0; j < n; ++j) {
    std::vector<double> shape(n, 0.0);
    shape[j] = 1.0;
    responses.push_back(unit_response(options, dt, shape, heat.T_ad));
    for (int i = 0; i < n; ++i) G(i, j) = responses[j][i];
  }
  Eigen::VectorXd room(n), power = Eigen::VectorXd::Zero(n), warms, works(n);
  for (int i = 0; i < n; ++i) room[i] = T_melt - heat.T_ad[i];
  NodeState after;
  Stage stage;
  // The work that the step does with this amount of heat, less this heat.
  const auto surplus = [&](double amount) {
    Eigen::VectorXd at_rest = amount * power;
    for (int i = 0; i < n; ++i)
      if (!(room[i] > 1e-12 * T_melt)) at_rest[i] = 0.0;
    Eigen::VectorXd per_room, rise, left;  // what each vertex takes per kelvin that is left to melting  [W/(m2 K)]
    for (bool molten = true; molten;) {    // a vertex that its neighbours melt takes no heat
      per_room = (at_rest.array() > 0.0).select(at_rest.cwiseQuotient(room), 0.0);
      const Eigen::MatrixXd matrix = Eigen::MatrixXd::Identity(n, n) + G * per_room.asDiagonal();
      const Eigen::PartialPivLU<Eigen::MatrixXd> lu(matrix);
      rise = lu.solve(G * at_rest);
      left = lu.solve(room);
      molten = false;
      for (int i = 0; i < n; ++i) {
        if (!(at_rest[i] > 0.0 && rise[i] > room[i] * (1.0 + 1e-12))) continue;
        at_rest[i] = 0.0;
        molten = true;
      }
    }
    warms = per_room.cwiseProduct(left);
    Heat warm = heat;
    for (int i = 0; i < n; ++i) warm.T_ad.rows[heat.T_ad.interface + i] += rise[i];
    after = state;
    stage = advance_stage(options, dt, in, warm, after, drive);
    for (int i = 0; i < n; ++i) {
      const double flow = grid.weight[i] * (after.plastic_strain[i] - state.plastic_strain[i]);
      works[i] = *options.taylor_quinney_factor * kSqrt3 * std::abs(after.stress_field[i]) * flow / dt;
    }
    works[0] += std::abs(after.stress_field[0]) * stage.interface_slip;
    return works.sum() - warms.sum();
  };
  if (surplus(0.0) > 0.0) {
    // Where the work of the step is done next to the heat of the step before.
    const double before = works.sum();
    power = Eigen::Map<const Eigen::VectorXd>(state.heat_shape.data(), n);
    power = power.sum() > 0.0 ? Eigen::VectorXd(power * (before / power.sum())) : works;
    surplus(1.0);
    if (works.sum() > 0.0) power = works;
    const auto closed = [&] { return std::abs(works.sum() - warms.sum()) <= 1e-13 * warms.sum(); };
    // Where much heat is missing, the vertices that work now are heated, too: this decides where the heat goes.
    double enough = 1.0;
    for (int round = 0; round < 60; ++round) {
      const double missing = surplus(enough);
      if (missing <= 0.0) break;
      if (round < 6 && missing <= 0.5 * warms.sum()) {
        enough *= 1.0 + std::pow(2.0, round + 1) * missing / warms.sum();
      } else {
        power = power.cwiseMax(works);
        enough *= 4.0;
      }
    }
    // The amount lies between none and enough. Where work leaps over the heat, it is enough.
    const auto missing = [&](double amount) {
      const double lacks = surplus(amount);
      if (lacks <= 0.0) enough = amount;
      return closed() ? 0.0 : lacks;
    };
    if (!closed()) zero_of_falling(missing, 0.0, enough);
    if (!closed()) surplus(enough);
  }
  stage.flux = works.sum();
  for (int i = 0; stage.flux > 0.0 && i < n; ++i) after.heat_shape[i] = works[i] / stage.flux;
  Profile T = heat.T_ad;
  const double all = warms.sum();
  for (int j = 0; j < n; ++j)
    for (std::size_t i = 0; i < T.rows.size() && all > 0.0; ++i)
      T.rows[i] += stage.flux / all * warms[j] * responses[j].rows[i];
  heat_up(after, T, 0.0, heat.B);
  state = after;
  return stage;
}

// An open contact: the layer moves with the soft body without stress.
NodeOutputs open_contact(const ModelOptions& options, double dt, const NodeInputs& in, NodeState& state, bool sdirk2) {
  const Profile old = profile_of(state);
  NodeOutputs out = one_step(options, dt, in, state, heat_of_step(options, dt, state, old));
  if (sdirk2) out.first_order = !conducted_sdirk2(options, dt, in, old, state, out);
  std::fill(state.stress_field.begin(), state.stress_field.end(), 0.0);
  std::fill(state.layer_velocity.begin(), state.layer_velocity.end(), out.velocity_jump_new);
  return out;
}

}  // namespace

NodeOutputs with_inertia(const ModelOptions& options, double dt, const NodeInputs& in, NodeState& state, bool sdirk2) {
  if (in.pressure <= 0.0) return open_contact(options, dt, in, state, sdirk2);
  if (state.regime == Regime::kOpen) {
    std::fill(state.layer_velocity.begin(), state.layer_velocity.end(), in.velocity_jump);
  }
  const bool forced = options.strategy == Strategy::kForceDriven;
  double drive = 0.0;
  const double acceleration = in.stress_soft / in.mass_soft + in.stress_hard / in.mass_hard;
  if (forced) {
    // The host's jump is the mean velocity of the layer and the mass behind it.
    const Grid grid(options.grid);
    const int n = grid.num_cells();
    double momentum = (in.mass_soft - options.soft.density * grid.vertex.back()) * state.layer_velocity[n];
    for (int c = 0; c < n; ++c) momentum += options.soft.density * grid.width[c] * state.layer_velocity[c];
    for (double& v : state.layer_velocity) v += in.velocity_jump - momentum / in.mass_soft;
    drive = host_shear(options, in);
  }
  const Profile old = profile_of(state);
  const NodeState start = state;
  NodeOutputs out;
  Stage step;
  double mean = 0.0, mean_slip = 0.0;  // force-driven: of stress and slip at z = 0
  const auto signed_slip = [&](const Stage& of) { return std::copysign(of.interface_slip, state.stress_field[0]); };
  if (sdirk2) {
    // Alexander's stages: backward Euler over gamma dt from x_old to x1, then from x_old + (1/gamma - 1) (x1 - x_old).
    const Stage first =
        advance_stage(options, kGamma * dt, in, heat_of_step(options, kGamma * dt, state, old), state, drive);
    mean = (1.0 - kGamma) * state.stress_field[0];
    mean_slip = (1.0 - kGamma) * signed_slip(first);
    const Heat heat = heat_of_second_stage(options, dt, first.flux, old, state);
    out.first_order = !in_range(options, in.pressure, old, heat.T_ad);
    const double r = 1.0 / kGamma - 1.0;
    const auto extrapolate = [&](const std::vector<double>& before, std::vector<double>& values) {
      for (std::size_t i = 0; i < values.size(); ++i) values[i] = before[i] + r * (values[i] - before[i]);
    };
    extrapolate(start.plastic_strain, state.plastic_strain);
    extrapolate(start.stress_field, state.stress_field);
    extrapolate(start.layer_velocity, state.layer_velocity);
    if (out.first_order) {
      state = start;
    } else {
      step = advance_stage(options, kGamma * dt, in, heat, state, drive);
      mean += kGamma * state.stress_field[0];
      mean_slip += kGamma * signed_slip(step);
      step.flux = (1.0 - kGamma) * first.flux + kGamma * step.flux;
      for (int k = 0; k < 2; ++k) step.slip_along[k] += r * first.slip_along[k];
      if (forced && mean * mean_slip < 0.0) {  // the slip turns within the step
        out.first_order = true;
        state = start;
      }
    }
  }
  if (!sdirk2 || out.first_order) {
    const auto advance = options.taylor_quinney_factor ? advance_heated_stage : advance_stage;
    step = advance(options, dt, in, heat_of_step(options, dt, state, old), state, drive);
    mean = state.stress_field[0];
    mean_slip = signed_slip(step);
  }

  // The slip along s(0). Below 1 Pa, next to melting, rounding decides the sign of s(0): then it is the whole slip.
  double stress = state.stress_field[0];
  double slip = (stress > 0.0 ? step.slip_along[0] : -step.slip_along[1]) / dt;
  if (std::abs(stress) < 1.0) {
    slip = (step.slip_along[0] - step.slip_along[1]) / dt;
    if (slip * stress < 0.0) stress = 0.0;
  }
  const double hottest = *std::max_element(state.temperature.begin(),
                                           state.temperature.begin() + static_cast<int>(state.stress_field.size()));
  const double melting = at_pressure(options.soft, in.pressure).melting_temperature;
  out.friction_heat = step.flux * dt;
  out.interface_temperature = state.temperature[0];
  state.shear_stress = state.stress_field[0];
  out.shear_stress = stress;
  out.velocity_jump_new = in.velocity_jump;
  out.sliding_velocity = slip;
  const bool moves = forced ? step.slip_along[0] + step.slip_along[1] > 0.0 : slip != 0.0;
  if (forced) {
    out.shear_stress = mean;
    out.sliding_velocity = mean_slip;
    out.velocity_jump_new += dt * acceleration - mean * dt * (1.0 / in.mass_soft + 1.0 / in.mass_hard);
  }
  const double friction =
      friction_of(options, in.pressure, out.interface_temperature, step.interface_slip, dt, start.friction_state);
  const double carried = limit_of_contact(options, dt, in, start, out.interface_temperature, step.interface_slip);
  const bool rubs = step.interface_slips && !(carried < friction);
  if (options.junctions) state.junction_strain += dt * step.interface_slip / (kSqrt3 * options.junctions->height);
  state.friction_state = friction_state_after(options, in.pressure, step.interface_slip, dt, start.friction_state);
  state.sticking = step.interface_slip == 0.0;
  out.interface_slip = step.interface_slip;
  out.regime = state.regime = !moves                      ? Regime::kStick
                              : rubs                      ? Regime::kCoulomb
                              : hottest >= 0.99 * melting ? Regime::kMelting
                                                          : Regime::kTresca;
  return out;
}

}  // namespace shearbus::physics::reference
