#include "server/physics/solver/parts.hpp"

#include <array>
#include <cmath>
#include <limits>
#include <memory>
#include <optional>
#include <utility>
#include <vector>

#include "server/physics/interface/friction_laws.hpp"
#include "server/physics/layer/heat_basis.hpp"
#include "server/physics/material/flow_laws.hpp"
#include "server/physics/solver/text.hpp"

namespace shearbus::physics {
namespace {

using enum Property;

// Returns a grid for the hard body: that of the scene's table [layer], but as thick as the depth that heat reaches in
// the hard body while it crosses the soft layer.
GridOptions matching_hard_grid(const ModelOptions& o) {
  GridOptions grid = o.grid;
  grid.thickness *= std::sqrt(o.hard.diffusivity / o.soft.diffusivity);
  return grid;
}

JunctionOptions typical_junctions(const ModelOptions& o) {
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
std::shared_ptr<const HeatTables> typical_heat_tables() {
  const std::vector<double> T{0.0, 400.0, 700.0, 1e5};
  return std::make_shared<const HeatTables>(
      HeatTables{{}, {}, {T, {1.05, 0.95, 0.75, 0.7}}, {T, {0.9, 1.05, 1.3, 1.4}}});
}

// Constants of Simon's curve that begin at the metal's melting temperature, with the steepness of common metals.
void give_typical_melting(Material& metal) {
  metal.simon_temperature = metal.melting_temperature;
  metal.simon_pressure = 10e9;
  metal.simon_exponent = 2.0;
}

// The melt of aluminium, roughly: latent heat and viscosity near its melting temperature.
constexpr MeltFilmOptions kTypicalMelt{.latent_heat = 4e5, .viscosity = 1e-3, .activation_energy = 0.0};

// Sets of properties, each used by several entries of kParts.
constexpr Properties kEitherStrategy{kVelocityDriven, kForceDriven};
constexpr Properties kEitherHardBody{kConductingHardBody, kFixedHeatShare};
constexpr Properties kFlow{kFirstOrderFlow, kFlowWithPressureTerm};
constexpr Properties kUnderPressure{kMeltingCurve, kCompressedPressureTerm};
// Strategies, drives, limits and contact options. With each, a step finds one stress at given temperatures; parts
// that change only the strength in this search (flow laws, pressure, melting), or that treat a step as a whole (sleep,
// tolerance), are therefore compatible with all of them.
constexpr Properties kStepOfALayer =
    kEitherStrategy | kEitherHardBody |
    Properties{kInterfaceSlip, kCoulombLimit, kPlasticLayer, kJunctions, kSlipDependentFriction};

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
         .is_on =
             [](const ModelOptions& o) {
               return o.strategy == Strategy::kVelocityDriven && o.drive == Drive::kInterfaceSlip;
             },
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
         .is_on =
             [](const ModelOptions& o) {
               return o.strategy == Strategy::kVelocityDriven && o.friction_coefficient.has_value();
             },
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
         .goes_with = kEitherStrategy | kEitherHardBody | Properties{kCoulombLimit, kPlasticHeating},
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
         .goes_with = kEitherStrategy | kEitherHardBody |
                      Properties{kInterfaceSlip, kCoulombLimit, kPlasticHeating, kInertia, kPlasticLayer},
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
         .goes_with = kEitherStrategy | kEitherHardBody |
                      Properties{kInterfaceSlip, kCoulombLimit, kPlasticHeating, kInertia, kPlasticLayer, kJunctions},
         .law_with = "friction law that depends on slip"},
    Part{.property = kFirstOrderFlow,
         .key = "soft.flow_law",
         .is_on = [](const ModelOptions& o) { return properties_of(o.soft.flow_law).first_order_in_time; },
         .goes_with = kStepOfALayer | Properties{kPlasticHeating, kInertia},
         .law_with = "flow law whose stress follows the mean rate of a step"},
    Part{.property = kFlowWithPressureTerm,
         .key = "soft.flow_law",
         .is_on = [](const ModelOptions& o) { return properties_of(o.soft.flow_law).has_pressure_term; },
         .goes_with = kStepOfALayer | Properties{kPlasticHeating, kInertia, kFirstOrderFlow},
         .law_with = "flow law with a pressure term"},
    Part{.property = kMeltingCurve,
         .key = "soft.melting_curve",
         .value = "\"lindemann\"",
         .is_on = [](const ModelOptions& o) { return o.soft.melting_curve == MeltingCurve::kLindemann; },
         .set = [](ModelOptions& o,
                   bool on) { o.soft.melting_curve = on ? MeltingCurve::kLindemann : MeltingCurve::kConstant; },
         .goes_with = kStepOfALayer | kFlow | Properties{kPlasticHeating, kInertia},
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
         .goes_with = kStepOfALayer | kFlow | Properties{kPlasticHeating, kInertia, kMeltingCurve},
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
         .goes_with = kStepOfALayer | kFlow | kUnderPressure | Properties{kPlasticHeating, kInertia},
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
         .goes_with = kStepOfALayer | kFlow | kUnderPressure | Properties{kPlasticHeating, kSecondOrder, kModes},
         .equation = "METHODS.md",
         .adds = "nodes at rest, open or stuck, are not solved; the answers differ by rounding only",
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
         .goes_with = kStepOfALayer | kFlow | kUnderPressure | Properties{kSecondOrder, kModes, kSleep},
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
         .goes_with = kEitherStrategy | kEitherHardBody | kFlow | kUnderPressure |
                      Properties{kCoulombLimit, kPlasticHeating, kPlasticLayer, kJunctions, kSlipDependentFriction,
                                 kSecondOrder, kModes, kSleep, kTolerance},
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
         .goes_with = kStepOfALayer | kFlow | kUnderPressure |
                      Properties{kPlasticHeating, kInertia, kSecondOrder, kModes, kSleep, kTolerance, kTwoComponents},
         .law_with = "friction law that depends on temperature"},
    Part{.property = kFrictionWithState,
         .key = "interface.friction_law",
         .is_on = [](const ModelOptions& o) { return has_friction(o) && !states_of(o.interface.friction_law).empty(); },
         .goes_with = kStepOfALayer | kFlow | kUnderPressure |
                      Properties{kPlasticHeating, kInertia, kSecondOrder, kModes, kTolerance, kTwoComponents,
                                 kTemperatureDependentFriction},
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
         .goes_with = kStepOfALayer | kFlow | kUnderPressure |
                      Properties{kPlasticHeating, kInertia, kSecondOrder, kModes, kSleep, kTolerance, kTwoComponents,
                                 kTemperatureDependentFriction, kFrictionWithState},
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
         .goes_with =
             kStepOfALayer | kFlow |
             Properties{kPlasticHeating, kInertia, kCompressedPressureTerm, kSecondOrder, kModes, kSleep, kTolerance,
                        kTwoComponents, kTemperatureDependentFriction, kFrictionWithState, kIsothermalEnd},
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
         .goes_with = kStepOfALayer | kFlow | kUnderPressure |
                      Properties{kPlasticHeating, kInertia, kSecondOrder, kModes, kSleep, kTolerance, kTwoComponents,
                                 kTemperatureDependentFriction, kFrictionWithState, kIsothermalEnd, kSimonMelting},
         .law_with = "flow law without the linear softening of DLP (15)"},
    Part{.property = kFlowingLayer,
         .key = "strategy",
         .is_on = [](const ModelOptions& o) { return o.strategy == Strategy::kVelocityDriven || o.plastic_layer; },
         .goes_with = kStepOfALayer | kFlow | kUnderPressure |
                      Properties{kPlasticHeating, kInertia, kSecondOrder, kSleep, kTolerance, kTwoComponents,
                                 kTemperatureDependentFriction, kFrictionWithState, kIsothermalEnd, kSimonMelting,
                                 kFlowWithoutBracket}},
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
         .goes_with = kEitherStrategy | kFlow | kUnderPressure |
                      Properties{kInterfaceSlip, kCoulombLimit, kConductingHardBody, kPlasticHeating, kInertia,
                                 kPlasticLayer, kJunctions, kSlipDependentFriction, kSecondOrder, kSleep, kTolerance,
                                 kTwoComponents, kTemperatureDependentFriction, kFrictionWithState, kIsothermalEnd,
                                 kSimonMelting, kFlowWithoutBracket, kFlowingLayer},
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
constexpr std::array kChoices = {Properties{kVelocityDriven, kForceDriven},
                                 Properties{kConductingHardBody, kFixedHeatShare},
                                 Properties{kMeltingCurve, kSimonMelting}};
constexpr std::size_t kWholeChoices = 2;

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

// A check of one option alone: returns a refusal, or nothing if the value of the option is allowed.
using Limit = std::optional<Refusal> (*)(const ModelOptions&);

std::optional<Refusal> most_cells(std::string key, int most, int found) {
  if (found <= most) return {};
  std::string text = text_of(key, " works with at most ", most, " cells, found ", found);
  return Refusal{std::move(key), std::move(text), "Take fewer cells that grow with the depth (layer.grading)."};
}

// A table of k(T) or c(T) must reach from the temperature of the start to melting.
std::optional<Refusal> short_table(const ModelOptions& o) {
  for (const HeatTableKeys& keys : kHeatTables) {
    const std::vector<double>& rows = (heat_tables(o).*keys.table).temperature;
    if (rows.empty()) continue;
    if (rows.front() <= o.initial_temperature && rows.back() >= o.soft.melting_temperature) continue;
    return Refusal{keys.temperatures,
                   text_of(keys.temperatures, " reaches from ", rows.front(), " to ", rows.back(),
                           " K, and the bodies from the start at ", o.initial_temperature, " K to melting at ",
                           o.soft.melting_temperature, " K"),
                   "Give the table rows for that range."};
  }
  return {};
}

constexpr std::array<Limit, 11> kLimits = {
    short_table,
    [](const ModelOptions& o) -> std::optional<Refusal> {
      if (!o.inertia || o.strategy != Strategy::kForceDriven || o.plastic_layer) return {};
      return Refusal{"layer.inertia",
                     "layer.inertia = true lets waves cross the layer, and a layer that is rigid moves with the soft "
                     "body, whose mass has its own already",
                     "Leave it out, or set interface.plastic_layer = true."};
    },
    [](const ModelOptions& o) -> std::optional<Refusal> {
      if (!o.inertia || o.strategy != Strategy::kForceDriven || !o.taylor_quinney_factor) return {};
      return Refusal{
          "interface.taylor_quinney_factor",
          "interface.taylor_quinney_factor does not go with layer.inertia under force: bodies that give way may "
          "shear a layer by any amount, and the heat in place of a vertex next to melting is then lost in the "
          "last digits of its temperature",
          "Leave out one of the two."};
    },
    [](const ModelOptions& o) -> std::optional<Refusal> {
      if (!o.taylor_quinney_factor || o.strategy != Strategy::kForceDriven || o.plastic_layer) return {};
      return Refusal{"interface.taylor_quinney_factor",
                     "interface.taylor_quinney_factor heats where the layer flows, and a layer that is rigid does no "
                     "plastic work",
                     "Leave it out, or set interface.plastic_layer = true."};
    },
    [](const ModelOptions& o) -> std::optional<Refusal> {
      if (!o.inertia) return {};
      return most_cells("layer.inertia", kMaxInertiaCells, o.grid.cells);
    },
    [](const ModelOptions& o) -> std::optional<Refusal> {
      if (!o.sleep) return {};
      return most_cells("layer.sleep", kMaxSleepCells, o.grid.cells + (o.hard_grid ? o.hard_grid->cells : 0));
    },
    [](const ModelOptions& o) -> std::optional<Refusal> {
      if (!o.modes || !(o.modes->longest_time < o.modes->shortest_step)) return {};
      return Refusal{"layer.modes.longest_time_s",
                     text_of("layer.modes.longest_time_s = ", o.modes->longest_time,
                             " s is below layer.modes.shortest_step_s = ", o.modes->shortest_step, " s"),
                     "Give a longest_time_s of at least shortest_step_s."};
    },
    [](const ModelOptions& o) -> std::optional<Refusal> {
      if (o.hard.melting_curve == MeltingCurve::kConstant) return {};
      return Refusal{"hard.melting_curve",
                     "hard.melting_curve changes the strength of a body, and only that of the soft body is computed",
                     "Give it to [soft]."};
    },
    [](const ModelOptions& o) -> std::optional<Refusal> {
      if (o.hard.pressure_term == PressureTerm::kLinear) return {};
      return Refusal{"hard.pressure_term",
                     "hard.pressure_term changes the strength of a body, and only that of the soft body is computed",
                     "Give it to [soft]."};
    },
    [](const ModelOptions& o) -> std::optional<Refusal> {
      const std::string_view missing = constant_missing_for_options(o.soft);
      if (missing.empty()) return {};
      const std::string key = "soft." + std::string(missing);
      return Refusal{
          key,
          key + (o.soft.melting_curve == MeltingCurve::kSimon && missing.starts_with("simon")
                     ? " is missing: melting_curve = \"simon\" needs the constants of the curve"
                     : " is missing: melting_curve = \"lindemann\" and pressure_term = \"compressed\" need the "
                       "compression at a pressure"),
          "Give it, or leave both options at their defaults."};
    },
    [](const ModelOptions& o) -> std::optional<Refusal> {
      const LawFault fault = FrictionLaws::with(
          o.interface.friction_law, [&](auto own) { return decltype(own)::type::fault_of(o.interface, o.soft); });
      if (fault.field.empty()) return {};
      const std::string key = "interface." + std::string(fault.field);
      return Refusal{key, key + ": " + std::string(fault.text), "Give a value within these bounds."};
    },
};

constexpr const Part& part_of_table(Property property) {
  return kParts[static_cast<std::size_t>(property)];
}

constexpr const Exclusion* exclusion_of(Property a, Property b, std::span<const Exclusion> exclusions) {
  for (const Exclusion& e : exclusions)
    if ((e.first.has(a) && e.second.has(b)) || (e.first.has(b) && e.second.has(a))) return &e;
  return nullptr;
}

constexpr bool alternatives(Property a, Property b) {
  for (const Properties& choice : kChoices)
    if (a != b && choice.has(a) && choice.has(b)) return true;
  return false;
}

// Calls `with` for each property that is surely on where `of` is, `of` among them, until a call returns true.
template <class With>
constexpr bool any_needed(Property of, const With& with) {
  if (with(of)) return true;
  for (int p = 0; p < kProperties; ++p) {
    const auto needed = static_cast<Property>(p);
    if (static_cast<int>(of) < kProperties && part_of_table(of).needs.has(needed) && with(needed)) return true;
  }
  return false;
}

// Whether the tables rule out a model with both properties: they or what they need are alternatives or exclude each
// other, or of a choice that every model has to make each part is ruled out by one of them.
constexpr bool never_meet(Property a, Property b, std::span<const Exclusion> exclusions) {
  const auto apart = [&](Property of_a, Property of_b) {
    return any_needed(of_a, [&](Property x) {
      return any_needed(of_b,
                        [&](Property y) { return alternatives(x, y) || exclusion_of(x, y, exclusions) != nullptr; });
    });
  };
  if (apart(a, b)) return true;
  for (std::size_t c = 0; c < kWholeChoices; ++c) {
    bool ruled_out = true;
    for (int p = 0; p < kProperties; ++p) {
      const auto part = static_cast<Property>(p);
      if (kChoices[c].has(part) && !apart(a, part) && !apart(b, part)) ruled_out = false;
    }
    if (ruled_out) return true;
  }
  return false;
}

// Whether the tables say for every two parts if a model may have both: either the later part lists the earlier one in
// `goes_with`, or the pair is excluded (but not both), or no allowed model can have both (and then no row may say so).
constexpr bool every_pair_is_decided(std::span<const Part> rows, std::span<const Exclusion> exclusions) {
  for (std::size_t j = 0; j < rows.size(); ++j) {
    for (std::size_t i = 0; i < j; ++i) {
      const Property a = rows[i].property, b = rows[j].property;
      const bool excluded = exclusion_of(a, b, exclusions) != nullptr;
      const bool listed = rows[j].goes_with.has(a);
      if (excluded && listed) return false;
      if (!excluded && !listed && !never_meet(a, b, exclusions)) return false;
    }
  }
  return true;
}
static_assert(every_pair_is_decided(kParts, kExclusions));

// Whether the cost of every option has been measured.
constexpr bool every_option_has_its_cost(std::span<const Part> rows) {
  for (const Part& row : rows)
    if (row.set != nullptr && row.cost.empty()) return false;
  return true;
}
static_assert(every_option_has_its_cost(kParts), "tests/bench/option_costs.py measures the cost of an option");

std::string all_texts(const std::vector<Refusal>& refusals) {
  std::string all;
  for (const Refusal& r : refusals) all += (all.empty() ? "" : "\n") + r.text;
  return all;
}

}  // namespace

std::span<const Part> parts() {
  return kParts;
}
const Part& part_of(Property property) {
  return kParts[static_cast<std::size_t>(property)];
}
std::string unique_key(const Part& part) {
  std::string name(part.key);
  for (const Part& earlier : kParts) {
    if (earlier.property >= part.property) break;
    if (earlier.set != nullptr && earlier.key == part.key) return name + " = " + std::string(part.value);
  }
  return name;
}
std::string_view key_of(const Part& part, const ModelOptions& options) {
  const bool forced = options.strategy == Strategy::kForceDriven;
  const auto given = [](double slope) { return std::isfinite(slope) && slope != 0.0; };
  if (part.property == kVaryingHeat && conducts_by_temperature(options)) {
    if (!options.soft.conducts_by_temperature())
      for (const HeatTableKeys& keys : kHeatTables)
        if (!(heat_tables(options).*keys.table).empty()) return keys.values;
    const bool of_soft = options.soft.conducts_by_temperature();
    const bool conducts = given((of_soft ? options.soft : options.hard).conductivity_slope);
    if (of_soft) return conducts ? part.key : "soft.specific_heat_slope_per_k";
    return conducts ? "hard.thermal_conductivity_slope_per_k" : "hard.specific_heat_slope_per_k";
  }
  return part.property == kPlasticHeating && forced ? "interface.taylor_quinney_factor" : part.key;
}
std::string setting_of(const Part& part, const ModelOptions& options) {
  std::string key(key_of(part, options));
  if (part.property == kFixedHeatShare) return "no table [" + key + "]";
  if (part.property == kFlowingLayer)
    return setting_of(part_of(options.plastic_layer ? kPlasticLayer : kVelocityDriven), options);
  if (part.property == kCoulombLimit || part.property == kPlasticHeating || part.property == kTolerance ||
      part.property == kVaryingHeat)
    return key;
  if (!part.value.empty()) return key + " = " + std::string(part.value);
  if (key == "interface.friction_law")
    return key + " = \"" + std::string(FrictionLaws::name_of(options.interface.friction_law)) + "\"";
  if (key == "soft.flow_law") return key + " = \"" + std::string(FlowLaws::name_of(options.soft.flow_law)) + "\"";
  return "[" + key + "]";
}

std::string name_of(const Part& part, const ModelOptions& options) {
  if (part.property == kFlowingLayer) return "a layer that flows";
  return part.law_with.empty() ? setting_of(part, options) : text_of("a ", part.law_with);
}

std::span<const Exclusion> exclusions() {
  return kExclusions;
}
std::span<const Properties> choices() {
  return kChoices;
}

bool go_together(const Part& a, const Part& b, std::span<const Exclusion> exclusions) {
  if (exclusion_of(a.property, b.property, exclusions) != nullptr) return false;
  return (a.property < b.property ? b : a).goes_with.has((a.property < b.property ? a : b).property);
}

std::vector<Refusal> refusals(const ModelOptions& options) {
  return refusals(options, kParts, kExclusions);
}

std::vector<Refusal> refusals(const ModelOptions& options, std::span<const Part> parts,
                              std::span<const Exclusion> exclusions) {
  std::vector<Refusal> found;
  const auto refuse = [&](const Part& named, const Part& other, std::string_view reason) {
    if (other.property == kFixedHeatShare) {
      const std::string setting = setting_of(named, options), table = text_of("[", key_of(other, options), "]");
      found.push_back({std::string(key_of(named, options)), text_of(setting, " needs ", table, ": ", reason),
                       text_of("Give ", table, ", or leave out ", setting, ".")});
      return;
    }
    found.push_back(
        {std::string(key_of(named, options)),
         setting_of(named, options) + " does not go with " + setting_of(other, options) + ": " + std::string(reason),
         "Leave out one of the two."});
  };
  std::vector<const Part*> on;
  for (const Part& part : parts)
    if (part.is_on(options)) on.push_back(&part);
  for (std::size_t j = 0; j < on.size(); ++j) {
    for (std::size_t i = 0; i < j; ++i) {
      const Part &earlier = *on[i], &later = *on[j];
      if (const Exclusion* e = exclusion_of(earlier.property, later.property, exclusions)) {
        e->first.has(later.property) ? refuse(later, earlier, e->reason) : refuse(earlier, later, e->reason);
      } else if (!go_together(earlier, later, exclusions) &&
                 !never_meet(earlier.property, later.property, exclusions)) {
        refuse(later, earlier, "nothing is known of the two together");
      }
    }
  }
  for (const Part* part : on) {
    if (part->property == kPlasticHeating || part->property == kInertia) continue;  // kLimits says it with the reason
    for (const Part& needed : parts) {
      if (!part->needs.has(needed.property) || needed.is_on(options)) continue;
      found.push_back({std::string(key_of(*part, options)),
                       text_of(setting_of(*part, options), " is an option of ", name_of(needed, options)),
                       text_of("Leave it out, or take ", name_of(needed, options), ".")});
    }
  }
  for (const Limit limit : kLimits)
    if (std::optional<Refusal> refusal = limit(options)) found.push_back(*std::move(refusal));
  return found;
}

Properties properties_of(const ModelOptions& options) {
  Properties on;
  for (const Part& part : kParts)
    if (part.is_on(options)) on.add(part.property);
  return on;
}

bool only_open_is_second_order(const ModelOptions& options) {
  const bool rate_flows = options.strategy == Strategy::kVelocityDriven && !options.inertia &&
                          properties_of(options.soft.flow_law).first_order_in_time;
  const auto& law = options.interface.friction_law;
  return (options.plastic_layer && !options.inertia) || options.junctions || options.melt_film ||
         options.taylor_quinney_factor || rate_flows ||
         (has_friction(options) && (properties_of(law).depends_on_slip() || !states_of(law).empty()));
}

bool goes_with(Property property, const ModelOptions& options) {
  const Properties on = properties_of(options);
  for (const Part& part : kParts)
    if (part.property != property && on.has(part.property) && !go_together(part, part_of(property), kExclusions))
      return false;
  return true;
}

ModelOptions switched(ModelOptions options, const Part& part, bool on) {
  part.set(options, on);
  return options.tolerance ? discretised(options, *options.tolerance) : options;
}

RefusedOptions::RefusedOptions(std::vector<Refusal> found)
    : std::invalid_argument(all_texts(found)), refusals(std::move(found)) {}

}  // namespace shearbus::physics
