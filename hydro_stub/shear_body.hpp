// One elastic body of many independent columns: plane shear waves along z on a staggered mesh, as in Lagrangian
// hydrocodes after Wilkins. Velocities are defined on nodes at half time levels, shear stresses in zones at whole
// levels:
//
//      V0      V1      V2            VN        n-1/2, n+1/2, ...
//      o---x---o---x---o--- ... --x---o
//       tau0    tau1         tauN-1            n, n+1, ...
//   interface                      far end
//
// Coordinates run from the interface outward, so that both bodies use the same code: with zeta the distance from the
// interface, rho dV/dt = d(tau)/d(zeta) and d(tau)/dt = G dV/d(zeta). The stress tau is +sigma_xz in the soft body
// (zeta = z) and -sigma_xz in the hard body (zeta = -z). Arrays are [node or zone][column], column fastest.
#pragma once

#include <cstddef>
#include <optional>
#include <span>
#include <vector>

#include "hydro_stub/hydro.pb.h"

namespace shearbus::hydro {

struct BodyMesh {
  std::size_t columns = 1;
  std::size_t zones = 2;
  double zone_width = 0.0;          // width of the zone at the interface  [m]
  std::vector<double> widths = {};  // widths of all zones from the interface outward; empty: all as the first  [m]
  double density = 0.0;             // [kg/m3]
  double shear_modulus = 0.0;       // [Pa]
  guest::FarEnd far_end = guest::FAR_END_TRANSMITTING;

  double width(std::size_t zone) const { return widths.empty() ? zone_width : widths[zone]; }
  double wave_speed() const;                                            // [m/s]
  double impedance() const;                                             // shear impedance rho c  [Pa s/m]
  double transit_time() const { return zone_width / wave_speed(); }     // wave transit time of one zone  [s]
  double half_zone_mass() const { return 0.5 * density * zone_width; }  // half the zone at the interface  [kg/m2]
  double last_half_zone_mass() const;                                   // half the zone at the far end  [kg/m2]
};

struct ShearBody {
  ShearBody(const BodyMesh& body_mesh, std::span<const double> velocity_of_columns);

  double* velocity_at(std::size_t node) { return velocity.data() + node * mesh.columns; }
  const double* velocity_at(std::size_t node) const { return velocity.data() + node * mesh.columns; }
  double* stress_at(std::size_t zone) { return stress.data() + zone * mesh.columns; }
  const double* stress_at(std::size_t zone) const { return stress.data() + zone * mesh.columns; }

  BodyMesh mesh;
  std::vector<double> velocity;      // [zones+1][columns]  [m/s]
  std::vector<double> stress;        // shear stress tau, [zones][columns]  [Pa]
  std::vector<double> far_velocity;  // velocity of the undisturbed body behind a transmitting end  [m/s]
  std::vector<double> far_impulse;   // impulse of the far end on the body since the start  [Pa s]
  std::vector<double> far_work;      // work of the far end on the body since the start  [J/m2]
};

// Advances the velocities of all nodes except the interface node by dt, with the stresses at time level n.
void accelerate(ShearBody& body, double dt);

// Advances the velocity of the interface node, whose mass is half the mass of a zone. A positive stress tau of the
// first zone pulls the node outward, away from the interface; a positive `traction` pulls the node toward the other
// body.
void accelerate_interface(ShearBody& body, double dt, std::span<const double> traction);

// Advances the stresses from time level n to n+1 with the velocities at n+1/2. The body is elastic.
void strain(ShearBody& body, double dt);

// A place in a body at a given distance from the interface, between nodes `node` and `node` + 1.
struct BodyPlace {
  std::size_t node = 0;
  double weight = 0.0;  // of node + 1; the rest is that of `node`
};
// Returns the place; nothing if the body is shorter.
std::optional<BodyPlace> place_at(const BodyMesh& mesh, double distance);
double velocity_at(const ShearBody& body, const BodyPlace& place, std::size_t column);

// Returns the momentum of one column  [Pa s].
double momentum(const ShearBody& body, std::size_t column);

// Returns the energy of one column after strain(): kinetic at n+1/2 plus elastic from the product of the stresses at n
// and n+1. The leapfrog conserves this sum to rounding  [J/m2].
double energy(const ShearBody& body, std::size_t column, double dt);

}  // namespace shearbus::hydro
