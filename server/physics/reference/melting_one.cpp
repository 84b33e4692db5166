// The force-driven step of an interface that may melt (MODEL.md, "Melt film"), slow and obvious: for each heat flux
// that is tried, the whole system of temperatures and liquid fractions is assembled and solved directly for guessed
// phases, from "nothing is liquid" on, until no vertex contradicts its phase.
#include <Eigen/SparseCore>
#include <Eigen/SparseLU>
#include <algorithm>
#include <cmath>
#include <limits>

#include "server/physics/layer/conduction.hpp"
#include "server/physics/material/strength.hpp"
#include "server/physics/reference/parts.hpp"

namespace shearbus::physics::reference {
namespace {

constexpr double kGas = 8.31446261815324;  // [J/(mol K)]

enum class Phase { kSolid, kMelting, kLiquid };

struct MeltingLayer {
  std::vector<double> T;       // of all rows, the hard body's first  [K]
  std::vector<double> liquid;  // of the soft body's vertices, z = 0 first
  double compliance = 0.0;     // integral of dz/eta over the liquid  [m/(Pa s)]
};

struct MeltingStep {
  const ModelOptions& options;
  double dt;
  HeatGrid grid;
  double T_melt;
  std::vector<double> T_old, liquid_old, eta;

  double latent(int i) const {  // latent heat of vertex i  [J/m2]
    return options.soft.density * options.melt_film->latent_heat *
           grid.weight[std::size_t(grid.interface) + std::size_t(i)];
  }

  // Temperatures and liquid fractions after the step for given phases, under the flux q.
  MeltingLayer solve(double q, const std::vector<Phase>& phase, const std::vector<double>& share) const {
    const int n = grid.num_vertices();
    std::vector<Eigen::Triplet<double>> entries;
    Eigen::VectorXd rhs(n);
    const double in_soft = options.soft.conductivity, in_hard = options.hard.conductivity;
    for (int i = 0; i < n; ++i) {
      const int v = i - grid.interface;
      const double storage = grid.capacity(i, options.soft, options.hard) / dt;
      const bool held = (i == n - 1 && grid.soft_end_is_held) || (i == 0 && grid.hard_end_is_held);
      if (held) {
        entries.emplace_back(i, i, storage);
        rhs[i] = storage * T_old[static_cast<std::size_t>(i)];
        continue;
      }
      // The unknown of a melting vertex is its latent heat over dt, of others the temperature.
      double diagonal = storage;
      rhs[i] = storage * T_old[static_cast<std::size_t>(i)];
      const auto couple = [&](int other, double conductance) {
        const int w = other - grid.interface;
        diagonal += conductance;
        if (w >= 0 && phase[static_cast<std::size_t>(w)] == Phase::kMelting)
          rhs[i] += conductance * T_melt;
        else
          entries.emplace_back(i, other, -conductance);
      };
      if (i > 0) couple(i - 1, (i <= grid.interface ? in_hard : in_soft) / grid.width[static_cast<std::size_t>(i - 1)]);
      if (i + 1 < n) couple(i + 1, (i < grid.interface ? in_hard : in_soft) / grid.width[static_cast<std::size_t>(i)]);
      if (v >= 0) {
        const auto at = static_cast<std::size_t>(v);
        rhs[i] += latent(v) * liquid_old[at] / dt + q * share[at];
        if (phase[at] == Phase::kLiquid) rhs[i] -= latent(v) / dt;
        if (phase[at] == Phase::kMelting) {
          rhs[i] -= diagonal * T_melt;
          diagonal = storage;  // of the size of the other rows: the unknown is latent heat / storage
        }
      }
      entries.emplace_back(i, i, diagonal);
    }
    Eigen::SparseMatrix<double> matrix(n, n);
    matrix.setFromTriplets(entries.begin(), entries.end());
    Eigen::SparseLU<Eigen::SparseMatrix<double>> lu(matrix);
    const Eigen::VectorXd x = lu.solve(rhs);
    MeltingLayer layer{{x.data(), x.data() + n}, std::vector<double>(phase.size(), 0.0)};
    for (std::size_t v = 0; v < phase.size(); ++v) {
      const std::size_t row = v + static_cast<std::size_t>(grid.interface);
      if (phase[v] == Phase::kLiquid) layer.liquid[v] = 1.0;
      if (phase[v] != Phase::kMelting) continue;
      const double storage = grid.capacity(static_cast<int>(row), options.soft, options.hard);
      layer.liquid[v] = layer.T[row] * storage / latent(static_cast<int>(v));
      layer.T[row] = T_melt;
    }
    for (std::size_t v = 0; v < phase.size(); ++v)
      layer.compliance += grid.weight[v + static_cast<std::size_t>(grid.interface)] * layer.liquid[v] / eta[v];
    return layer;
  }

  MeltingLayer under(double q) const {
    std::vector<double> share(liquid_old.size(), 0.0);
    double sheared = 0.0;
    for (std::size_t v = 0; v < share.size(); ++v)
      sheared += share[v] = grid.weight[v + static_cast<std::size_t>(grid.interface)] * liquid_old[v] / eta[v];
    for (double& s : share) s = sheared > 0.0 ? s / sheared : 0.0;
    if (sheared <= 0.0) share[0] = 1.0;
    std::vector<Phase> phase(liquid_old.size(), Phase::kSolid);
    const double rounding = 1e-12 * T_melt;
    for (bool grown = true; grown;) {
      grown = false;
      for (bool changed = true; changed;) {
        const MeltingLayer layer = solve(q, phase, share);
        changed = false;
        for (std::size_t v = 0; v < phase.size(); ++v) {
          const double T = layer.T[v + static_cast<std::size_t>(grid.interface)];
          const Phase old = phase[v];
          if (old == Phase::kSolid && T > T_melt + rounding) phase[v] = Phase::kMelting;
          if (old == Phase::kMelting && layer.liquid[v] < -1e-12) phase[v] = Phase::kSolid;
          changed = changed || phase[v] != old;
        }
      }
      const MeltingLayer layer = solve(q, phase, share);
      for (std::size_t v = 0; v < phase.size(); ++v) {
        if (phase[v] != Phase::kMelting || layer.liquid[v] <= 1.0 + 1e-12) continue;
        phase[v] = Phase::kLiquid;
        grown = true;
      }
    }
    return solve(q, phase, share);
  }
};

}  // namespace

NodeOutputs melting_force_driven(const ModelOptions& options, double dt, const NodeInputs& in, NodeState& state) {
  const Material soft = at_pressure(options.soft, in.pressure);
  const Profile old = profile_of(state);
  MeltingStep step{options, dt, heat_grid_of(options), soft.melting_temperature, old.rows, state.liquid_fraction, {}};
  for (const double T : state.temperature) {
    const double hot = std::max(T, step.T_melt);
    step.eta.push_back(options.melt_film->viscosity *
                       std::exp(options.melt_film->activation_energy / kGas * (1.0 / hot - 1.0 / step.T_melt)));
  }
  const double acceleration = in.stress_soft / in.mass_soft + in.stress_hard / in.mass_hard;
  const double mobility = 1.0 / in.mass_soft + 1.0 / in.mass_hard;
  const double V = in.velocity_jump;
  const double free = V + dt * acceleration;
  const double leads = free != 0.0 ? free : state.shear_stress;
  const double direction = leads < 0.0 ? -1.0 : 1.0;
  const double beta_T = conducted_share(options);

  const auto slip = [&](double a) {
    return std::max(0.0, 0.5 * (direction * V + direction * free - dt * a * mobility));
  };
  const auto layer_under = [&](double a) { return step.under(beta_T * a * slip(a)); };
  const auto solid = [&](const MeltingLayer& layer) {
    const double T = std::min(layer.T[old.interface], step.T_melt);
    const double bracket = 1.0 + soft.pressure_coefficient * in.pressure - soft.temperature_coefficient * (T - 300.0);
    return std::min(options.interface.friction_coefficient * in.pressure,
                    options.interface.yield_strength / kSqrt3 * std::max(0.0, bracket));
  };
  const double stick = std::abs(free) / (dt * mobility);
  // The excess of what contact and film carry over the stress a: the film's stress is [V]new / compliance.
  const auto spare = [&](double a) {
    const MeltingLayer layer = layer_under(a);
    const double film = std::abs(free) / (dt * mobility + layer.compliance);
    return std::min({solid(layer), film, stick}) - a;
  };

  NodeOutputs out;
  double a = 0.0;
  bool sticks = false;
  if (in.pressure > 0.0) {
    const MeltingLayer at_stick = layer_under(stick);
    const bool holds = at_stick.compliance <= 0.0 && solid(at_stick) >= stick;
    // Up to the stress of most heat there is one root at most, beyond it there may be several: scan, of which the
    // smallest counts. A stuck interface sticks if it can.
    const double mean = 0.5 * (direction * V + std::abs(free));
    const double hottest = mean > 0.0 ? std::min(stick, mean / (dt * mobility)) : stick;
    sticks = holds && state.regime == Regime::kStick;
    a = stick;
    if (!sticks) {
      if (spare(hottest) < 0.0) {
        a = bisect([&](double x) { return -spare(x); }, 0.0, hottest);
      } else if (hottest < stick) {
        double before = hottest;
        constexpr int kPoints = 50;
        for (int i = 1; i <= kPoints && a == stick; ++i) {
          const double at = hottest + (stick - hottest) * i / kPoints;
          if (spare(at) < 0.0) a = bisect([&](double x) { return -spare(x); }, before, at);
          before = at;
        }
      }
      sticks = holds && a >= stick;
      out.answers = holds && !sticks ? 2 : 1;
    }
  }
  const double flux = in.pressure > 0.0 ? beta_T * a * slip(a) : 0.0;
  const MeltingLayer layer = step.under(flux);
  const auto at_interface = layer.T.begin() + static_cast<std::ptrdiff_t>(old.interface);
  state.hard_temperature.assign(layer.T.begin(), at_interface);
  state.temperature.assign(at_interface, layer.T.end());
  state.liquid_fraction = layer.liquid;
  for (std::size_t v = 0; v < layer.liquid.size(); ++v)
    out.film_thickness += step.grid.weight[v + old.interface] * layer.liquid[v];
  out.interface_temperature = state.temperature[0];
  out.shear_stress = state.shear_stress = direction * a;
  out.friction_heat = flux * dt;
  if (in.pressure <= 0.0) {
    out.sliding_velocity = 0.5 * (V + free);
    out.velocity_jump_new = free;
    out.regime = Regime::kOpen;
  } else {
    out.sliding_velocity = direction * slip(a);
    out.velocity_jump_new = sticks ? 0.0 : free - direction * a * dt * mobility;
    const bool coulomb = options.interface.friction_coefficient * in.pressure <= solid(layer);
    const bool film_acts = out.film_thickness > 0.0 && solid(layer) > a * (1.0 + 1e-9);
    out.regime = sticks                                       ? Regime::kStick
                 : film_acts                                  ? Regime::kMelting
                 : coulomb                                    ? Regime::kCoulomb
                 : state.temperature[0] >= 0.99 * step.T_melt ? Regime::kMelting
                                                              : Regime::kTresca;
  }
  state.regime = out.regime;
  return out;
}

}  // namespace shearbus::physics::reference
