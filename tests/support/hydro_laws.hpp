// Interface laws with exact solutions, for tests of the mesh alone.
#pragma once

#include <algorithm>
#include <cmath>
#include <limits>

#include "hydro_stub/interface_law.hpp"
#include "hydro_stub/problem.hpp"

namespace shearbus::test {

// |s| = limit while the interface slips, any s up to it while it sticks. limit 0: free slip; infinite: bonded bodies.
class ConstantFrictionLaw : public hydro::InterfaceLaw {
 public:
  explicit ConstantFrictionLaw(double limit) : limit_(limit) {}

  void advance(const hydro::InterfaceInputs& in, hydro::InterfaceAnswer& out) override {
    for (std::size_t i = 0; i < in.velocity_jump.size(); ++i) {
      const hydro::FreeJump free = hydro::free_jump(in, i);
      const double sticking = free.jump / free.compliance;
      const bool sticks = std::abs(sticking) <= limit_;
      out.shear_stress[i] = sticks ? sticking : std::copysign(limit_, sticking);
      out.velocity_jump_new[i] = sticks ? 0.0 : free.jump - out.shear_stress[i] * free.compliance;
      out.sliding_velocity[i] = 0.5 * (in.velocity_jump[i] + out.velocity_jump_new[i]);
      out.interface_temperature[i] = 300.0;
      out.friction_heat[i] = std::max(0.0, out.shear_stress[i] * out.sliding_velocity[i] * in.dt);
      out.regime[i] = static_cast<std::uint8_t>(sticks ? wire::Regime::kStick : wire::Regime::kTresca);
    }
  }
  hydro::LawTime time_spent() const override { return {}; }

 private:
  double limit_;
};
inline constexpr double kFreeSlip = 0.0;
inline constexpr double kBonded = std::numeric_limits<double>::infinity();

// The paper's pair (server/physics/MODEL.md, constants), as far as elastic waves know it; dt is the transit time of a
// zone.
inline hydro::Problem aluminium_on_steel(std::vector<double> jumps, std::size_t zones, double length = 2e-3,
                                         double courant = 1.0) {
  hydro::Problem problem;
  problem.name = "aluminium_on_steel";
  problem.columns = jumps.size();
  problem.soft = {.columns = jumps.size(),
                  .zones = zones,
                  .zone_width = length / static_cast<double>(zones),
                  .density = 2703.0,
                  .shear_modulus = 27.6e9};
  problem.hard = {.columns = jumps.size(), .zones = zones, .density = 7900.0, .shear_modulus = 77e9};
  problem.hard.zone_width = problem.soft.transit_time() * problem.hard.wave_speed();
  problem.dt = courant * problem.soft.transit_time();
  problem.initial_temperature.assign(jumps.size(), 300.0);
  problem.pressure = hydro::PressureHistory({}, std::vector<double>(jumps.size(), 11.2e9));
  problem.initial_jump = std::move(jumps);
  return problem;
}

}  // namespace shearbus::test
