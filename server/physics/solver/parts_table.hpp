// The table of parts.hpp: the parts, of which a model has one, and which exclude each other. parts.cpp includes it.
#pragma once

#include <array>
#include <cmath>
#include <limits>
#include <memory>
#include <optional>
#include <vector>

#include "server/physics/interface/friction_laws.hpp"
#include "server/physics/material/flow_laws.hpp"
#include "server/physics/solver/parts.hpp"

namespace shearbus::physics {

using enum Property;

// Returns a grid for the hard body: that of the scene's table [layer], but as thick as the depth that heat reaches in
// the hard body while it crosses the soft layer.
inline GridOptions matching_hard_grid(const ModelOptions& o) {
  GridOptions grid = o.grid;
  grid.thickness *= std::sqrt(o.hard.diffusivity / o.soft.diffusivity);
  return grid;
}

inline JunctionOptions typical_junctions(const ModelOptions& o) {
  Material metal = o.soft;
  metal.flow_law = FlowLaws::place<SteinbergCochranGuinan>();
  // A velocity-driven scene without [interface] gives no strength: junctions then yield as the soft body does.
  metal.yield_strength = o.interface.yield_strength > 0.0 ? o.interface.yield_strength : o.soft.yield_strength;
  if (!has_constant(o.soft.flow_law, &Material::hardening_coefficient)) {
    metal.yield_strength_max = std::numeric_limits<double>::infinity();
    metal.hardening_coefficient = 125.0;
    metal.hardening_exponent = 0.1;
  }
  return {.contact_fraction = 0.5, .height = 1e-7, .metal = metal};
}

// Tables of the hard body, with a kink, for any temperature; the soft body has slopes.
inline std::shared_ptr<const HeatTables> typical_heat_tables() {
  const std::vector<double> T{0.0, 400.0, 700.0, 1e5};
  return std::make_shared<const HeatTables>(
      HeatTables{{}, {}, {T, {1.05, 0.95, 0.75, 0.7}}, {T, {0.9, 1.05, 1.3, 1.4}}});
}

// Constants of Simon's curve that begin at the metal's melting temperature, with the steepness of common metals.
inline void give_typical_melting(Material& metal) {
  metal.simon_temperature = metal.melting_temperature;
  metal.simon_pressure = 10e9;
  metal.simon_exponent = 2.0;
}

// The melt of aluminium, roughly: latent heat and viscosity near its melting temperature.
inline constexpr MeltFilmOptions kTypicalMelt{.latent_heat = 4e5, .viscosity = 1e-3, .activation_energy = 0.0};

// Sets of properties, each used by several entries of kParts. Parts that change only the strength in the search for the
// stress of a step (flow laws, pressure, melting), or that treat a step as a whole (sleep, tolerance), go with all
// strategies, drives, limits and contact options before them.
inline constexpr Properties kEitherStrategy{kVelocityDriven, kForceDriven};
inline constexpr Properties kEitherHardBody{kConductingHardBody, kFixedHeatShare};
inline constexpr Properties kFlow{kFirstOrderFlow, kFlowWithPressureTerm};
inline constexpr Properties kUnderPressure{kMeltingCurve, kCompressedPressureTerm};
// Not inline: next to sanitizers GCC finds no address in what other files may define to be constant.
constexpr std::array kParts = {
    Part{.property = kVelocityDriven,
         .key = "strategy",
         .value = "\"velocity_driven\"",
         .is_on = [](const ModelOptions& o) { return o.strategy == Strategy::kVelocityDriven; },
         .needs = {kFlowingLayer},
         .equation = "DLP (48), (56)",
         .adds = "the layer's plastic flow finds the stress",
         .when = "the host imposes the velocity jump",
         .cost = "3,660 instructions"},
    Part{.property = kForceDriven,
         .key = "strategy",
         .value = "\"force_driven\"",
         .is_on = [](const ModelOptions& o) { return o.strategy == Strategy::kForceDriven; },
         .equation = "DLP (61), (65)",
         .adds = "the interface law finds stress and slip",
         .when = "the host is a hydrocode that sends far-field stresses",
         .cost = "652 instructions"},
    Part{.property = kInterfaceSlip,
         .key = "velocity_driven.drive",
         .value = "\"interface_slip\"",
         .is_on = [](const ModelOptions& o) { return o.drive == Drive::kInterfaceSlip; },
         .set = [](ModelOptions& o, bool on) { o.drive = on ? Drive::kInterfaceSlip : Drive::kLayerShear; },
         .goes_with = {kVelocityDriven},
         .needs = {kVelocityDriven},
         .equation = "DLP (64)",
         .adds = "the jump is slip at z = 0, and the host's own shear drives the layer",
         .when = "the host resolves the shear of the soft body",
         .cost = "velocity-driven x 0.94"},
    Part{.property = kCoulombLimit,
         .key = "velocity_driven.friction_coefficient",
         .value = "0.1",
         .is_on = [](const ModelOptions& o) { return o.friction_coefficient.has_value(); },
         .set = [](ModelOptions& o, bool on) { o.friction_coefficient = on ? std::optional(0.02) : std::nullopt; },
         .goes_with = {kVelocityDriven, kInterfaceSlip},
         .needs = {kVelocityDriven},
         .equation = "DLP (5), (65)",
         .adds = "friction limits the stress, and the rest of the jump is slip at z = 0: in short for `[interface]`, "
                 "which takes any friction law",
         .when = "contacts under little pressure",
         .cost = "velocity-driven x 1.17"},
    Part{
        .property = kConductingHardBody,
        .key = "hard_layer",
        .is_on = [](const ModelOptions& o) { return o.hard_grid.has_value(); },
        .set = [](ModelOptions& o, bool on) { o.hard_grid = on ? std::optional(matching_hard_grid(o)) : std::nullopt; },
        .goes_with = {kVelocityDriven, kForceDriven, kInterfaceSlip, kCoulombLimit},
        .equation = "heat in both bodies, one flux at z = 0",
        .adds = "the hard body conducts on a grid of its own, in place of the fixed share (DLP 18-19)",
        .when = "bodies that are no half-spaces, bodies that differ much, long times",
        .cost = "velocity-driven x 1.83, force-driven x 1.47"},
    Part{.property = kFixedHeatShare,
         .key = "hard_layer",
         .value = "absent",
         .is_on = [](const ModelOptions& o) { return !o.hard_grid.has_value(); },
         .goes_with = kEitherStrategy | Properties{kInterfaceSlip, kCoulombLimit}},
    Part{.property = kPlasticHeating,
         .key = "velocity_driven.taylor_quinney_factor",
         .value = "0.9",
         .is_on = [](const ModelOptions& o) { return o.taylor_quinney_factor.has_value(); },
         .set = [](ModelOptions& o, bool on) { o.taylor_quinney_factor = on ? std::optional(0.9) : std::nullopt; },
         .goes_with = {kVelocityDriven, kForceDriven, kCoulombLimit, kConductingHardBody},
         .needs = {kFlowingLayer},
         .equation = "source sqrt(3) s dep/dt",
         .adds = "plastic work heats the layer where it flows; force-driven: interface.taylor_quinney_factor",
         .when = "the band of flow may leave the interface",
         .cost = "velocity-driven x 1.79"},
    Part{.property = kInertia,
         .key = "layer.inertia",
         .value = "true",
         .is_on = [](const ModelOptions& o) { return o.inertia; },
         .set = [](ModelOptions& o, bool on) { o.inertia = on; },
         .goes_with = Properties::before(kInertia) - Properties{kInterfaceSlip},
         .needs = {kFlowingLayer},
         .equation = "DLP (36)",
         .adds = "the layer has mass: shear waves cross it",
         .when = "steps below the layer's transit time, 6 ns in 20 um of aluminium",
         .cost = "velocity-driven x 6.06"},
    Part{.property = kPlasticLayer,
         .key = "interface.plastic_layer",
         .value = "true",
         .is_on = [](const ModelOptions& o) { return o.plastic_layer; },
         .set = [](ModelOptions& o, bool on) { o.plastic_layer = on; },
         .goes_with = kEitherHardBody | Properties{kForceDriven, kPlasticHeating, kInertia},
         .needs = {kForceDriven, kFlowingLayer},
         .equation = "DLP (48), (64)",
         .adds = "a force-driven layer flows and hardens in addition to the slip",
         .when = "an interface stronger than the layer",
         .cost = "force-driven x 9.98"},
    Part{.property = kJunctions,
         .key = "junctions",
         .is_on = [](const ModelOptions& o) { return o.junctions.has_value(); },
         .set = [](ModelOptions& o, bool on) { o.junctions = on ? std::optional(typical_junctions(o)) : std::nullopt; },
         .goes_with = Properties::before(kJunctions),
         .equation = "DLP (49)-(54)",
         .adds = "real contact through junctions that harden with the slip",
         .when = "rough contact, small slip",
         .cost = "velocity-driven x 6.05, force-driven x 1.31"},
    Part{.property = kSlipDependentFriction,
         .key = "interface.friction_law",
         .is_on =
             [](const ModelOptions& o) {
               return has_friction(o) && properties_of(o.interface.friction_law).depends_on_slip();
             },
         .goes_with = Properties::before(kSlipDependentFriction),
         .law_with = "friction law that depends on slip"},
    Part{.property = kFirstOrderFlow,
         .key = "soft.flow_law",
         .is_on = [](const ModelOptions& o) { return properties_of(o.soft.flow_law).first_order_in_time; },
         .goes_with = Properties::before(kFirstOrderFlow),
         .law_with = "flow law whose stress follows the mean rate of a step"},
    Part{.property = kFlowWithPressureTerm,
         .key = "soft.flow_law",
         .is_on = [](const ModelOptions& o) { return properties_of(o.soft.flow_law).has_pressure_term; },
         .goes_with = Properties::before(kFlowWithPressureTerm),
         .law_with = "flow law with a pressure term"},
    Part{.property = kMeltingCurve,
         .key = "soft.melting_curve",
         .value = "\"lindemann\"",
         .is_on = [](const ModelOptions& o) { return o.soft.melting_curve == MeltingCurve::kLindemann; },
         .set = [](ModelOptions& o,
                   bool on) { o.soft.melting_curve = on ? MeltingCurve::kLindemann : MeltingCurve::kConstant; },
         .goes_with = Properties::before(kMeltingCurve),
         .equation = "Lindemann; Steinberg, Cochran, Guinan 1980",
         .adds = "the melting temperature follows the compression",
         .when = "above some 5 GPa",
         .cost = "velocity-driven x 1.36, force-driven x 1.62"},
    Part{.property = kCompressedPressureTerm,
         .key = "soft.pressure_term",
         .value = "\"compressed\"",
         .is_on = [](const ModelOptions& o) { return o.soft.pressure_term != PressureTerm::kLinear; },
         .set = [](ModelOptions& o,
                   bool on) { o.soft.pressure_term = on ? PressureTerm::kCompressed : PressureTerm::kLinear; },
         .goes_with = Properties::before(kCompressedPressureTerm),
         .needs = {kFlowWithPressureTerm},
         .equation = "Steinberg, Cochran, Guinan 1980",
         .adds = "the gain of strength with pressure follows the compression",
         .when = "above some 5 GPa: with the melting curve it changes the pinned stress at 11 GPa by 57 %",
         .cost = "velocity-driven x 1.11, force-driven x 1.53"},
    Part{.property = kSecondOrder,
         .key = "layer.time_integrator",
         .value = "\"sdirk2\"",
         .is_on = [](const ModelOptions& o) { return o.time_integrator == TimeIntegrator::kSdirk2; },
         .set = [](ModelOptions& o,
                   bool on) { o.time_integrator = on ? TimeIntegrator::kSdirk2 : TimeIntegrator::kBackwardEuler; },
         .goes_with = Properties::before(kSecondOrder),
         .equation = "Alexander 1977",
         .adds = "second order in time, two stages a step",
         .when = "few, long steps; tolerances below 1e-2",
         .cost = "velocity-driven x 3.52, force-driven x 2.61"},
    Part{.property = kModes,
         .key = "layer.heat",
         .value = "\"modes\"",
         .is_on = [](const ModelOptions& o) { return o.modes.has_value(); },
         .set = [](ModelOptions& o, bool on) { o.modes = on ? std::optional(ModesOptions{}) : std::nullopt; },
         .goes_with = kFlow | kUnderPressure |
                      Properties{kForceDriven, kFixedHeatShare, kJunctions, kSlipDependentFriction, kSecondOrder},
         .equation = "METHODS.md",
         .adds = "no temperature profile: a short sum of exponentials gives the interface temperature",
         .when = "a layer that does not flow: no cells, less state",
         .cost = "force-driven x 0.64"},
    Part{.property = kSleep,
         .key = "layer.sleep",
         .value = "true",
         .is_on = [](const ModelOptions& o) { return o.sleep; },
         .set = [](ModelOptions& o, bool on) { o.sleep = on; },
         .goes_with = Properties::before(kSleep) - Properties{kInertia},
         .equation = "METHODS.md",
         .adds = "nodes at rest, open or stuck, are not solved; with BACKWARD_EULER the answers differ by rounding only",
         .when = "contacts that stick for long, velocity-driven or with a plastic layer",
         .cost = "velocity-driven x 1.02, force-driven x 1.11"},
    Part{.property = kTolerance,
         .key = "tolerance",
         .value = "1e-3",
         .is_on = [](const ModelOptions& o) { return o.tolerance.has_value(); },
         .set =
             [](ModelOptions& o, bool on) {
               o.tolerance = on ? std::optional(1e-3) : std::nullopt;
               if (on) return;
               o.time_integrator = TimeIntegrator::kBackwardEuler;
               o.modes.reset();
             },
         .goes_with = Properties::before(kTolerance) - Properties{kPlasticHeating, kInertia},
         .equation = "METHODS.md",
         .adds = "the model chooses cells, grading and methods, cuts each node's step until its error is below the "
                 "tolerance, and reports the estimate",
         .when = "accuracy asked for, not guessed",
         .cost = "velocity-driven x 3.16, force-driven x 6.15"},
    Part{.property = kTwoComponents,
         .key = "tangential_components",
         .value = "2",
         .is_on = [](const ModelOptions& o) { return o.tangential_components == 2; },
         .set = [](ModelOptions& o, bool on) { o.tangential_components = on ? 2 : 1; },
         .goes_with = Properties::before(kTwoComponents) - Properties{kInterfaceSlip, kInertia},
         .equation = "MODEL.md, \"Two tangential components\"",
         .adds = "slip and stress are vectors in the interface",
         .when = "hosts in three dimensions",
         .cost = "velocity-driven x 1.05, force-driven x 1.25"},
    Part{.property = kTemperatureDependentFriction,
         .key = "interface.friction_law",
         .is_on =
             [](const ModelOptions& o) {
               return has_friction(o) && properties_of(o.interface.friction_law).depends_on_temperature;
             },
         .goes_with = Properties::before(kTemperatureDependentFriction),
         .law_with = "friction law that depends on temperature"},
    Part{.property = kFrictionWithState,
         .key = "interface.friction_law",
         .is_on = [](const ModelOptions& o) { return has_friction(o) && !states_of(o.interface.friction_law).empty(); },
         .goes_with = Properties::before(kFrictionWithState) - Properties{kSleep},
         .law_with = "friction law with a state of its own"},
    Part{.property = kIsothermalEnd,
         .key = "layer.far_boundary",
         .value = "\"isothermal\"",
         .is_on =
             [](const ModelOptions& o) {
               return o.grid.far_boundary == FarBoundary::kIsothermal ||
                      (o.hard_grid && o.hard_grid->far_boundary == FarBoundary::kIsothermal);
             },
         .set =
             [](ModelOptions& o, bool on) {
               o.grid.far_boundary = on ? FarBoundary::kIsothermal : FarBoundary::kInsulated;
               if (o.hard_grid) o.hard_grid->far_boundary = o.grid.far_boundary;
             },
         .goes_with = Properties::before(kIsothermalEnd),
         .equation = "T(h) = T_start",
         .adds = "the far face of a body keeps the temperature of the start, so that a sliding layer becomes steady",
         .when = "thin layers between baths, as in molecular dynamics",
         .cost = "velocity-driven x 1.00, force-driven x 1.00"},
    Part{.property = kSimonMelting,
         .key = "soft.melting_curve",
         .value = "\"simon\"",
         .is_on = [](const ModelOptions& o) { return o.soft.melting_curve == MeltingCurve::kSimon; },
         .set =
             [](ModelOptions& o, bool on) {
               if (on && !std::isfinite(o.soft.simon_pressure)) give_typical_melting(o.soft);
               choose_melting_curve(o.soft, on ? MeltingCurve::kSimon : MeltingCurve::kConstant);
             },
         .goes_with = Properties::before(kSimonMelting) - Properties{kMeltingCurve},
         .equation = "Simon, Glatzel 1929",
         .adds = "the melting temperature follows a measured curve T0 (1 + P/a)^(1/c)",
         .when = "metals with a measured melting curve; T0 is then that of the curve, not that of the flow law",
         .cost = "velocity-driven x 1.33, force-driven x 1.47"},
    Part{.property = kMeltFilm,
         .key = "melt_film",
         .is_on = [](const ModelOptions& o) { return o.melt_film.has_value(); },
         .set = [](ModelOptions& o,
                   bool on) { o.melt_film = on ? std::optional<MeltFilmOptions>(kTypicalMelt) : std::nullopt; },
         .goes_with = kFlow | kUnderPressure |
                      Properties{kForceDriven, kConductingHardBody, kSecondOrder, kSleep, kTwoComponents,
                                 kIsothermalEnd, kSimonMelting},
         .equation = "latent heat; s = [v] / integral(dz/eta)",
         .adds = "the soft body melts at the interface, and the melt carries the stress",
         .when = "fast slip that goes on after the interface has reached its melting temperature",
         .cost = "force-driven x 9.39"},
    Part{.property = kFlowWithoutBracket,
         .key = "soft.flow_law",
         .is_on =
             [](const ModelOptions& o) { return !has_constant(o.soft.flow_law, &Material::temperature_coefficient); },
         .goes_with = Properties::before(kFlowWithoutBracket) - Properties{kMeltFilm},
         .law_with = "flow law without the linear softening of DLP (15)"},
    Part{.property = kFlowingLayer,
         .key = "strategy",
         .is_on = [](const ModelOptions& o) { return o.strategy == Strategy::kVelocityDriven || o.plastic_layer; },
         .goes_with = Properties::before(kFlowingLayer) - Properties{kModes, kMeltFilm}},
    Part{.property = kVaryingHeat,
         .key = "soft.thermal_conductivity_slope_per_k",
         .value = "-2e-4",
         .is_on = [](const ModelOptions& o) { return conducts_by_temperature(o); },
         .set =
             [](ModelOptions& o, bool on) {
               o.soft.conductivity_slope = on ? -2e-4 : kNotGiven;
               o.soft.specific_heat_slope = on ? 5e-4 : kNotGiven;
               o.hard.conductivity_slope = o.hard.specific_heat_slope = kNotGiven;
               o.heat_tables = on ? typical_heat_tables() : nullptr;
             },
         .goes_with = Properties::before(kVaryingHeat) - Properties{kFixedHeatShare, kModes, kMeltFilm},
         .equation = "k (1 + a (T - 300 K)) or a table, c likewise",
         .adds = "conductivity and heat capacity follow the temperature",
         .when = "metals that warm by hundreds of kelvins, of which both are known",
         .cost = "velocity-driven x 30, force-driven x 164"},
};
static_assert(kParts.size() == kProperties);
static_assert([] {
  for (std::size_t i = 0; i < kParts.size(); ++i)
    if (static_cast<std::size_t>(kParts[i].property) != i) return false;
  return true;
}());

// Of each of the first kWholeChoices rows a model has exactly one part, of the others at most one.
inline constexpr std::array kChoices = {Properties{kVelocityDriven, kForceDriven},
                                        Properties{kConductingHardBody, kFixedHeatShare},
                                        Properties{kMeltingCurve, kSimonMelting}};
inline constexpr std::size_t kWholeChoices = 2;

constexpr std::array kExclusions = {
    Exclusion{{kPlasticHeating, kInertia},
              {kInterfaceSlip},
              "with that drive the jump is slip at z = 0: it crosses no layer, and all its work is friction there"},
    Exclusion{
        {kTwoComponents}, {kInterfaceSlip}, "the shear rate that drives the layer with that drive has no direction"},
    Exclusion{
        {kPlasticHeating, kVaryingHeat, kMeltFilm},
        {kFixedHeatShare},
        "the fixed share of the hard body is that of heat released at z = 0 into two half-spaces of constant k and "
        "c, in which it stays"},
    Exclusion{{kInertia},
              {kTwoComponents},
              "waves turn the stress from depth to depth, and the metal of a layer of two components flows along one "
              "direction"},
    Exclusion{{kSleep, kTolerance},
              {kInertia},
              "a node at rest and an error are judged at z = 0, where waves that cross the layer are not seen"},
    Exclusion{{kTolerance},
              {kPlasticHeating, kMeltFilm},
              "where the flow gathers in a band, and how nanometres of film melt, depends on cells and steps, and no "
              "estimate can tell"},
    Exclusion{{kModes}, {kFlowingLayer}, "a layer flows by the temperature inside it, which modes do not keep"},
    Exclusion{{kModes}, {kConductingHardBody}, "modes follow one body: leave out [hard_layer], or keep the profile"},
    Exclusion{{kMeltFilm},
              {kFlowingLayer},
              "the flow stress of a layer vanishes before the interface melts, so that the layer takes the slip of the "
              "film"},
    Exclusion{{kMeltFilm}, {kVaryingHeat}, "k(T) and c(T) are those of the solid, and tell nothing of the melt"},
    Exclusion{{kMeltFilm},
              {kTemperatureDependentFriction, kFlowWithoutBracket},
              "its strength vanishes at melting, so that the interface would not melt"},
    Exclusion{
        {kMeltFilm},
        {kJunctions, kSlipDependentFriction, kFrictionWithState},
        "the film carries the stress on the whole area, by the slip of a liquid, of which dry friction tells nothing"},
    Exclusion{{kFrictionWithState}, {kSleep}, "the state of a contact at rest goes on: it heals"},
};

}  // namespace shearbus::physics
