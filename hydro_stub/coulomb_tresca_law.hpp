// The macroscopic limit law without a subgrid model (DLP 5), to which the paper compares the subgrid model. Coulomb
// friction and yield limit the shear stress s:
//
//   |s| <= min( (mu_inf + (mu_0 - mu_inf) exp(-theta v)) P,  mu_T Y(P, T_cell, ep_cell) / sqrt(3) )
//
// Here mu_0 and mu_inf are the friction coefficients at rest and at high sliding velocity v, theta is the decay of
// friction with velocity [s/m], P the pressure, Y the flow stress of the soft body and mu_T the yield fraction. T_cell
// and ep_cell are temperature and plastic strain of the soft zone at the interface. The soft body's share of the
// friction heat is spread over this whole zone: the law resolves no layer thinner than the zone. A host that computes
// the temperature and plastic strain of its zones passes both; otherwise this class heats the zone, and ep_cell stays 0
// because the bulk is then elastic.
#pragma once

#include <span>
#include <vector>

#include "hydro_stub/hydro.pb.h"
#include "hydro_stub/interface_law.hpp"
#include "server/physics/interface/stress_limit.hpp"
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

  physics::InterfaceOptions friction_;
  double yield_fraction_;  // factor mu_T of the Tresca limit
  physics::Material soft_;
  double heat_share_;                     // share of the friction heat that enters the soft body
  std::vector<double> cell_temperature_;  // temperature T_cell of the soft zone at each node  [K]
  std::chrono::nanoseconds spent_{0};
};

}  // namespace shearbus::hydro
