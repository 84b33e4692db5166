// Strength and heat of a shear column: the soft body yields by its flow stress, its plastic work heats it, and both bodies
// conduct. Without this the bodies of a shear column are elastic.
#pragma once

#include <cstddef>
#include <span>
#include <vector>

#include "hydro_stub/shear_body.hpp"
#include "server/physics/material/material.hpp"

namespace shearbus::hydro {

class ShearBulk {
 public:
  // conducts_across: heat crosses the interface, as between bodies without a layer of their own between them
  ShearBulk(const physics::Material& soft, const physics::Material& hard, const ShearBody& soft_body,
            const ShearBody& hard_body, std::span<const double> temperature, bool conducts_across);

  // Advances the stresses of the soft body: elastic trial, then radial return to the flow stress at the plastic strain
  // after the step. The plastic work heats the zones.
  void strain_soft(ShearBody& body, double dt, std::span<const double> pressure);
  // Adds heat [J/m2] to the zones of both bodies at the interface, per column.
  void heat_interface(std::span<const double> soft, std::span<const double> hard);
  // Advances the temperatures by conduction, explicitly.
  void conduct(double dt);

  // State of the soft zone at the interface, per column.
  std::span<const double> temperature() const { return {soft_temperature_.data(), columns_}; }
  std::span<const double> plastic_strain() const { return {plastic_strain_.data(), columns_}; }
  std::span<const double> plastic_rate() const { return plastic_rate_; }  // of the last step, signed  [1/s]
  double hottest(std::size_t column) const;                               // hottest soft zone  [K]

  // Energy of the soft body after strain_soft(), as energy() of an elastic body, and plastic work since the start; their
  // sum changes by the work of the ends alone, to rounding  [J/m2].
  double energy(const ShearBody& body, std::size_t column) const;
  double plastic_work(std::size_t column) const { return plastic_work_[column]; }

 private:
  struct Conductor {
    double conductivity, diffusivity;  // [W/(m K)], [m2/s]
    std::vector<double> width;         // of each zone, from the interface outward  [m]
  };
  void conduct_inside(const Conductor& body, double dt, std::vector<double>& temperature);

  physics::Material metal_;
  std::size_t columns_;
  Conductor soft_, hard_;
  bool conducts_across_;
  std::vector<double> soft_temperature_, hard_temperature_;  // [zones][columns]  [K]
  std::vector<double> plastic_strain_;                       // [zones][columns]
  std::vector<double> increment_;                            // signed plastic shear of the last step, [zones][columns]
  std::vector<double> stress_old_;                           // stress before the last step, [zones][columns]  [Pa]
  std::vector<double> plastic_rate_, plastic_work_;
  std::vector<double> flux_;  // work array
};

}  // namespace shearbus::hydro
