// The scene as values: what shearbus.v1.Scene says, for rooms that never see protobuf. Absent options are nullopt; an
// effective scene has none left.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "proto/wire/columns.hpp"

namespace shearbus::wire {

enum class FarBoundary { kUnspecified = 0, kInsulated = 1, kHalfSpace = 2 };
enum class TimeIntegrator { kUnspecified = 0, kBackwardEuler = 1, kSdirk2 = 2 };
enum class Heat { kUnspecified = 0, kProfile = 1, kModes = 2 };
enum class Drive { kUnspecified = 0, kLayerShear = 1, kInterfaceSlip = 2 };
enum class MeltingCurve { kUnspecified = 0, kConstant = 1, kLindemann = 2 };
enum class PressureTerm { kUnspecified = 0, kLinear = 1, kCompressed = 2 };
enum class FlowLaw { kUnspecified = 0, kSteinbergCochranGuinan = 1, kJohnsonCook = 2 };
enum class FrictionLaw { kUnspecified = 0, kConstant = 1, kVelocityWeakening = 2 };
enum class InterfaceLaw {
  kUnspecified = 0,
  kSubgrid = 1,
  kCoulombTresca = 2,
  kFreeSlip = 3,
  kStick = 4,
  kConstant = 5
};
enum class Lists { kUnspecified = 0, kPaired = 1, kCombined = 2 };
enum class Symmetry { kUnspecified = 0, kPlane = 1, kAxisymmetric = 2 };
enum class Shell { kUnspecified = 0, kCylinder = 1, kSphere = 2 };
enum class GasTest { kUnspecified = 0, kNoh = 1, kSedov = 2, kSaltzman = 3 };
enum class FarEnd { kUnspecified = 0, kTransmitting = 1, kFree = 2 };

// A material: catalog name (may be empty) and the constants given beside it, under their scene names
// ("density_kg_per_m3", ...). physics/material knows the same names.
struct Body {
  std::string material;
  std::vector<std::pair<std::string, double>> given;
  MeltingCurve melting_curve = MeltingCurve::kConstant;  // the soft body's
  PressureTerm pressure_term = PressureTerm::kLinear;    // the soft body's
  FlowLaw flow_law = FlowLaw::kUnspecified;              // the catalog's

  bool given_at_all() const { return !material.empty() || !given.empty(); }
};

struct HeatModes {
  double accuracy = 1e-6;
  double shortest_step_s = 1e-10;
  double longest_time_s = 1e-4;
};

struct Layer {
  double thickness_m = 20e-6;
  std::uint32_t cells = 500;
  double grading = 1.0;
  FarBoundary far_boundary = FarBoundary::kInsulated;
  double initial_temperature_k = 300.0;
  bool inertia = false;
  TimeIntegrator time_integrator = TimeIntegrator::kBackwardEuler;
  Heat heat = Heat::kProfile;
  std::optional<HeatModes> modes;  // of heat = modes; an effective scene of that kind has it
  bool sleep = false;
};

struct HardLayer {
  std::optional<double> thickness_m;
  std::optional<std::uint32_t> cells;
  std::optional<double> grading;
  FarBoundary far_boundary = FarBoundary::kUnspecified;
};

struct VelocityDriven {
  Drive drive = Drive::kLayerShear;
  std::optional<double> friction_coefficient;
  std::optional<double> taylor_quinney_factor;
};

struct Interface {
  double friction_coefficient = 0.0;
  double yield_strength_pa = 0.0;
  bool plastic_layer = false;
  FrictionLaw friction_law = FrictionLaw::kConstant;
  double friction_coefficient_fast = 0.0;  // of velocity_weakening, as is the next
  double velocity_decay_s_per_m = 0.0;
};

struct Junctions {
  double contact_fraction = 1.0;
  double height_m = 0.0;
  std::optional<double> yield_strength_max_pa;  // these three: absent is as the soft body
  std::optional<double> hardening_coefficient;
  std::optional<double> hardening_exponent;
};

struct ShearColumn {
  double length_m = 0.0;
  std::uint32_t zones = 0;
  FarEnd far_end = FarEnd::kTransmitting;
  std::vector<double> velocity_jump_m_per_s;
  std::vector<double> initial_temperature_k;
  std::vector<double> pressure_pa;
  std::vector<double> pressure_time_s;
  Lists lists = Lists::kPaired;
};

struct CoulombTresca {
  double friction_coefficient_at_rest = 0.3;
  double friction_coefficient_fast = 0.02;
  double velocity_decay_s_per_m = 0.01;
  double yield_fraction = 1.0;
};

struct MieGrueneisen {
  std::optional<double> sound_speed_m_per_s;
  std::optional<double> hugoniot_slope;
  std::optional<double> grueneisen_coefficient;
  std::optional<double> tension_limit_pa;
};

struct ConeTarget {
  double length_m = 20e-3;
  double front_radius_m = 8e-3;
  double back_radius_m = 5e-3;
  double confinement_radius_m = 20e-3;
  double flyer_thickness_m = 10e-3;
  double flyer_speed_m_per_s = 568.0;
  double zone_width_m = 0.2e-3;
  double courant = 0.5;
  double history_interval_s = 20e-9;
  std::uint32_t frames = 24;
  MieGrueneisen soft_eos;
  MieGrueneisen hard_eos;
};

struct Piston {
  Symmetry symmetry = Symmetry::kPlane;
  double length_m = 50e-3;
  std::uint32_t zones = 200;
  double speed_m_per_s = 100.0;
};

struct FlyerImpact {
  Symmetry symmetry = Symmetry::kPlane;
  double length_m = 10e-3;
  std::uint32_t zones = 200;
  double speed_m_per_s = 600.0;
};

struct Implosion {
  Shell shell = Shell::kCylinder;
  Symmetry symmetry = Symmetry::kAxisymmetric;
  double inner_radius_m = 80e-3;
  double outer_radius_m = 100e-3;
  double stop_radius_m = 50e-3;
  std::uint32_t zones = 20;
};

struct GasFlow {
  GasTest test = GasTest::kUnspecified;
  Symmetry symmetry = Symmetry::kPlane;
  std::uint32_t zones = 40;
};

struct TaylorBar {
  double radius_m = 3.2e-3;
  double length_m = 32.4e-3;
  double speed_m_per_s = 227.0;
  std::uint32_t zones = 10;
};

struct SlidingPlates {
  double length_m = 2e-3;
  double soft_depth_m = 0.4e-3;
  double hard_depth_m = 0.4e-3;
  double zone_width_m = 20e-6;
  double velocity_jump_m_per_s = 100.0;
  double angle_deg = 0.0;
  double pressure_pa = 1e9;
};

struct Hydro {
  InterfaceLaw interface_law = InterfaceLaw::kSubgrid;
  double end_time_s = 0.0;
  std::optional<double> dt_s;
  double cfl = 1.0;
  std::optional<ShearColumn> shear_column;
  CoulombTresca coulomb_tresca;
  std::optional<ConeTarget> cone_target;
  std::optional<Piston> piston;
  std::optional<FlyerImpact> flyer_impact;
  std::optional<Implosion> implosion;
  std::optional<GasFlow> gas_flow;
  std::optional<TaylorBar> taylor_bar;
  std::optional<SlidingPlates> sliding_plates;
  std::optional<double> constant_shear_stress_pa;
};

struct Scene {
  std::string name;
  std::string source;
  Strategy strategy = Strategy::kUnspecified;
  Body soft;
  Body hard;
  Layer layer;
  std::uint32_t tangential_components = 1;  // 1 or 2
  std::optional<double> tolerance;  // in place of the layer's cells, grading, time integrator and heat, then as default
  std::optional<HardLayer> hard_layer;  // present: the hard body conducts
  VelocityDriven velocity_driven;
  std::optional<Interface> interface;  // force-driven only
  std::optional<Junctions> junctions;  // force-driven only
  std::optional<Hydro> hydro;          // the guest's; never sent
};

}  // namespace shearbus::wire
