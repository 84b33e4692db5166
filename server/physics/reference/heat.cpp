// Heat conduction of the reference solver (advance_one.hpp): the linear systems are assembled and solved directly.
#include <Eigen/SparseCore>
#include <Eigen/SparseLU>
#include <algorithm>
#include <cmath>
#include <optional>

#include "server/physics/layer/conduction.hpp"
#include "server/physics/material/strength.hpp"
#include "server/physics/reference/parts.hpp"

namespace shearbus::physics::reference {

HeatGrid heat_grid_of(const ModelOptions& options) {
  const Grid layer(options.grid);
  if (!options.hard_grid) return HeatGrid(layer, options.grid.far_boundary);
  return HeatGrid(layer, options.grid.far_boundary, Grid(*options.hard_grid), options.hard_grid->far_boundary);
}

double conducted_share(const ModelOptions& options) {
  return options.hard_grid ? 1.0 : heat_partition(options.soft, options.hard);
}

Profile profile_of(const NodeState& state) {
  Profile profile{state.hard_temperature, state.hard_temperature.size(), state.coefficients_from,
                  state.coefficients_to};
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

// Returns T_ad, the values without the flux q of the step, and B, their rise per unit q, in a step with heat modes.
// The values are: the start temperature, each mode of HeatModes, T0. The rise of T0 is the exact integral of the heat
// kernel. The flux is constant or, if `early` > 0, linear in time: `early_flux` at the time `early` dt and q at dt.
Heat heat_of_modes(const ModelOptions& options, double dt, double early, double early_flux, const Profile& old) {
  const HeatModes modes(HeatKernel(options.soft, options.grid), *options.modes);
  const std::size_t last = old.rows.size() - 1;
  Heat heat{old, {std::vector<double>(old.rows.size(), 0.0), last, {}, {}}};
  double T0 = old.rows[0];
  for (std::size_t j = 0; j < modes.rate.size(); ++j) {
    // The flux at a time s before the end of the step adds to the mode with the weight exp(-rate s). This flux is
    // q + (early_flux - q) s / ((1 - early) dt). `first` is the total weight of early_flux, `second` that of q.
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

// A table, and its integral from its first temperature.
double table_at(const HeatTable& table, double T) {
  for (std::size_t i = 1; i < table.temperature.size(); ++i) {
    const double lo = table.temperature[i - 1], hi = table.temperature[i];
    if (T >= lo && T < hi) return (table.share[i - 1] * (hi - T) + table.share[i] * (T - lo)) / (hi - lo);
  }
  return T < table.temperature.front() ? table.share.front() : table.share.back();
}
double integral_of(const HeatTable& table, double T) {
  if (T <= table.temperature.front()) return table.share.front() * (T - table.temperature.front());
  double sum = 0.0;
  for (std::size_t i = 1; i < table.temperature.size(); ++i) {
    const double lo = table.temperature[i - 1], hi = std::min(T, table.temperature[i]);
    if (hi > lo) sum += 0.5 * (hi - lo) * (table.share[i - 1] + table_at(table, hi));
  }
  return sum + table.share.back() * std::max(0.0, T - table.temperature.back());
}

}  // namespace

Profile conduct(const ModelOptions& options, double dt, const std::vector<double>& sources, const Profile& old) {
  const HeatGrid grid = heat_grid_of(options);
  const int n = grid.num_vertices();
  // k(T)/k and c(T)/c as they are printed, as means between two temperatures: of a table the difference of its integrals.
  const auto mean = [&](double slope, const HeatTable& table, double T_1, double T_2) {
    const double T = 0.5 * (T_1 + T_2);
    if (table.empty()) return std::isfinite(slope) ? 1.0 + slope * (T - 300.0) : 1.0;
    if (std::abs(T_2 - T_1) < 1e-3) return table_at(table, T);
    return (integral_of(table, T_2) - integral_of(table, T_1)) / (T_2 - T_1);
  };
  const HeatTables& tables = heat_tables(options);
  const bool constant = old.coefficients_from.empty();
  const auto conducts = [&](const Material& m, int cell) {
    if (constant) return 1.0;
    const HeatTable& table = &m == &options.soft ? tables.soft_conductivity : tables.hard_conductivity;
    const auto half_way = [&](int i) { return 0.5 * (old.coefficients_from[i] + old.coefficients_to[i]); };
    return mean(m.conductivity_slope, table, half_way(cell), half_way(cell + 1));
  };
  const auto holds = [&](int i) {
    if (constant) return grid.capacity(i, options.soft, options.hard);
    const double T_1 = old.coefficients_from[i], T_2 = old.coefficients_to[i];
    const double soft = mean(options.soft.specific_heat_slope, tables.soft_heat, T_1, T_2) * options.soft.conductivity /
                        options.soft.diffusivity;
    const double hard = mean(options.hard.specific_heat_slope, tables.hard_heat, T_1, T_2) * options.hard.conductivity /
                        options.hard.diffusivity;
    if (i == grid.interface) return soft * grid.weight[i] + hard * grid.hard_weight;
    return (i < grid.interface ? hard : soft) * grid.weight[i];
  };
  std::vector<Eigen::Triplet<double>> entries;
  Eigen::VectorXd rhs(n);
  for (int i = 0; i < n; ++i) {
    // Heat capacity divided by dt  [W/(m2 K)]
    const double storage = holds(i) / dt;
    double diagonal = storage;
    const bool held = i == n - 1                    ? options.grid.far_boundary == FarBoundary::kIsothermal
                      : i == 0 && options.hard_grid ? options.hard_grid->far_boundary == FarBoundary::kIsothermal
                                                    : false;
    if (held) {
      entries.emplace_back(i, i, storage);  // of the size of the other rows, for the pivoting
      rhs[i] = storage * old.rows[i];
      continue;
    }
    if (i > 0) {
      const Material& m = i <= grid.interface ? options.hard : options.soft;
      const double k = m.conductivity * conducts(m, i - 1);
      entries.emplace_back(i, i - 1, -k / grid.width[i - 1]);
      diagonal += k / grid.width[i - 1];
    }
    if (i + 1 < n) {
      const Material& m = i < grid.interface ? options.hard : options.soft;
      const double k = m.conductivity * conducts(m, i);
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
  return {
      {T.data(), T.data() + n}, static_cast<std::size_t>(grid.interface), old.coefficients_from, old.coefficients_to};
}

Profile unit_response(const ModelOptions& options, double dt, const std::vector<double>& shape, const Profile& like) {
  return conduct(
      options, dt, shape.empty() ? std::vector<double>{1.0} : shape,
      {std::vector<double>(like.rows.size(), 0.0), like.interface, like.coefficients_from, like.coefficients_to});
}

// A step with a constant flux through both stages of SDIRK2; T_ad must not leave the range of the old temperatures.
std::optional<Heat> even_heat(const ModelOptions& options, double dt, const Profile& old) {
  const auto two_stages = [&](const std::vector<double>& sources, const Profile& from) {
    Profile next = conduct(options, kGamma * dt, sources, from);
    for (std::size_t i = 0; i < from.rows.size(); ++i)
      next.rows[i] = from.rows[i] + (1.0 - kGamma) / kGamma * (next.rows[i] - from.rows[i]);
    return conduct(options, kGamma * dt, sources, next);
  };
  Heat heat{two_stages({}, old), two_stages({1.0}, {std::vector<double>(old.rows.size(), 0.0), old.interface, {}, {}})};
  const auto [coldest, hottest] = std::minmax_element(old.rows.begin(), old.rows.end());
  for (double& T : heat.T_ad.rows) {
    if (!(T >= *coldest * (1.0 - 1e-12) && T <= *hottest * (1.0 + 1e-12))) return std::nullopt;
    T = std::clamp(T, *coldest, *hottest);
  }
  return heat;
}

Heat heat_of_step(const ModelOptions& options, double dt, const NodeState& state, const Profile& old) {
  if (options.modes) return heat_of_modes(options, dt, 0.0, 0.0, old);
  if (options.tolerance && options.plastic_layer && !conducts_by_temperature(options))
    if (const std::optional<Heat> even = even_heat(options, dt, old)) return *even;
  const Profile T_ad = conduct(options, dt, {}, old);
  // Velocity-driven all heat of the step is released by the shape, force-driven only that of plastic work.
  const bool by_shape = options.strategy == Strategy::kVelocityDriven;
  return {T_ad, unit_response(options, dt, by_shape ? state.heat_shape : std::vector<double>{}, T_ad)};
}

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
  if (options.melt_film) {
    const bool molten = options.initial_temperature > options.soft.melting_temperature;
    state.liquid_fraction.assign(state.temperature.size(), molten ? 1.0 : 0.0);
  }
  if (options.taylor_quinney_factor) {
    for (double weight : grid.weight) {
      state.heat_shape.push_back(*options.taylor_quinney_factor * weight / options.grid.thickness);
    }
  }
  if (options.inertia) {
    state.stress_field.assign(grid.num_vertices(), 0.0);
    state.layer_velocity.assign(grid.num_cells() + (options.strategy == Strategy::kForceDriven ? 1 : 0), 0.0);
  }
  return state;
}

}  // namespace shearbus::physics::reference
