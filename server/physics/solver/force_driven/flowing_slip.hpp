// The force-driven step of one lane whose layer may flow (server/physics/MODEL.md, "Plastic layer"): DLP (48), (61),
// (64) and the interface law, solved together for s, [v], T0 and ep. The search asks its caller for the layer's flow:
// stress() and flux() are the load on the layer, and update() receives the flow under this load. The caller runs the
// searches of all lanes (nodes stepped together) side by side, because it computes their flow in one pass.
#pragma once

#include "server/physics/solver/flow/heated.hpp"
#include "server/physics/solver/flow/layer_flow.hpp"
#include "server/physics/solver/flow/root_search.hpp"
#include "server/physics/solver/force_driven/rigid_slip.hpp"

namespace shearbus::physics {

// A lane (one of 8 nodes stepped together) at the start of a step, with its contact closed.
struct FlowingStart {
  StressLimit limit;    // stress limit s_lim(T0) of the interface
  double ceiling;       // stress that the fully hardened layer carries where g = 1; infinity: no ceiling  [Pa]
  bool knows_nearby;    // update() is told the flow under loads nearby
  bool hardens;         // false: the strength of the layer does not grow, and it flows only at its ceiling
  double first_weight;  // length along z that belongs to the vertex at z = 0  [m]
  double first_strain;  // plastic strain at z = 0 before the step
  Heated layer;         // temperatures of the layer as functions of the heat flux
  // Share of the friction heat that enters the heat equation: beta_T if only the soft body is on the grid, 1 if both
  // are.
  double heat_partition;
  double dt;
  Forcing forcing;
  LaneStep before;  // the state before the step; only stress, jump_new and sticks are read
};

class FlowingSlip {
 public:
  FlowingSlip() = default;
  explicit FlowingSlip(const FlowingStart& start);

  bool done() const { return phase_ == Phase::kDone; }
  // The load (stress magnitude and heat flux) under which update() needs the layer's flow; once done(), the load found.
  double stress() const { return a_; }
  double flux() const { return q_; }
  double flux_per_stress() const { return a_ > 0.0 ? q_ / a_ : 0.0; }
  // `slip`: plastic slip across the layer, integral(dep), under this load  [m]. `nearby`: the flow under other loads.
  void update(double slip, const NearbyFlow& nearby = {});

  struct Answer {
    LaneStep step;
    double surplus;  // plastic slip beyond that of DLP (48), at the hottest vertex of a layer at its ceiling  [m]
    int hottest;     // index of the hottest vertex
  };
  Answer answer(double slip) const;  // `slip`: plastic slip across the layer, integral(dep), under the load found  [m]

 private:
  enum class Phase { kDone, kRigid, kOtherAnswer, kStickGuess, kStickEnd, kStick, kSlipLow, kSlipHigh, kSlip };
  enum class Kind { kRigid, kStick, kSlip };

  void ask(Phase phase, double a, double q);
  void ask_rigid(Phase phase);
  void ask_stick(Phase phase, double a);
  void ask_slip(Phase phase, double q);
  void begin_stick();
  void guess_stick(double slip, const NearbyFlow& nearby);
  void end_stick(double a);
  void begin_slip();
  void end_slip(double q);
  bool rigid_holds(double slip) const;
  bool rigid_layer_flows() const;
  double T0(double q) const { return start_.layer.T(0, q); }
  double interface_at(double q) const { return start_.limit.at(T0(q)).stress; }
  double layer_at(double q) const;
  bool layer_holds(double q) const { return layer_at(q) < interface_at(q); }
  template <class Predicate>
  double first_flux(double lo, double T_hi, const Predicate& holds) const;
  void bound_slip_by_layer();
  double stick_balance(double slip) const { return a_ + compliance_ * slip - trial_.stress_stick; }
  double stick_flux(double a) const { return start_.heat_partition * (a * stopping_.slip(a)); }
  bool stick_is_met(double slip, const NearbyFlow& nearby) const;
  double nearby_stick(const NearbyFlow& nearby) const;
  double nearby_slip(const NearbyFlow& nearby) const;
  double slip_balance(double slip) const;
  double interface_slip(double a, double slip) const;

  FlowingStart start_{};
  TrialSlip trial_{{}, 1.0, 0.0, 0.0};
  FrictionHeating stopping_{};  // friction heating, if the interface sticks at the end of the step
  FrictionHeating slipping_{};  // friction heating, if the interface slips at the end of the step
  LaneStep rigid_{};            // the answer of the step if the layer does not flow
  // fall of the sticking stress per plastic slip across the layer, integral(dep): sqrt(3) / (dt per_stress)  [Pa/m]
  double compliance_ = 0.0;
  RootSearch search_;

  Phase phase_ = Phase::kDone;
  Kind kind_ = Kind::kRigid;
  double a_ = 0.0, q_ = 0.0;  // the load to evaluate next: stress [Pa], heat flux [W/m2]
  double a_stick_ = 0.0;      // stress at which the interface sticks while the layer flows  [Pa]
  // Search interval of the stress that sticks, or of the flux; the balance at its lower end.
  double low_ = 0.0, low_value_ = 0.0, high_ = 0.0;
  bool high_is_ceiling_ = false;  // the layer is at its ceiling at the upper end of the interval
  bool at_ceiling_ = false;       // the stress of the answer is the ceiling of the layer
  int guesses_ = 0;               // number of stresses tried before the upper end of the interval
  bool stick_was_searched_ = false;
  bool several_ = false;  // another answer satisfies the equations of the step too
};

}  // namespace shearbus::physics
