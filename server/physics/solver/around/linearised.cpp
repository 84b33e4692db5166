// The linearised answer of a solved step (MODEL.md, "Linearised answer"): derivatives of the stress by inputs of the
// host, and the time to melting.
#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>
#include <variant>

#include "server/physics/interface/friction_laws.hpp"
#include "server/physics/material/strength.hpp"
#include "server/physics/solver/contact.hpp"
#include "server/physics/solver/force_driven/interface_step.hpp"
#include "server/physics/solver/problem.hpp"
#include "server/physics/solver/step_operators.hpp"

namespace shearbus::physics {
namespace {

// The derivatives of the stress of one lane.
struct Tangent {
  double per_jump = 0.0;      // ds/d[V]  [Pa s/m]
  double per_pressure = 0.0;  // ds/dP
};

// The laws are functions of a point; their derivatives are central differences. The step in T is a share of the distance
// from melting; the step in P is so short that T_melt(P), which rises by some 1000 K in 1e10 Pa, moves the exponent
// 0.001 T/(T_melt - T) of the softening by less than 1e-3.
constexpr double kPressureShare = 1e-6;
constexpr double kMeltingDistanceShare = 1e-5;
constexpr double kExponentStep = 1e-3 * 1e10;  // [Pa K]
// A vertex at its ceiling Y_max, or of a metal that does not harden, flows as much as it must. A hardening of this share
// of the strength per strain stands for none.
constexpr double kNoHardening = 1e-14;

// Derivative of f(P) by the pressure, where f depends on a softening at the temperature T, `distance` below melting. So
// close to melting that no step is left, the softening has long vanished: 0.
template <class F>
double by_pressure(double pressure, double T, double distance, const F& f) {
  const double step = std::min(kPressureShare * pressure, kExponentStep * distance * distance / T);
  const double more = pressure + step, less = pressure - step;
  return more > less ? (f(more) - f(less)) / (more - less) : 0.0;
}

// The balance of DLP (56) in magnitudes along the stress, F(a; [V], P) = a + C integral(dep) - a_trial = 0 with
// C = sqrt(3) G0/h, differentiated where it is solved. At each vertex that flows Y(ep + dep, dep/dt, P, T) = sqrt(3) a
// with T = T_ad + B q and q = beta_T a max([V], 0), so
//   Y_dep d(dep) = sqrt(3) da - Y_T B dq - Y_P dP.
Tangent of_layer(const Problem& problem, const StepOperators& operators, const TileInputs& inputs, int lane,
                 const double* committed, const double* trial, Regime regime) {
  const ModelOptions& options = problem.options;
  const double pressure = inputs.pressure[lane];
  const double s = trial[problem.layout.shear_stress + lane];
  const double direction = s < 0.0 ? -1.0 : 1.0;
  if (regime == Regime::kCoulomb) return {0.0, direction * *options.friction_coefficient};

  const Material soft = at_pressure(options.soft, pressure);
  const double dt = operators.dt();
  const double elastic = soft.shear_modulus * dt / options.grid.thickness;
  const double compliance = kSqrt3 * soft.shear_modulus / options.grid.thickness;
  const double heat_per_jump =
      direction * inputs.velocity_jump[lane] > 0.0 ? problem.heat_partition * std::abs(s) : 0.0;
  const double heat_per_stress = problem.heat_partition * std::max(0.0, direction * inputs.velocity_jump[lane]);
  double by_stress = 0.0, by_heat = 0.0, by_pressure_of_layer = 0.0;  // of the integral of dep
  for (int i = 0; i < problem.grid.num_vertices(); ++i) {
    const std::size_t at = problem.layout.plastic_strain + static_cast<std::size_t>(i * kLanes + lane);
    const double ep = trial[at], dep = ep - committed[at];
    if (!(dep > 0.0)) continue;
    if (s == 0.0) return {};  // molten
    const double T = trial[problem.layout.temperature + static_cast<std::size_t>(i * kLanes + lane)];
    const auto stress_at = [&](double P, double temperature) {
      return flow_stress(options.soft, ep, P, temperature, dep / dt);
    };
    const double distance = soft.melting_temperature - T;
    const double step = kMeltingDistanceShare * distance;
    const double Y_T = (stress_at(pressure, T + step) - stress_at(pressure, T - step)) / (2.0 * step);
    const double Y_P = by_pressure(pressure, T, distance, [&](double P) { return stress_at(P, T); });
    const double Y_dep =
        std::max(hardening_slope(options.soft, committed[at], dep, dt, pressure, T) * softening(soft, pressure, T).g,
                 kNoHardening * kSqrt3 * std::abs(s));
    const double share = problem.grid.weight[static_cast<std::size_t>(i)] / Y_dep;
    by_stress += share * kSqrt3;
    by_heat -= share * Y_T * operators.heat().layer_response()[i];
    by_pressure_of_layer -= share * Y_P;
  }
  const double slope = 1.0 + compliance * (by_stress + by_heat * heat_per_stress);
  return {(elastic - compliance * by_heat * heat_per_jump) / slope,
          -direction * compliance * by_pressure_of_layer / slope};
}

// DLP (61), (65): a slipping interface carries a = s_lim(T0, [v]; P) with [v] = c - b a and T0 = T_ad + beta_T B0 a [v];
// one that sticks carries what stops the jump.
Tangent of_interface(const Problem& problem, const StepOperators& operators, const TileInputs& inputs, int lane,
                     const double* committed, const double* trial, const TileOutputs& outputs) {
  const double dt = operators.dt();
  const LaneStep before = InterfaceStep::before(problem.layout, inputs, committed, lane);
  const TrialSlip path(forcing_of(inputs, lane), dt, before.jump_new, before.stress);
  if (outputs.regime[lane] == Regime::kStick) return {1.0 / path.per_stress, 0.0};

  const double pressure = inputs.pressure[lane];
  const double T0 = outputs.interface_temperature[lane];
  const double slip = std::abs(outputs.sliding_velocity[lane]);
  const double a = std::abs(trial[problem.layout.shear_stress + lane]);
  const ContactState state = contact_before(problem, committed, lane);
  const double least = problem.layout.num_friction_states > 0 ? path.least_slip() : 0.0;
  const auto limit_at = [&](double P, double asked, double v) {
    const Material soft = at_pressure(problem.options.soft, P);
    StressLimit contact = contact_limit(problem, soft, P, dt, state, nullptr);
    contact.least_slip = asked;
    return contact.at(T0, v);
  };
  const StressLimit::Value limit = limit_at(pressure, least, slip);
  const double distance = at_pressure(problem.options.soft, pressure).melting_temperature - T0;
  const double B0 = problem.modes ? *operators.modes().layer_response() : *operators.heat().layer_response();
  const double rise = problem.heat_partition * B0;
  const double b = 0.5 * path.per_stress;
  const double by_load =
      path.direction * by_pressure(pressure, T0, distance, [&](double P) { return limit_at(P, least, slip).stress; });
  // Where the jump turns the law may be asked for the slip velocity at which the slip before stops: half the old jump.
  const bool stops = slip < least && limit.is_coulomb;
  const double by_stop = stops ? -0.5 * limit_at(pressure, 0.0, least).slip_slope() : 0.0;
  if (slip == 0.0) return {by_stop, by_load};  // the jump turns in the step: a slip against the stress is taken as 0
  const double by_free_slip = limit.slope * rise * a + limit.slip_slope() + by_stop;  // of the limit by c
  const double slope = 1.0 - limit.slope * rise * (slip - b * a) + limit.slip_slope() * b;
  return {by_free_slip / slope, by_load / slope};
}

// Whether the stress of a velocity-driven interface that slips is mu P.
bool slips_under_constant_limit(const ModelOptions& options) {
  return !options.junctions && std::holds_alternative<ConstantCoefficient>(form_of(options.interface));
}

}  // namespace

// If one balance gives one stress, at the end of an undivided step.
bool Model::can_linearise(const ModelOptions& options) {
  return !options.tolerance && options.time_integrator == TimeIntegrator::kBackwardEuler &&
         options.tangential_components == 1 && !options.inertia && !options.plastic_layer && !options.melt_film &&
         !options.taylor_quinney_factor && !conducts_by_temperature(options) && options.drive == Drive::kLayerShear &&
         (options.strategy == Strategy::kForceDriven || slips_under_constant_limit(options));
}

// 0 where the answer has none: in open contacts, and in lanes that failed or whose step was divided into substeps.
void Model::linearise(const StepOperators& operators, const TileInputs& inputs, const double* committed,
                      const double* trial, TileOutputs& outputs) const {
  const Problem& problem = *problem_;
  for (const int lane : lanes_of(inputs.active)) {
    Tangent tangent;
    if ((outputs.outcome[lane] & (kFailed | kSubstepped)) == 0 && outputs.regime[lane] != Regime::kOpen) {
      tangent = problem.options.strategy == Strategy::kVelocityDriven
                    ? of_layer(problem, operators, inputs, lane, committed, trial, outputs.regime[lane])
                    : of_interface(problem, operators, inputs, lane, committed, trial, outputs);
    }
    outputs.stress_per_jump[lane] = tangent.per_jump;
    outputs.stress_per_pressure[lane] = tangent.per_pressure;
  }
}

// Until T0 reaches T_melt if it goes on rising at the mean rate of the step; infinity where T0 does not rise.
void Model::predict_melting(const StepOperators& operators, const TileInputs& inputs, const double* committed,
                            TileOutputs& outputs) const {
  for (const int lane : lanes_of(inputs.active)) {
    const double T0 = outputs.interface_temperature[lane];
    const double rise = T0 - interface_temperature(committed, lane);
    const double left = at_pressure(problem_->options.soft, inputs.pressure[lane]).melting_temperature - T0;
    outputs.time_to_melting[lane] = rise > 0.0 && left > 0.0 ? operators.dt() * left / rise
                                    : left > 0.0             ? std::numeric_limits<double>::infinity()
                                                             : 0.0;
  }
}

}  // namespace shearbus::physics
