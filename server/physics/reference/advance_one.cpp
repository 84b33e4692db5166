#include "server/physics/reference/advance_one.hpp"

#include <Eigen/SparseCore>
#include <Eigen/SparseLU>
#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>

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

double strain_increment(const Material& m, double a, double pressure, double T, double ep_old) {
  const double g = softening(m, pressure, T).g;
  if (a <= 0.0) return 0.0;
  if (g <= 0.0) return 1e100;
  const double hardened = std::pow(kSqrt3 * a / (m.yield_strength * g), 1.0 / m.hardening_exponent);
  return std::min(1e100, std::max(0.0, (hardened - 1.0) / m.hardening_coefficient - ep_old));
}

namespace {

NodeOutputs velocity_driven(const ModelOptions& options, double dt, const NodeInputs& in, NodeState& state) {
  const Material& soft = options.soft;
  const Grid grid(options.grid);
  const double h = options.grid.thickness;
  const double V = in.velocity_jump;
  const bool layer_shear = options.drive == Drive::kLayerShear;
  const double w = layer_shear ? V : h * in.soft_shear_rate;
  const Profile T_ad = conduct(options, dt, {}, profile_of(state));
  const Profile B = unit_response(options, dt, state.heat_shape, T_ad);

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
             strain_increment(soft, a, in.pressure, T_ad[i] + heating * a * B[i], state.plastic_strain[i]);
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
        return g > 0.0 ? a - soft.yield_strength_max * g / kSqrt3 : 1.0;
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
    state.plastic_strain[i] += strain_increment(soft, a, in.pressure, T_ad[i] + flux * B[i], state.plastic_strain[i]);
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

NodeOutputs force_driven(const ModelOptions& options, double dt, const NodeInputs& in, NodeState& state) {
  const Material& soft = options.soft;
  const Profile T_ad = conduct(options, dt, {}, profile_of(state));
  const Profile B = unit_response(options, dt, state.heat_shape, T_ad);
  const double beta_T = conducted_share(options);

  // DLP (61).
  const double jump_free = in.velocity_jump + dt * (in.stress_minus / in.mass_minus + in.stress_plus / in.mass_plus);
  const double per_stress = dt * (1.0 / in.mass_minus + 1.0 / in.mass_plus);
  const double direction = jump_free < 0.0 ? -1.0 : 1.0;
  const auto jump_new = [&](double a) { return jump_free - direction * a * per_stress; };
  const auto slip = [&](double a) { return std::max(0.0, direction * 0.5 * (in.velocity_jump + jump_new(a))); };
  const auto T0 = [&](double a) { return T_ad[0] + B[0] * beta_T * a * slip(a); };
  // DLP (65).
  const double coulomb = options.interface.friction_coefficient * in.pressure;
  // DLP (49-54): ep_a grows with the slip it resists.
  const auto junction_strain = [&](double v) {
    return options.junctions ? state.junction_strain + dt * v / (kSqrt3 * options.junctions->height) : 0.0;
  };
  const auto strength = [&](double v) {
    if (!options.junctions) return options.interface.yield_strength;
    const Material& m = options.junctions->metal;
    return options.junctions->contact_fraction *
           std::min(
               m.yield_strength_max,
               m.yield_strength * std::pow(1.0 + m.hardening_coefficient * junction_strain(v), m.hardening_exponent));
  };
  const auto yield = [&](double T, double v) { return strength(v) / kSqrt3 * softening(soft, in.pressure, T).g; };
  const auto spare = [&](double a) { return std::min(coulomb, yield(T0(a), slip(a))) - a; };

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
    const double end = std::min(a_stick, std::min(coulomb, yield(T_ad[0], slip(0.0))));
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
    const bool coulomb_acts = coulomb <= yield(T0(a), slip(a));
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
  state.plastic_strain.assign(grid.num_vertices(), 0.0);
  if (options.taylor_quinney_factor) {
    for (double weight : grid.weight) {
      state.heat_shape.push_back(*options.taylor_quinney_factor * weight / options.grid.thickness);
    }
  }
  return state;
}

NodeOutputs advance_one(const ModelOptions& options, double dt, const NodeInputs& inputs, NodeState& state) {
  if (options.strategy == Strategy::kVelocityDriven) return velocity_driven(options, dt, inputs, state);
  return options.plastic_layer ? flowing_force_driven(options, dt, inputs, state)
                               : force_driven(options, dt, inputs, state);
}

}  // namespace shearbus::physics::reference
