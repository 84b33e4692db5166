// The scene as values: what shearbus.v1.Scene says, for rooms that never see protobuf. Absent options are nullopt; an
// effective scene has none left.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <utility>
#include <vector>

namespace shearbus::wire {

enum class Strategy { kUnspecified = 0, kVelocityDriven = 1, kForceDriven = 2 };
enum class FarBoundary { kUnspecified = 0, kInsulated = 1, kHalfSpace = 2 };
enum class TimeIntegrator { kUnspecified = 0, kBackwardEuler = 1, kSdirk2 = 2 };
enum class Heat { kUnspecified = 0, kProfile = 1, kModes = 2 };
enum class Drive { kUnspecified = 0, kLayerShear = 1, kInterfaceSlip = 2 };
enum class MeltingCurve { kUnspecified = 0, kConstant = 1, kLindemann = 2 };
enum class PressureTerm { kUnspecified = 0, kLinear = 1, kCompressed = 2 };
enum class InterfaceLaw { kUnspecified = 0, kSubgrid = 1, kCoulombTresca = 2, kFreeSlip = 3, kStick = 4 };
enum class Lists { kUnspecified = 0, kPaired = 1, kCombined = 2 };
enum class FarEnd { kUnspecified = 0, kTransmitting = 1, kFree = 2 };

// A material: catalog name (may be empty) and the constants given beside it, under their scene names
// ("density_kg_per_m3", ...). physics/material knows the same names.
struct Body {
  std::string material;
  std::vector<std::pair<std::string, double>> given;
  MeltingCurve melting_curve = MeltingCurve::kConstant;  // the soft body's
  PressureTerm pressure_term = PressureTerm::kLinear;    // the soft body's
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
  TimeIntegrator time_integrator = TimeIntegrator::kBackwardEuler;
  Heat heat = Heat::kProfile;
  std::optional<HeatModes> modes;  // of heat = modes; an effective scene of that kind has it
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
  double sound_speed_m_per_s = 0.0;
  double hugoniot_slope = 0.0;
  double grueneisen_coefficient = 0.0;
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

struct Hydro {
  InterfaceLaw interface_law = InterfaceLaw::kSubgrid;
  double end_time_s = 0.0;
  std::optional<double> dt_s;
  double cfl = 1.0;
  std::optional<ShearColumn> shear_column;
  CoulombTresca coulomb_tresca;
  std::optional<ConeTarget> cone_target;
};

struct Scene {
  std::string name;
  std::string source;
  Strategy strategy = Strategy::kUnspecified;
  Body soft;
  Body hard;
  Layer layer;
  std::optional<HardLayer> hard_layer;  // present: the hard body conducts
  VelocityDriven velocity_driven;
  std::optional<Interface> interface;  // force-driven only
  std::optional<Hydro> hydro;          // the guest's; never sent
};

}  // namespace shearbus::wire
