// The state of all bodies at one time: arrays over nodes and zones.
#pragma once

#include <vector>

#include "hydro_stub/lagrange/vec2.hpp"

namespace shearbus::lagrange {

// Masses, volumes and energies are per metre of depth (plane) or per radian (axisymmetric).
struct State {
  State(int nodes, int zones) : position(nodes), velocity(nodes), node_mass(nodes) {
    for (std::vector<double>* values : {&mass, &volume, &density, &energy, &pressure, &sound_speed, &temperature,
                                        &deviator_xx, &deviator_yy, &deviator_xy, &plastic_strain})
      values->resize(zones);
  }

  double time = 0.0;  // [s]
  // Arrays with one value per node.
  std::vector<Vec2> position;     // [m]
  std::vector<Vec2> velocity;     // [m/s]
  std::vector<double> node_mass;  // [kg]
  // Arrays with one value per zone.
  std::vector<double> mass;         // [kg]
  std::vector<double> volume;       // [m3]
  std::vector<double> density;      // [kg/m3]
  std::vector<double> energy;       // specific internal energy, elastic shear energy included  [J/kg]
  std::vector<double> pressure;     // compression positive  [Pa]
  std::vector<double> sound_speed;  // speed of longitudinal waves  [m/s]
  std::vector<double> temperature;  // [K]
  std::vector<double> deviator_xx;  // [Pa]
  std::vector<double> deviator_yy;
  std::vector<double> deviator_xy;
  std::vector<double> plastic_strain;  // equivalent plastic strain
};

}  // namespace shearbus::lagrange
