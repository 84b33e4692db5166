// The macroscopic limit law used without a subgrid model (DLP 5): the paper's comparison.
//
//   |s| <= min( (mu_inf + (mu_0 - mu_inf) exp(-theta |[v]|)) P,  mu_T Y(P, T_cell, ep_cell) / sqrt(3) )
//
// T_cell is the temperature of the soft zone at the interface, which takes the soft body's share of the friction heat:
// it knows no layer thinner than itself. A host that computes its zones' temperature and plastic strain says them;
// otherwise the zone is heated here and, the bulk being elastic, ep_cell stays 0.
#pragma once

#include <span>
#include <vector>

#include "hydro_stub/hydro.pb.h"
#include "hydro_stub/interface_law.hpp"
#include "server/physics/interface/velocity_weakening.hpp"
#include "server/physics/material/material.hpp"

namespace shearbus::hydro {

class CoulombTrescaLaw : public InterfaceLaw {
 public:
  CoulombTrescaLaw(const guest::CoulombTresca& constants, const physics::Material& soft, const physics::Material& hard,
                   std::span<const double> initial_temperature);

  void advance(const InterfaceInputs& inputs, InterfaceAnswer& answer) override;
  LawTime time_spent() const override { return {.solver = spent_, .service = spent_, .waited = spent_, .cpu = spent_}; }

 private:
  void advance_node(const InterfaceInputs& inputs, std::size_t i, InterfaceAnswer& answer);

  physics::VelocityWeakening friction_;
  double yield_fraction_;  // mu_T
  physics::Material soft_;
  double heat_share_;                     // beta_T: of the friction heat, into the soft body
  std::vector<double> cell_temperature_;  // [K]
  std::chrono::nanoseconds spent_{0};
};

}  // namespace shearbus::hydro
