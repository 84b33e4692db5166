// Problems with exact or published solutions. Scenes and tests run the same problems.
//
// A problem is a struct; make_bodies() meshes it, and compare() compares a cycle with the solution at the cycle's time.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "hydro_stub/metal.hpp"
#include "hydro_stub/problem2d.hpp"

namespace shearbus::hydro {

// A strip along which plane waves run. It is two zones wide, and its sides are planes of symmetry. It lies along x in
// plane symmetry, along the axis in axisymmetry.
struct Strip {
  static constexpr int kRows = 2;
  lagrange::Symmetry symmetry;

  bool axial() const { return symmetry == lagrange::Symmetry::kAxisymmetric; }
  lagrange::Vec2 along(double v) const { return axial() ? lagrange::Vec2{0.0, v} : lagrange::Vec2{v, 0.0}; }
  double component(lagrange::Vec2 v) const { return axial() ? v.y : v.x; }
  lagrange::Block add(lagrange::Mesh& mesh, int zones, double from, double to) const;
  lagrange::Surface face(const lagrange::Block& block, bool far_end) const;
  void guide(lagrange::Bodies& bodies, const lagrange::Block& block) const;
  double stress(const lagrange::Cycle& cycle, int zone) const;
  // Returns the mean stress of the zones of the first block whose middle lies between `from` and `to`  [Pa].
  double mean_stress(const lagrange::Cycle& cycle, double from, double to) const;
};

struct PistonProblem {
  lagrange::Symmetry symmetry;
  Metal metal;
  double length;  // length of the strip of metal  [m]
  int zones;
  double speed;  // speed of the piston  [m/s]
};
struct FlyerProblem {
  lagrange::Symmetry symmetry;
  Metal target, flyer;
  double length;            // length of the target  [m]
  int zones;                // zones along the target; the flyer's zones have the same length
  double speed;             // speed of the flyer at impact  [m/s]
  double flyer_length = 0;  // 0: as the target  [m]
};
struct ImplosionProblem {
  bool sphere;
  // mesh of a cylinder: a sector of its cross section for kPlane, a slice of a long cylinder for kAxisymmetric
  lagrange::Symmetry symmetry;
  Metal metal;
  // inner and outer radius at the start, and inner radius at which the shell comes to rest  [m]
  double inner, outer, stop;
  int zones;  // zones across the shell
};
// The gas problems are in units of 1 m, 1 kg/m3 and 1 m/s.
struct NohProblem {
  lagrange::Symmetry symmetry;
  int zones;
};
struct SedovProblem {
  lagrange::Symmetry symmetry;
  int zones;
};
struct SaltzmanProblem {
  int zones;  // zones across the channel
};
struct TaylorProblem {
  Metal metal;
  double radius, length;  // of the rod  [m]
  double speed;           // speed of the rod at impact  [m/s]
  int zones;              // zones across the radius
};
struct PlatesProblem {
  Metal soft, hard;
  double length = 3e-3;              // length along the slide line  [m]
  double soft_depth = 0.4e-3;        // thickness of the soft plate  [m]
  double hard_depth = 0.4e-3;        // thickness of the hard plate  [m]
  double width = 20e-6;              // width of the soft zones; the hard zones are 5/4 as wide  [m]
  std::optional<double> first = {};  // thickness of the zones at the slide line; absent: as wide as the others  [m]
  double growth = 1.2;               // with `first`: ratio of neighbouring zones' thicknesses
  double jump = 100.0;               // initial velocity of the soft plate along the slide line  [m/s]
  double angle = 0.0;                // angle between the slide line and the x axis  [rad]
  double pressure = 1e9;             // pressure that holds the plates together  [Pa]
};

lagrange::Bodies make_bodies(const PistonProblem& problem);
lagrange::Bodies make_bodies(const FlyerProblem& problem);
lagrange::Bodies make_bodies(const ImplosionProblem& problem);
lagrange::Bodies make_bodies(const NohProblem& problem);
lagrange::Bodies make_bodies(const SedovProblem& problem);
lagrange::Bodies make_bodies(const SaltzmanProblem& problem);
lagrange::Bodies make_bodies(const TaylorProblem& problem);
lagrange::Bodies make_bodies(const PlatesProblem& problem);

// Nodes whose motion an experiment records: the target's far face, the side of the bar.
std::vector<int> free_surface(const FlyerProblem& problem, const lagrange::Bodies& bodies);
std::vector<int> free_surface(const TaylorProblem& problem, const lagrange::Bodies& bodies);

// compare() of a flyer and of a bar returns nothing where no solution is known: of a flyer once a wave has come back
// from a free face or where the metals harden, of a bar other than the one of the literature.
std::vector<Comparison> compare(const PistonProblem& problem, const lagrange::Cycle& cycle);
std::vector<Comparison> compare(const FlyerProblem& problem, const lagrange::Cycle& cycle);
std::vector<Comparison> compare(const ImplosionProblem& problem, const lagrange::Cycle& cycle);
std::vector<Comparison> compare(const NohProblem& problem, const lagrange::Cycle& cycle);
std::vector<Comparison> compare(const SedovProblem& problem, const lagrange::Cycle& cycle);
std::vector<Comparison> compare(const SaltzmanProblem& problem, const lagrange::Cycle& cycle);
std::vector<Comparison> compare(const TaylorProblem& problem, const lagrange::Cycle& cycle);
// Compares the plates with the exact solution for a constant friction stress `limit`, which may be 0 or infinity.
// Returns nothing once the shear wave has returned from the back of the hard plate.
std::vector<Comparison> compare(const PlatesProblem& problem, const lagrange::Cycle& cycle, double limit);

double shear_impedance(const physics::Material& metal);  // sqrt(rho G0)  [Pa s/m]

// Returns true once the inner surface of the imploding shell has come to rest.
bool at_rest(const ImplosionProblem& problem, const lagrange::Cycle& cycle);

// Makes the verification problem of a scene. Throws wire::Error{kInvalidScene} that names the field at fault.
Problem2d make_verification(const guest::HydroScene& scene);

}  // namespace shearbus::hydro
