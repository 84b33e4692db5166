#include "server/physics/reference/advance_one.hpp"

#include <Eigen/SparseCore>
#include <Eigen/SparseLU>
#include <algorithm>
#include <cmath>
#include <functional>

#include "server/physics/layer/conduction.hpp"
#include "server/physics/material/strength.hpp"

namespace shearbus::physics::reference {
namespace {

constexpr int kScan = 4000;  // points in the search for sign changes

// The only zero of f in [lo, hi], f rising from negative. No tolerance: until no number lies between.
double bisect(const std::function<double(double)>& f, double lo, double hi) {
  for (;;) {
    const double mid = 0.5 * (lo + hi);
    if (mid <= lo || mid >= hi) return mid;
    (f(mid) < 0.0 ? lo : hi) = mid;
  }
}

// Backward Euler of dT/dt = alpha d2T/dz2 with -k dT/dz = q at z = 0 and an insulated far end: DLP (20-31).
std::vector<double> conduct(const HeatGrid& grid, const Material& soft, double dt, double flux,
                            const std::vector<double>& old) {
  const int n = grid.num_vertices();
  const double rho_c = soft.conductivity / soft.diffusivity;
  std::vector<Eigen::Triplet<double>> entries;
  Eigen::VectorXd rhs(n);
  for (int i = 0; i < n; ++i) {
    const double storage = rho_c * grid.weight[i] / dt;  // [W/(m2 K)]
    double diagonal = storage;
    if (i > 0) {
      entries.emplace_back(i, i - 1, -soft.conductivity / grid.width[i - 1]);
      diagonal += soft.conductivity / grid.width[i - 1];
    }
    if (i + 1 < n) {
      entries.emplace_back(i, i + 1, -soft.conductivity / grid.width[i]);
      diagonal += soft.conductivity / grid.width[i];
    }
    entries.emplace_back(i, i, diagonal);
    rhs[i] = storage * old[i] + (i == 0 ? flux : 0.0);
  }
  Eigen::SparseMatrix<double> matrix(n, n);
  matrix.setFromTriplets(entries.begin(), entries.end());
  Eigen::SparseLU<Eigen::SparseMatrix<double>> lu(matrix);
  const Eigen::VectorXd T = lu.solve(rhs);
  return {T.data(), T.data() + n};
}

// dep of one vertex under a stress magnitude, DLP (48) as printed.
double strain_increment(const Material& m, double a, double pressure, double T, double ep_old) {
  const double g = softening(m, pressure, T).g;
  if (a <= 0.0) return 0.0;
  if (g <= 0.0) return 1e100;
  const double hardened = std::pow(kSqrt3 * a / (m.yield_strength * g), 1.0 / m.hardening_exponent);
  return std::min(1e100, std::max(0.0, (hardened - 1.0) / m.hardening_coefficient - ep_old));
}

NodeOutputs velocity_driven(const ModelOptions& options, double dt, const NodeInputs& in, NodeState& state) {
  const Material& soft = options.soft;
  const Grid grid(options.grid);
  const HeatGrid heat_grid(grid, options.grid.far_boundary);
  const double h = options.grid.thickness;
  const double V = in.velocity_jump;
  const bool layer_shear = options.drive == Drive::kLayerShear;
  const double w = layer_shear ? V : h * in.soft_shear_rate;
  const std::vector<double> T_ad = conduct(heat_grid, soft, dt, 0.0, state.temperature);
  const std::vector<double> B = conduct(heat_grid, soft, dt, 1.0, std::vector<double>(T_ad.size(), 0.0));

  NodeOutputs out;
  out.velocity_jump_new = V;
  if (in.pressure <= 0.0) {
    state.temperature = T_ad;
    state.shear_stress = 0.0;
    state.regime = out.regime = Regime::kOpen;
    out.sliding_velocity = V;
    out.interface_temperature = T_ad[0];
    return out;
  }

  // Where the step starts from.
  double s_old = state.shear_stress;
  if (!layer_shear && V != 0.0 && s_old * V <= 0.0) {
    s_old = std::copysign(flow_stress(soft, state.plastic_strain[0], in.pressure, state.temperature[0]) / kSqrt3, V);
  }
  const double trial = s_old + soft.shear_modulus * dt * w / h;
  const double direction = (trial != 0.0 ? trial : V) < 0.0 ? -1.0 : 1.0;
  const double heating = heat_partition(soft, options.hard) * std::max(0.0, direction * V);
  const auto slip = [&](double a) {
    double sum = 0.0;
    for (int i = 0; i < grid.num_vertices(); ++i) {
      sum += grid.weight[i] *
             strain_increment(soft, a, in.pressure, T_ad[i] + heating * a * B[i], state.plastic_strain[i]);
    }
    return sum;
  };
  const double compliance = kSqrt3 * soft.shear_modulus / h;
  const auto balance = [&](double a) { return a - std::abs(trial) + (a > 0.0 ? compliance * slip(a) : 0.0); };

  // The three things that can hold the stress: the flow of the layer, Y_max at the hottest vertex, mu P.
  const double flowing = bisect(balance, 0.0, std::abs(trial) * 2.0);
  const double ceiling = bisect(
      [&](double a) {
        const double g = softening(soft, in.pressure, T_ad[0] + heating * a * B[0]).g;
        const double Y_max = soft.yield_strength_max;
        return g > 0.0 ? a - Y_max * g / kSqrt3 : 1.0;
      },
      0.0, std::abs(trial) * 2.0);
  const bool molten = softening(soft, in.pressure, T_ad[0]).g <= 0.0;  // the interface carries nothing at all
  double a = molten ? 0.0 : std::min({flowing, ceiling, std::abs(trial)});
  const bool coulomb = options.friction_coefficient && *options.friction_coefficient * in.pressure < a;
  if (coulomb) a = *options.friction_coefficient * in.pressure;

  const double flux = heating * a;
  double layer_slip = a > 0.0 ? slip(a) : 0.0;
  const double surplus = std::max(0.0, (std::abs(trial) - a) / compliance - layer_slip);
  for (int i = 0; i < grid.num_vertices() && a > 0.0; ++i) {
    state.plastic_strain[i] += strain_increment(soft, a, in.pressure, T_ad[i] + flux * B[i], state.plastic_strain[i]);
  }
  double interface_slip = 0.0;
  if (coulomb) {
    interface_slip = surplus;
  } else if (molten || ceiling < flowing) {
    state.plastic_strain[0] += surplus / grid.weight[0];
    layer_slip += surplus;
  }
  state.temperature = T_ad;
  for (std::size_t i = 0; i < B.size(); ++i) state.temperature[i] += flux * B[i];
  state.shear_stress = out.shear_stress = direction * a;
  out.friction_heat = flux * dt;
  out.interface_temperature = state.temperature[0];

  bool slips = layer_slip > 0.0 || interface_slip > 0.0;
  if (layer_shear) {
    out.sliding_velocity = direction * kSqrt3 * (layer_slip + interface_slip) / dt;
  } else if (V != 0.0 && direction * V > 0.0) {
    out.sliding_velocity = direction * std::max(0.0, direction * (V + w) - kSqrt3 * layer_slip / dt);
    slips = slips || out.sliding_velocity != 0.0;
  }
  out.regime = !slips                                                    ? Regime::kStick
               : coulomb                                                 ? Regime::kCoulomb
               : state.temperature[0] >= 0.99 * soft.melting_temperature ? Regime::kMelting
                                                                         : Regime::kTresca;
  state.regime = out.regime;
  return out;
}

NodeOutputs force_driven(const ModelOptions& options, double dt, const NodeInputs& in, NodeState& state) {
  const Material& soft = options.soft;
  const HeatGrid heat_grid(Grid(options.grid), options.grid.far_boundary);
  const std::vector<double> T_ad = conduct(heat_grid, soft, dt, 0.0, state.temperature);
  const std::vector<double> B = conduct(heat_grid, soft, dt, 1.0, std::vector<double>(T_ad.size(), 0.0));
  const double beta_T = heat_partition(soft, options.hard);

  // DLP (61).
  const double jump_free = in.velocity_jump + dt * (in.stress_minus / in.mass_minus + in.stress_plus / in.mass_plus);
  const double per_stress = dt * (1.0 / in.mass_minus + 1.0 / in.mass_plus);
  const double direction = jump_free < 0.0 ? -1.0 : 1.0;
  const auto jump_new = [&](double a) { return jump_free - direction * a * per_stress; };
  const auto slip = [&](double a) { return std::max(0.0, direction * 0.5 * (in.velocity_jump + jump_new(a))); };
  const auto T0 = [&](double a) { return T_ad[0] + B[0] * beta_T * a * slip(a); };
  // DLP (65).
  const double coulomb = options.interface.friction_coefficient * in.pressure;
  const auto yield = [&](double T) {
    return options.interface.yield_strength / kSqrt3 * softening(soft, in.pressure, T).g;
  };
  const auto spare = [&](double a) { return std::min(coulomb, yield(T0(a))) - a; };

  NodeOutputs out;
  double a = 0.0;
  if (in.pressure <= 0.0) {
    out.regime = Regime::kOpen;
    out.sliding_velocity = 0.5 * (in.velocity_jump + jump_free);
    out.velocity_jump_new = jump_free;
  } else {
    // Every stress between none and the one that sticks at which what the interface carries is what it is asked to
    // carry.
    const double a_stick = std::abs(jump_free) / per_stress;
    const double end = std::min(a_stick, std::min(coulomb, yield(T_ad[0])));
    std::vector<double> slips;
    double before = 0.0;
    for (int i = 1; i <= kScan; ++i) {
      const double at = end * i / kScan;
      if ((spare(before) > 0.0) != (spare(at) > 0.0)) {
        const double sign = spare(before) > 0.0 ? -1.0 : 1.0;
        slips.push_back(bisect([&](double x) { return sign * spare(x); }, before, at));
      }
      before = at;
    }
    const bool can_stick = spare(a_stick) >= 0.0;
    if (slips.empty() && !can_stick) slips.push_back(end);  // the limit itself, met without heating
    out.answers = static_cast<int>(slips.size()) + (can_stick ? 1 : 0);
    const bool stick = can_stick && (state.regime == Regime::kStick || slips.empty());
    a = stick ? a_stick : slips.empty() ? end : slips.front();
    out.sliding_velocity = direction * slip(a);
    out.velocity_jump_new = stick ? 0.0 : jump_new(a);
    const bool coulomb_acts = coulomb <= yield(T0(a));
    out.regime = stick                                      ? Regime::kStick
                 : coulomb_acts                             ? Regime::kCoulomb
                 : T0(a) >= 0.99 * soft.melting_temperature ? Regime::kMelting
                                                            : Regime::kTresca;
  }
  const double flux = in.pressure <= 0.0 ? 0.0 : beta_T * a * slip(a);
  state.temperature = T_ad;
  for (std::size_t i = 0; i < B.size(); ++i) state.temperature[i] += flux * B[i];
  out.shear_stress = state.shear_stress = direction * a;
  out.friction_heat = flux * dt;
  out.interface_temperature = state.temperature[0];
  state.regime = out.regime;
  return out;
}

// One way the step of a flowing layer may end.
struct Candidate {
  double stress, flux, slip;
  bool sticks;
};

// Everything DLP (48), (61), (64) and the interface law ask of the step of a flowing layer, said once per equation.
struct FlowingStep {
  FlowingStep(const ModelOptions& model_options, double step, const NodeInputs& inputs, const NodeState& state)
      : options(model_options), soft(options.soft), in(inputs), old(state), grid(options.grid), dt(step) {
    const HeatGrid heat_grid(grid, options.grid.far_boundary);
    T_ad = conduct(heat_grid, soft, dt, 0.0, state.temperature);
    B = conduct(heat_grid, soft, dt, 1.0, std::vector<double>(T_ad.size(), 0.0));
    jump_free = in.velocity_jump + dt * (in.stress_minus / in.mass_minus + in.stress_plus / in.mass_plus);
    per_stress = dt * (1.0 / in.mass_minus + 1.0 / in.mass_plus);
    const double leads = jump_free != 0.0 ? jump_free : old.shear_stress;
    direction = leads < 0.0 ? -1.0 : 1.0;
    drive = leads != 0.0 ? kSqrt3 * options.grid.thickness * in.soft_plastic_rate : 0.0;
    ceiling_strength = soft.hardening_coefficient > 0.0 ? soft.yield_strength_max
                                                        : std::min(soft.yield_strength, soft.yield_strength_max);
  }

  double T(int vertex, double q) const { return T_ad[vertex] + q * B[vertex]; }
  double jump_new(double a) const { return direction * jump_free - a * per_stress; }
  double jump_mid(double a) const { return 0.5 * (direction * in.velocity_jump + jump_new(a)); }
  double limit(double T0) const {  // of the interface
    return std::min(options.interface.friction_coefficient * in.pressure,
                    options.interface.yield_strength / kSqrt3 * softening(soft, in.pressure, T0).g);
  }
  double ceiling(double T0) const {  // of the layer
    const double g = softening(soft, in.pressure, T0).g;
    return g > 0.0 ? ceiling_strength / kSqrt3 * g : 0.0;
  }
  double flow(double a, double q) const {
    if (!(soft.hardening_coefficient > 0.0) || a <= 0.0) return 0.0;
    double sum = 0.0;
    for (int i = 0; i < grid.num_vertices(); ++i) {
      sum += grid.weight[i] * strain_increment(soft, a, in.pressure, T(i, q), old.plastic_strain[i]);
    }
    return kSqrt3 * sum / dt;  // [m/s]
  }
  double slip(double a, double q) const { return std::max(0.0, jump_mid(a) + drive - flow(a, q)); }
  double stopping_slip(double a) const { return std::max(0.0, 0.5 * (direction * in.velocity_jump - jump_new(a))); }

  const ModelOptions& options;
  const Material& soft;
  const NodeInputs& in;
  const NodeState& old;
  Grid grid;
  double dt;
  std::vector<double> T_ad, B;
  double jump_free, per_stress, direction, drive, ceiling_strength;
};

// The one stress at which the slip has ended by the end of the step.
Candidate stick_of(const FlowingStep& step, double beta_T) {
  const auto flux = [&](double a) { return beta_T * a * step.stopping_slip(a); };
  const double rigid = (std::abs(step.jump_free) + step.drive) / step.per_stress;
  const double most = bisect([&](double a) { return a - step.ceiling(step.T(0, flux(a))); }, 0.0, 2.0 * rigid + 1.0);
  const double a =
      bisect([&](double x) { return step.flow(x, flux(x)) - step.jump_new(x) - step.drive; }, 0.0, 2.0 * rigid + 1.0);
  const double stress = std::min(a, most);
  return {stress, flux(stress), step.stopping_slip(stress), true};
}

// Every slip: with the heat flux given, T0 is, and with it the stress; the slip must make that heat. Searched for on a
// scan of T0 that is fine near melting.
std::vector<Candidate> slips_of(const FlowingStep& step, double beta_T, double a_stick) {
  std::vector<double> fluxes;
  const double to_melting = step.soft.melting_temperature - step.T_ad[0];
  if (to_melting <= 0.0) return {};
  for (int i = 0; i < kScan / 8; ++i) {
    const double at = i / (kScan / 8.0);
    fluxes.push_back(to_melting * at / step.B[0]);
    fluxes.push_back(to_melting * (1.0 - std::exp(-30.0 * at)) / step.B[0]);
    fluxes.push_back(to_melting * std::exp(-40.0 * at) / step.B[0]);
  }
  std::sort(fluxes.begin(), fluxes.end());
  fluxes.erase(std::unique(fluxes.begin(), fluxes.end()), fluxes.end());
  const auto stress = [&](double q) { return std::min(step.limit(step.T(0, q)), step.ceiling(step.T(0, q))); };
  const auto balance = [&](double q) { return q - beta_T * stress(q) * step.slip(stress(q), q); };
  // At the ceiling the layer takes any slip: only mu P can make the interface slip beside it, at one temperature.
  const auto at_interface = [&](double q) { return step.limit(step.T(0, q)) <= step.ceiling(step.T(0, q)); };
  std::vector<Candidate> found;
  for (std::size_t i = 0; i + 1 < fluxes.size(); ++i) {
    const double lo = fluxes[i], hi = fluxes[i + 1];
    if (!at_interface(lo) || !(lo < hi)) continue;
    double q = -1.0;
    if (!at_interface(hi)) {
      const double top = bisect([&](double x) { return at_interface(x) ? -1.0 : 1.0; }, lo, hi);
      q = balance(top) <= 0.0 ? top : bisect(balance, lo, top);
      if (balance(lo) > 0.0) q = -1.0;
    } else if ((balance(lo) < 0.0 || (i == 0 && balance(lo) == 0.0)) != (balance(hi) < 0.0)) {
      const double sign = balance(lo) < 0.0 || i == 0 ? 1.0 : -1.0;
      q = i == 0 && balance(lo) == 0.0 ? 0.0 : bisect([&](double x) { return sign * balance(x); }, lo, hi);
    }
    if (q < 0.0 || stress(q) > a_stick) continue;  // it would have stuck before the step was over
    const double a = stress(q);
    found.push_back({a, q, a > 0.0 ? q / (beta_T * a) : step.slip(a, q), false});
  }
  return found;
}

NodeOutputs flowing_force_driven(const ModelOptions& options, double dt, const NodeInputs& in, NodeState& state) {
  const FlowingStep step(options, dt, in, state);
  const double beta_T = heat_partition(options.soft, options.hard);
  NodeOutputs out;
  if (in.pressure <= 0.0) {
    out.regime = state.regime = Regime::kOpen;
    out.sliding_velocity = 0.5 * (in.velocity_jump + step.jump_free);
    out.velocity_jump_new = step.jump_free;
    out.interface_temperature = step.T_ad[0];
    state.temperature = step.T_ad;
    state.shear_stress = 0.0;
    state.sticking = false;
    return out;
  }

  // 1. Every answer. A stuck interface sticks if it can; a slipping one goes on beside a layer that does not flow, and
  //    where that is none it sticks if it can.
  const Candidate stick = stick_of(step, beta_T);
  const bool can_stick = stick.stress <= step.limit(step.T(0, stick.flux)) * (1.0 + 1e-13);
  const std::vector<Candidate> slips = slips_of(step, beta_T, stick.stress);
  const bool rigid_slip = !slips.empty() && step.flow(slips.back().stress, slips.back().flux) == 0.0 &&
                          slips.back().stress <= step.ceiling(step.T(0, slips.back().flux)) * (1.0 + 1e-11);
  const bool molten = step.limit(step.T_ad[0]) <= 0.0;  // sticks to nothing
  const bool sticks = (can_stick && !molten && (state.sticking || !rigid_slip)) || slips.empty();
  const Candidate taken = sticks ? stick : slips.back();
  out.answers = sticks || rigid_slip ? 1 : static_cast<int>(slips.size());

  // 2. Strain, the surplus over (48) at z = 0 where the ceiling holds the stress.
  const double a = taken.stress;
  const double wanted = taken.sticks ? step.jump_new(a) + step.drive : step.jump_mid(a) + step.drive - taken.slip;
  const double surplus = std::max(0.0, (wanted - step.flow(a, taken.flux)) * dt / kSqrt3);
  const double T0 = step.T(0, taken.flux);
  const bool at_ceiling = a >= step.ceiling(T0) * (1.0 - 1e-9);
  bool flows = false;
  for (int i = 0; i < step.grid.num_vertices() && options.soft.hardening_coefficient > 0.0; ++i) {
    const double dep = strain_increment(options.soft, a, in.pressure, step.T(i, taken.flux), state.plastic_strain[i]);
    flows = flows || dep > 0.0;
    state.plastic_strain[i] += dep;
  }
  if (at_ceiling) {
    flows = flows || surplus > 0.0;
    state.plastic_strain[0] += surplus / step.grid.weight[0];
  }

  // 3. Upscale.
  for (std::size_t i = 0; i < step.B.size(); ++i) state.temperature[i] = step.T_ad[i] + taken.flux * step.B[i];
  state.shear_stress = out.shear_stress = step.direction * a;
  state.sticking = taken.sticks;
  out.sliding_velocity = step.direction * taken.slip;
  out.velocity_jump_new = step.jump_free - step.direction * a * step.per_stress;
  out.friction_heat = taken.flux * dt;
  out.interface_temperature = state.temperature[0];
  const bool melting = T0 >= 0.99 * options.soft.melting_temperature;
  const bool coulomb = options.interface.friction_coefficient * in.pressure <= step.limit(T0);
  out.regime = taken.sticks && !flows     ? Regime::kStick
               : !taken.sticks && coulomb ? Regime::kCoulomb
               : melting                  ? Regime::kMelting
                                          : Regime::kTresca;
  state.regime = out.regime;
  return out;
}

}  // namespace

NodeState initial_state(const ModelOptions& options) {
  const Grid grid(options.grid);
  const HeatGrid heat_grid(grid, options.grid.far_boundary);
  NodeState state;
  state.temperature.assign(heat_grid.num_vertices(), options.initial_temperature);
  state.plastic_strain.assign(grid.num_vertices(), 0.0);
  return state;
}

NodeOutputs advance_one(const ModelOptions& options, double dt, const NodeInputs& inputs, NodeState& state) {
  if (options.strategy == Strategy::kVelocityDriven) return velocity_driven(options, dt, inputs, state);
  return options.plastic_layer ? flowing_force_driven(options, dt, inputs, state)
                               : force_driven(options, dt, inputs, state);
}

}  // namespace shearbus::physics::reference
