#include "server/physics/reference/advance_one.hpp"

#include <Eigen/SparseCore>
#include <Eigen/SparseLU>
#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>

#include "server/physics/interface/friction_laws.hpp"
#include "server/physics/layer/conduction.hpp"
#include "server/physics/material/strength.hpp"
#include "server/physics/reference/parts.hpp"

namespace shearbus::physics::reference {

double bisect(const std::function<double(double)>& f, double lo, double hi) {
  for (;;) {
    const double mid = 0.5 * (lo + hi);
    if (mid <= lo || mid >= hi) return mid;
    (f(mid) < 0.0 ? lo : hi) = mid;
  }
}

namespace {

HeatGrid heat_grid_of(const ModelOptions& options) {
  const Grid layer(options.grid);
  if (!options.hard_grid) return HeatGrid(layer, options.grid.far_boundary);
  return HeatGrid(layer, options.grid.far_boundary, Grid(*options.hard_grid), options.hard_grid->far_boundary);
}

}  // namespace

double conducted_share(const ModelOptions& options) {
  return options.hard_grid ? 1.0 : heat_partition(options.soft, options.hard);
}

Profile profile_of(const NodeState& state) {
  Profile profile{state.hard_temperature, state.hard_temperature.size()};
  profile.rows.insert(profile.rows.end(), state.temperature.begin(), state.temperature.end());
  return profile;
}

void heat_up(NodeState& state, const Profile& T_ad, double flux, const Profile& B) {
  std::vector<double> T = T_ad.rows;
  for (std::size_t i = 0; i < T.size(); ++i) T[i] += flux * B.rows[i];
  const auto at_interface = T.begin() + static_cast<std::ptrdiff_t>(T_ad.interface);
  state.hard_temperature.assign(T.begin(), at_interface);
  state.temperature.assign(at_interface, T.end());
}

namespace {

// T at the end of a step with flux q: T_ad + q B.
struct Heat {
  Profile T_ad, B;
};

// The rows of a node without profile, read as those before z = 0 and z = 0 itself: HeatModes' list, K's own integral.
Heat heat_of_modes(const ModelOptions& options, double dt, double early, double early_flux, const Profile& old) {
  const HeatModes modes(HeatKernel(options.soft, options.grid), *options.modes);
  const std::size_t last = old.rows.size() - 1;
  Heat heat{old, {std::vector<double>(old.rows.size(), 0.0), last}};
  double T0 = old.rows[0];
  for (std::size_t j = 0; j < modes.rate.size(); ++j) {
    // Integrals over the step of exp(-rate s) times s / ((1 - early) dt), the share of q_early, and times the rest
    // of 1.
    const long double x = static_cast<long double>(modes.rate[j]) * dt;
    const long double mean = x > 0.0L ? -std::expm1(-x) / x : 1.0L;
    const long double moment = x > 1e-7L ? (mean - std::exp(-x)) / x : 0.5L - x / 3.0L;
    const long double gain = static_cast<long double>(modes.weight[j]) * dt;
    const double first = early > 0.0 ? static_cast<double>(gain * moment / (1.0L - early)) : 0.0;
    const double second = static_cast<double>(gain * mean) - first;
    heat.T_ad.rows[j + 1] = old.rows[j + 1] * std::exp(-modes.rate[j] * dt);
    T0 += heat.T_ad.rows[j + 1];
    heat.T_ad.rows[j + 1] += first * early_flux;
    heat.B.rows[j + 1] = second;
  }
  const double early_T0 = early > 0.0 ? modes.kernel.moment(dt) / ((1.0 - early) * dt) : 0.0;
  heat.T_ad.rows[last] = T0 + early_T0 * early_flux;
  heat.B.rows[last] = modes.kernel.integral(dt) - early_T0;
  return heat;
}

}  // namespace

Profile conduct(const ModelOptions& options, double dt, const std::vector<double>& sources, const Profile& old) {
  const HeatGrid grid = heat_grid_of(options);
  const int n = grid.num_vertices();
  std::vector<Eigen::Triplet<double>> entries;
  Eigen::VectorXd rhs(n);
  for (int i = 0; i < n; ++i) {
    const double storage = grid.capacity(i, options.soft, options.hard) / dt;  // [W/(m2 K)]
    double diagonal = storage;
    if (i > 0) {
      const double k = (i <= grid.interface ? options.hard : options.soft).conductivity;
      entries.emplace_back(i, i - 1, -k / grid.width[i - 1]);
      diagonal += k / grid.width[i - 1];
    }
    if (i + 1 < n) {
      const double k = (i < grid.interface ? options.hard : options.soft).conductivity;
      entries.emplace_back(i, i + 1, -k / grid.width[i]);
      diagonal += k / grid.width[i];
    }
    entries.emplace_back(i, i, diagonal);
    const int vertex = i - grid.interface;
    rhs[i] = storage * old.rows[i] + (vertex >= 0 && vertex < static_cast<int>(sources.size()) ? sources[vertex] : 0.0);
  }
  Eigen::SparseMatrix<double> matrix(n, n);
  matrix.setFromTriplets(entries.begin(), entries.end());
  Eigen::SparseLU<Eigen::SparseMatrix<double>> lu(matrix);
  const Eigen::VectorXd T = lu.solve(rhs);
  return {{T.data(), T.data() + n}, static_cast<std::size_t>(grid.interface)};
}

Profile unit_response(const ModelOptions& options, double dt, const std::vector<double>& shape, const Profile& like) {
  return conduct(options, dt, shape.empty() ? std::vector<double>{1.0} : shape,
                 {std::vector<double>(like.rows.size(), 0.0), like.interface});
}

namespace {

Heat heat_of_step(const ModelOptions& options, double dt, const NodeState& state, const Profile& old) {
  if (options.modes) return heat_of_modes(options, dt, 0.0, 0.0, old);
  const Profile T_ad = conduct(options, dt, {}, old);
  return {T_ad, unit_response(options, dt, state.heat_shape, T_ad)};
}

// The second stage of SDIRK2 from the rows the first one ended with.
constexpr double kGamma = 0.29289321881345254;
Heat heat_of_second_stage(const ModelOptions& options, double dt, double early_flux, const Profile& old,
                          const NodeState& early) {
  if (options.modes) return heat_of_modes(options, dt, kGamma, early_flux, old);
  Profile from = profile_of(early);
  for (std::size_t i = 0; i < from.rows.size(); ++i)
    from.rows[i] = old.rows[i] + (1.0 - kGamma) / kGamma * (from.rows[i] - old.rows[i]);
  return heat_of_step(options, kGamma * dt, early, from);
}

bool in_range(const ModelOptions& options, double pressure, const Profile& old, const Profile& T) {
  if (options.modes) return T[0] < at_pressure(options.soft, pressure).melting_temperature;
  const auto [lowest, highest] = std::minmax_element(T.rows.begin(), T.rows.end());
  return *highest < at_pressure(options.soft, pressure).melting_temperature &&
         *lowest >= *std::min_element(old.rows.begin(), old.rows.end()) * (1.0 - 1e-12);
}

}  // namespace

double strain_increment(const Material& m, double a, double pressure, double T, double ep_old, double dt) {
  const double g = softening(m, pressure, T).g;
  if (a <= 0.0) return 0.0;
  if (g <= 0.0) return 1e100;
  if (m.flow_law == FlowLaws::place<JohnsonCook>()) {
    const auto missing = [&](double log_dep) {
      const double dep = std::exp(log_dep);
      const double rate = 1.0 + m.rate_coefficient * std::log(std::max(1.0, dep / (dt * m.reference_strain_rate)));
      return (m.yield_strength + m.hardening_modulus * std::pow(ep_old + dep, m.hardening_exponent)) * rate * g -
             kSqrt3 * a;
    };
    constexpr double kLeast = -690.0, kMost = 230.0;
    return missing(kLeast) >= 0.0 ? 0.0 : missing(kMost) <= 0.0 ? 1e100 : std::exp(bisect(missing, kLeast, kMost));
  }
  const double hardened = std::pow(kSqrt3 * a / (m.yield_strength * g), 1.0 / m.hardening_exponent);
  return std::min(1e100, std::max(0.0, (hardened - 1.0) / m.hardening_coefficient - ep_old));
}

namespace {

NodeOutputs velocity_driven(const ModelOptions& options, double dt, const NodeInputs& in, NodeState& state,
                            const Heat& heat) {
  const Material& soft = options.soft;
  const Grid grid(options.grid);
  const double h = options.grid.thickness;
  const double V = in.velocity_jump;
  const bool layer_shear = options.drive == Drive::kLayerShear;
  const double w = layer_shear ? V : h * in.soft_shear_rate;
  const Profile &T_ad = heat.T_ad, &B = heat.B;

  NodeOutputs out;
  out.velocity_jump_new = V;
  if (in.pressure <= 0.0) {
    heat_up(state, T_ad, 0.0, B);
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
  const double heating = conducted_share(options) * std::max(0.0, direction * V);
  const auto slip = [&](double a) {
    double sum = 0.0;
    for (int i = 0; i < grid.num_vertices(); ++i) {
      sum += grid.weight[i] *
             strain_increment(soft, a, in.pressure, T_ad[i] + heating * a * B[i], state.plastic_strain[i], dt);
    }
    return sum;
  };
  const double compliance = kSqrt3 * soft.shear_modulus / h;
  const auto balance = [&](double a) { return a - std::abs(trial) + (a > 0.0 ? compliance * slip(a) : 0.0); };

  // The three things that can hold the stress: the flow of the layer, Y_max at the hottest vertex, mu P.
  const double flowing = bisect(balance, 0.0, std::abs(trial) * 2.0);
  const auto weakest_g = [&](double a) {
    double g = std::numeric_limits<double>::infinity();
    for (int i = 0; i < grid.num_vertices(); ++i) {
      g = std::min(g, softening(soft, in.pressure, T_ad[i] + heating * a * B[i]).g);
    }
    return g;
  };
  const double ceiling = bisect(
      [&](double a) {
        const double g = weakest_g(a);
        return g > 0.0 ? a - strength_ceiling(soft) * g / kSqrt3 : 1.0;
      },
      0.0, std::abs(trial) * 2.0);
  const bool molten = weakest_g(0.0) <= 0.0;  // a vertex carries nothing at all
  double a = molten ? 0.0 : std::min({flowing, ceiling, std::abs(trial)});
  const bool coulomb = options.friction_coefficient && *options.friction_coefficient * in.pressure < a;
  if (coulomb) a = *options.friction_coefficient * in.pressure;

  const double flux = heating * a;
  const std::vector<double> ep_old = state.plastic_strain;
  double layer_slip = a > 0.0 ? slip(a) : 0.0;
  const double surplus = std::max(0.0, (std::abs(trial) - a) / compliance - layer_slip);
  int hottest = 0;
  for (int i = 1; i < grid.num_vertices(); ++i) {
    if (T_ad[i] + flux * B[i] > T_ad[hottest] + flux * B[hottest]) hottest = i;
  }
  for (int i = 0; i < grid.num_vertices() && a > 0.0; ++i) {
    state.plastic_strain[i] +=
        strain_increment(soft, a, in.pressure, T_ad[i] + flux * B[i], state.plastic_strain[i], dt);
  }
  double interface_slip = 0.0;
  if (coulomb) {
    interface_slip = surplus;
  } else if (molten || ceiling < flowing) {
    state.plastic_strain[hottest] += surplus / grid.weight[hottest];
    layer_slip += surplus;
  }
  heat_up(state, T_ad, flux, B);
  state.shear_stress = out.shear_stress = direction * a;
  out.friction_heat = flux * dt;
  out.interface_temperature = state.temperature[0];
  if (options.taylor_quinney_factor) {
    out.friction_heat *= std::accumulate(state.heat_shape.begin(), state.heat_shape.end(), 0.0);
    if (const double all = layer_slip + interface_slip; all > 0.0) {
      for (int i = 0; i < grid.num_vertices(); ++i) {
        state.heat_shape[i] =
            *options.taylor_quinney_factor * grid.weight[i] * (state.plastic_strain[i] - ep_old[i]) / all;
      }
      state.heat_shape[0] += interface_slip / all;
    }
  }

  bool slips = layer_slip > 0.0 || interface_slip > 0.0;
  if (layer_shear) {
    out.sliding_velocity = direction * kSqrt3 * (layer_slip + interface_slip) / dt;
  } else if (V != 0.0 && direction * V > 0.0) {
    out.sliding_velocity = direction * std::max(0.0, direction * (V + w) - kSqrt3 * layer_slip / dt);
    slips = slips || out.sliding_velocity != 0.0;
  }
  out.regime = !slips    ? Regime::kStick
               : coulomb ? Regime::kCoulomb
               : state.temperature[hottest] >= 0.99 * at_pressure(soft, in.pressure).melting_temperature
                   ? Regime::kMelting
                   : Regime::kTresca;
  state.regime = out.regime;
  return out;
}

// DLP (65).
struct InterfaceLaw {
  const ModelOptions& options;
  double pressure;
  double limit(double T0) const {
    const double yield = options.interface.yield_strength / kSqrt3 * softening(options.soft, pressure, T0).g;
    return std::min(options.interface.friction_coefficient * pressure, yield);
  }
};

// SDIRK2 of a node that slips one way from the start to the end of the step, with the stresses s1 and s2 of its stages;
// nothing where it does not.
bool force_driven_sdirk2(const ModelOptions& options, double dt, const NodeInputs& in, NodeState& state,
                         NodeOutputs& out) {
  const InterfaceLaw law{options, in.pressure};
  const double beta_T = conducted_share(options);
  const Profile old = profile_of(state);
  const double acceleration = in.stress_minus / in.mass_minus + in.stress_plus / in.mass_plus;
  const double mobility = 1.0 / in.mass_minus + 1.0 / in.mass_plus;
  const double V = in.velocity_jump;
  const double direction = (V != 0.0 ? V : acceleration) < 0.0 ? -1.0 : 1.0;
  const auto jump = [&](double t, double s) { return direction * (V + t * acceleration) - t * s * mobility; };

  NodeState early = state;
  const Heat first = heat_of_step(options, kGamma * dt, state, old);
  double s1 = 0.0, s2 = 0.0, q1 = 0.0, q2 = 0.0, mean = 0.0, slip = 0.0;
  const bool open = in.pressure <= 0.0;
  bool rests = false;
  if (!open) {
    if (jump(kGamma * dt, 0.0) < 0.0 || jump(dt, 0.0) < 0.0) return false;
    const double stick = jump(kGamma * dt, 0.0) / (kGamma * dt * mobility);
    const auto T0 = [&](double s) { return first.T_ad[0] + first.B[0] * beta_T * s * jump(kGamma * dt, s); };
    if (law.limit(T0(stick)) >= stick) {  // at rest, or a stop, which is a kink
      if (V != 0.0) return false;
      rests = true;
      mean = s1 = s2 = stick;
    } else {
      s1 = bisect([&](double s) { return s - law.limit(T0(s)); }, 0.0, stick);
      q1 = beta_T * s1 * jump(kGamma * dt, s1);
    }
  }
  heat_up(early, first.T_ad, q1, first.B);
  const Heat second = heat_of_second_stage(options, dt, q1, old, early);
  if (!in_range(options, in.pressure, old, second.T_ad)) return false;
  if (open) {
    slip = 0.5 * (direction * V + jump(dt, 0.0));
  } else if (!rests) {
    const double stick = jump(dt, 0.0) / (dt * mobility);
    const auto mean_of = [&](double s) { return (1.0 - kGamma) * s1 + kGamma * s; };
    const auto slip_of = [&](double s) { return 0.5 * (direction * V + jump(dt, mean_of(s))); };
    const auto q2_of = [&](double s) { return (beta_T * mean_of(s) * slip_of(s) - (1.0 - kGamma) * q1) / kGamma; };
    const auto spare = [&](double s) { return law.limit(second.T_ad[0] + second.B[0] * q2_of(s)) - s; };
    const double end = (stick - (1.0 - kGamma) * s1) / kGamma;  // stops at the end of the step
    if (spare(end) >= 0.0) return false;
    s2 = bisect([&](double s) { return -spare(s); }, 0.0, end);
    q2 = q2_of(s2);
    mean = mean_of(s2);
    slip = slip_of(s2);
  }
  Profile T = second.T_ad;
  for (std::size_t i = 0; i < T.rows.size(); ++i) T.rows[i] += q2 * second.B.rows[i];
  if (!in_range(options, in.pressure, old, T)) return false;
  heat_up(state, second.T_ad, q2, second.B);
  out.shear_stress = state.shear_stress = direction * mean;
  out.sliding_velocity = direction * slip;
  out.velocity_jump_new = rests ? 0.0 : direction * jump(dt, mean);
  out.friction_heat = dt * ((1.0 - kGamma) * q1 + kGamma * q2);
  out.interface_temperature = state.temperature[0];
  const double coulomb = options.interface.friction_coefficient * in.pressure;
  out.regime = state.regime =
      open                                                                                        ? Regime::kOpen
      : rests                                                                                     ? Regime::kStick
      : coulomb <= law.limit(state.temperature[0])                                                ? Regime::kCoulomb
      : state.temperature[0] >= 0.99 * at_pressure(options.soft, in.pressure).melting_temperature ? Regime::kMelting
                                                                                                  : Regime::kTresca;
  return true;
}

NodeOutputs velocity_driven_sdirk2(const ModelOptions& options, double dt, const NodeInputs& in, NodeState& state) {
  const Profile old = profile_of(state);
  NodeState early = state;
  const Heat first = heat_of_step(options, kGamma * dt, state, old);
  const double q1 = velocity_driven(options, kGamma * dt, in, early, first).friction_heat / (kGamma * dt);
  const Heat second = heat_of_second_stage(options, dt, q1, old, early);
  if (!in_range(options, in.pressure, old, second.T_ad)) {
    NodeOutputs out = velocity_driven(options, dt, in, state, heat_of_step(options, dt, state, old));
    out.first_order = true;
    return out;
  }
  NodeOutputs out = velocity_driven(options, dt, in, state, second);
  out.friction_heat = (1.0 - kGamma) * dt * q1 + kGamma * out.friction_heat;
  return out;
}

NodeOutputs force_driven(const ModelOptions& options, double dt, const NodeInputs& in, NodeState& state) {
  const Material& soft = options.soft;
  const Heat heat = heat_of_step(options, dt, state, profile_of(state));
  const Profile &T_ad = heat.T_ad, &B = heat.B;
  const double beta_T = conducted_share(options);

  // DLP (61).
  const double jump_free = in.velocity_jump + dt * (in.stress_minus / in.mass_minus + in.stress_plus / in.mass_plus);
  const double per_stress = dt * (1.0 / in.mass_minus + 1.0 / in.mass_plus);
  const double direction = jump_free < 0.0 ? -1.0 : 1.0;
  const auto jump_new = [&](double a) { return jump_free - direction * a * per_stress; };
  const auto slip = [&](double a) { return std::max(0.0, direction * 0.5 * (in.velocity_jump + jump_new(a))); };
  const auto T0 = [&](double a) { return T_ad[0] + B[0] * beta_T * a * slip(a); };
  // DLP (65), or with (5)'s friction.
  const InterfaceOptions& law = options.interface;
  const bool weakens = law.friction_law == FrictionLaws::place<VelocityWeakening>();
  const auto coulomb = [&](double a) {
    if (!weakens) return law.friction_coefficient * in.pressure;
    const double fast = law.friction_coefficient_fast;
    return (fast + (law.friction_coefficient - fast) * std::exp(-law.velocity_decay * slip(a))) * in.pressure;
  };
  // DLP (49-54): ep_a grows with the slip it resists.
  const auto junction_strain = [&](double v) {
    return options.junctions ? state.junction_strain + dt * v / (kSqrt3 * options.junctions->height) : 0.0;
  };
  const auto strength = [&](double v) {
    if (!options.junctions) return law.yield_strength;
    const Material& m = options.junctions->metal;
    return options.junctions->contact_fraction *
           std::min(
               m.yield_strength_max,
               m.yield_strength * std::pow(1.0 + m.hardening_coefficient * junction_strain(v), m.hardening_exponent));
  };
  const auto yield = [&](double T, double v) { return strength(v) / kSqrt3 * softening(soft, in.pressure, T).g; };
  const auto spare = [&](double a) { return std::min(coulomb(a), yield(T0(a), slip(a))) - a; };

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
    const double most = yield(T_ad[0], slip(0.0));
    const double end = std::min(a_stick, weakens ? most : std::min(coulomb(0.0), most));
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
    const bool rests = state.regime == Regime::kStick || (weakens && in.velocity_jump == 0.0);
    const bool stick = can_stick && (rests || slips.empty());
    a = stick ? a_stick : slips.empty() ? end : slips.front();
    out.sliding_velocity = direction * slip(a);
    out.velocity_jump_new = stick ? 0.0 : jump_new(a);
    const bool coulomb_acts = coulomb(a) <= yield(T0(a), slip(a));
    out.regime = stick                                                                ? Regime::kStick
                 : coulomb_acts                                                       ? Regime::kCoulomb
                 : T0(a) >= 0.99 * at_pressure(soft, in.pressure).melting_temperature ? Regime::kMelting
                                                                                      : Regime::kTresca;
  }
  const double flux = in.pressure <= 0.0 ? 0.0 : beta_T * a * slip(a);
  if (in.pressure > 0.0) state.junction_strain = junction_strain(slip(a));
  heat_up(state, T_ad, flux, B);
  out.shear_stress = state.shear_stress = direction * a;
  out.friction_heat = flux * dt;
  out.interface_temperature = state.temperature[0];
  state.regime = out.regime;
  return out;
}

}  // namespace

NodeState initial_state(const ModelOptions& options) {
  const Grid grid(options.grid);
  const HeatGrid heat_grid = heat_grid_of(options);
  NodeState state;
  state.hard_temperature.assign(heat_grid.interface, options.initial_temperature);
  state.temperature.assign(heat_grid.num_vertices() - heat_grid.interface, options.initial_temperature);
  if (options.modes) {
    const HeatModes modes(HeatKernel(options.soft, options.grid), *options.modes);
    state.hard_temperature.assign(static_cast<std::size_t>(modes.num_rows()) - 1, 0.0);
    state.hard_temperature.front() = options.initial_temperature;
    state.temperature.assign(1, options.initial_temperature);
  }
  state.plastic_strain.assign(grid.num_vertices(), 0.0);
  if (options.taylor_quinney_factor) {
    for (double weight : grid.weight) {
      state.heat_shape.push_back(*options.taylor_quinney_factor * weight / options.grid.thickness);
    }
  }
  if (options.inertia) {
    state.stress_field.assign(grid.num_vertices(), 0.0);
    state.layer_velocity.assign(grid.num_cells(), 0.0);
  }
  return state;
}

namespace {

NodeOutputs advance_uncontrolled(const ModelOptions& options, double dt, const NodeInputs& inputs, NodeState& state) {
  const bool sdirk2 = options.time_integrator == TimeIntegrator::kSdirk2 && !inputs.backward_euler;
  if (options.inertia) return with_inertia(options, dt, inputs, state);
  if (options.strategy == Strategy::kVelocityDriven) {
    if (sdirk2) return velocity_driven_sdirk2(options, dt, inputs, state);
    return velocity_driven(options, dt, inputs, state, heat_of_step(options, dt, state, profile_of(state)));
  }
  if (options.plastic_layer) return flowing_force_driven(options, dt, inputs, state);
  NodeOutputs out;
  if (sdirk2 && force_driven_sdirk2(options, dt, inputs, state, out)) return out;
  out = force_driven(options, dt, inputs, state);
  out.first_order = options.time_integrator == TimeIntegrator::kSdirk2 && out.regime != Regime::kStick;
  return out;
}

// A jump that turns or seems to stop in a substep: by how much it may be off.
double turning_error(const NodeInputs& in, double dt, double before, double after, double s_before, double s) {
  const double mobility = 1.0 / in.mass_minus + 1.0 / in.mass_plus;
  const double acceleration = std::abs(in.stress_minus / in.mass_minus + in.stress_plus / in.mass_plus);
  if (before == 0.0 || before * after > 0.0) return 0.0;
  if (after == 0.0) return acceleration <= mobility * std::abs(s_before) ? 0.0 : std::abs(before);
  const double after_turning = (std::abs(before) + std::abs(after)) / dt;
  return std::abs(before) * (1.0 - after_turning / (after_turning + 2.0 * mobility * std::abs(s)));
}

// The rest of a step from `begin`, in parts of it, by substeps: each is accepted where two halves of it change T0, heat
// and jump by little, else tried again half as long; where they change very little the next is twice as long.
NodeOutputs advance_controlled(const ModelOptions& options, double dt, const NodeInputs& inputs, NodeState& state) {
  const bool forced = options.strategy == Strategy::kForceDriven;
  const double T_melt = options.soft.melting_temperature;
  const double range = std::max(T_melt - options.initial_temperature, 0.01 * T_melt);
  const double response = heat_of_step(options, dt, state, profile_of(state)).B[0];
  const double shortest = std::exp2(-std::clamp(std::floor(std::log2(dt / (1e-12 / 64.0))), 1.0, 22.0));
  NodeInputs in = inputs;
  NodeOutputs sum;
  double left = 0.25 * *options.tolerance;
  double length = 1.0;
  bool refined = false;
  int attempts = 0;
  for (double begin = 0.0; begin < 1.0;) {
    NodeState coarse = state, fine = state;
    const double s_before = state.shear_stress;
    const NodeOutputs whole = advance_uncontrolled(options, length * dt, in, coarse);
    NodeOutputs half[2];
    NodeInputs then = in;
    double turning = 0.0, s = s_before;
    for (NodeOutputs& out : half) {
      out = advance_uncontrolled(options, 0.5 * length * dt, then, fine);
      if (!forced) continue;
      turning +=
          turning_error(inputs, 0.5 * length * dt, then.velocity_jump, out.velocity_jump_new, s, out.shear_stress);
      s = out.shear_stress;
      then.velocity_jump = out.velocity_jump_new;
    }
    const double rest = 1.0 - begin;
    const double T0 =
        std::abs(half[1].interface_temperature - whole.interface_temperature) * std::pow(length / rest, 1.5);
    const double heat = response / dt * std::abs(half[0].friction_heat + half[1].friction_heat - whole.friction_heat);
    const double jump = std::sqrt(std::max(1.0, 1e-6 / dt)) * conducted_share(options) * response *
                        std::max(std::abs(half[1].shear_stress), std::abs(whole.shear_stress)) *
                        (std::abs(half[1].velocity_jump_new - whole.velocity_jump_new) + turning);
    const double change = std::max({T0, heat, jump}) / range;
    const double by_length = left * std::max(length / rest, 0.05 * length / (begin + length));
    const double allowed = refined ? std::max(by_length, 0.25 * left) : by_length;
    const bool hurries = ++attempts > 1024;
    refined = change > allowed && length > 2.0 * shortest && !hurries;
    if (refined) {
      length *= 0.5;
      continue;
    }
    for (const NodeOutputs& out : half) {
      const NodeOutputs before = sum;
      sum = out;
      sum.shear_stress = forced ? before.shear_stress + 0.5 * length * out.shear_stress : out.shear_stress;
      sum.sliding_velocity = before.sliding_velocity + 0.5 * length * out.sliding_velocity;
      sum.friction_heat = before.friction_heat + out.friction_heat;
      sum.first_order = before.first_order || out.first_order;
      sum.answers = std::max(before.answers, out.answers);
      sum.error_estimate = before.error_estimate;
    }
    sum.error_estimate += change;
    left = change > allowed ? std::max(left, change) : left - change;
    begin += length;
    state = fine;
    if (forced) in.velocity_jump = then.velocity_jump;
    const bool aligned = std::fmod(begin, 2.0 * length) == 0.0;
    const bool grows = hurries ? 1.0 - begin > 64.0 * length : change <= by_length / 6.0;
    if (length < 1.0 && aligned && grows) length *= 2.0;
  }
  if (sum.shear_stress * sum.sliding_velocity < 0.0) sum.sliding_velocity = 0.0;
  state.shear_stress = sum.shear_stress;
  return sum;
}

}  // namespace

NodeOutputs advance_one(const ModelOptions& options, double dt, const NodeInputs& inputs, NodeState& state) {
  return options.tolerance ? advance_controlled(options, dt, inputs, state)
                           : advance_uncontrolled(options, dt, inputs, state);
}

}  // namespace shearbus::physics::reference
