// The force-driven step of one lane whose layer may flow (server/physics/MODEL.md, "Plastic layer"): DLP (48), (61),
// (64) and the law of the contact, solved together for s, [v], T0 and ep. The search asks its caller for the layer's
// flow: load() is the load on the layer, and update() receives the flow under this load. The caller runs the searches of
// all lanes (nodes stepped together) side by side, because it computes their flow in one pass.
#pragma once

#include "server/physics/solver/flow/heated.hpp"
#include "server/physics/solver/flow/layer_flow.hpp"
#include "server/physics/solver/flow/root_search.hpp"
#include "server/physics/solver/force_driven/rigid_slip.hpp"
#include "server/physics/solver/force_driven/travel.hpp"

namespace shearbus::physics {

// A lane (one of 8 nodes stepped together) at the start of a step, with its contact closed.
struct FlowingStart {
  StressLimit limit;      // stress limit s_lim(T0, [v]) of the interface
  double ceiling;         // stress that the fully hardened layer carries where g = 1; infinity: no ceiling  [Pa]
  bool hardens;           // false: the strength of the layer does not grow, and it flows only at its ceiling
  double first_weight;    // length along z that belongs to the vertex at z = 0  [m]
  double first_strain;    // plastic strain at z = 0 before the step
  double first_strength;  // strength H there, at the rate 0; only read if softens_alike()  [Pa]
  double first_g;         // softening g there, after conduction
  Heated layer;           // temperatures of the layer as functions of the heat
  // Share of the friction heat that enters the heat equation: beta_T if only the soft body is on the grid, 1 if both
  // are.
  double heat_partition;
  double dt;
  Forcing forcing;
  const LaneStep& before;  // the state before the step; only stress, jump_new and sticks are read
  double rise;  // of the stress, along itself, with which the search for that of the step starts, if it can be  [Pa]
  bool turns_within;  // under a tolerance: the jump may turn within the step, and slip and flow share its mean (Travel)
};

// Whether the interface softens as the layer does: friction is a constant, and the limit has the law's g as a factor.
bool softens_alike(const StressLimit& limit);

// The load on the layer of one lane.
struct LayerLoad {
  double stress = 0.0;  // magnitude a  [Pa]
  double flux = 0.0;    // heat flux q at z = 0, of the slip of the interface  [W/m2]
  double work = 0.0;    // plastic work that heats the layer, per area and time; 0 if plastic work heats nothing  [W/m2]

  double heat() const { return flux + work; }
  double heat_per_stress() const { return stress > 0.0 ? heat() / stress : 0.0; }
};

class FlowingSlip {
 public:
  explicit FlowingSlip(const FlowingStart& start);  // `start` must outlive the search

  bool done() const { return phase_ == Phase::kDone; }
  // The load under which update() needs the layer's flow; once done(), the load found.
  const LayerLoad& load() const { return load_; }
  // `slip`: plastic slip across the layer, integral(dep), under this load  [m]. `nearby`: the flow under other loads,
  // with the flux load().heat().
  void update(double slip, const NearbyFlow& nearby = {});
  // To be asked before update(): the same where the flow meets the balance of an interface that sticks, else returns
  // false.
  bool ends_stuck(double slip, const FlowAccuracy& accuracy) {
    if ((phase_ != Phase::kStickGuess && phase_ != Phase::kStick) || !(load_.stress > 0.0)) return false;
    if (!is_balanced(load_.stress, left_to_flow(load_.stress), compliance_, slip, accuracy)) return false;
    end_stick(load_.stress);
    return true;
  }

  struct Answer {
    LaneStep step;
    double work;     // plastic work that heats the layer  [W/m2]
    double surplus;  // plastic slip beyond that of DLP (48), at the hottest vertex of a layer at its ceiling  [m]
    int hottest;     // index of the hottest vertex
    double rubs;     // mean speed at which the interface slips, to and fro  [m/s]
  };
  Answer answer(double slip);  // `slip`: plastic slip across the layer, integral(dep), under the load found  [m]

 private:
  enum class Phase { kDone, kRigid, kOtherAnswer, kStickGuess, kStickEnd, kStick, kSlipLow, kSlipHigh, kSlip };
  enum class Kind { kRigid, kStick, kSlip };

  void ask(Phase phase, const LayerLoad& load);
  void ask_rigid(Phase phase);
  void ask_stick(Phase phase, double a) { ask(phase, stick_load(a)); }
  void ask_slip(Phase phase, double v);
  void begin_stick();
  void bound_stick_by_first_vertex();
  inline void guess_stick(double slip, const NearbyFlow& nearby);
  void end_stick(double a);
  void begin_slip();
  void stick_below(double high);
  void end_slip(double v);
  const LaneStep& rigid();
  bool rigid_holds(double slip);
  bool rigid_layer_flows();
  inline bool flows_beside_any_rigid_answer() const;
  bool heats_by_work() const { return start_.layer.B_work != nullptr; }
  double T(int vertex, const LayerLoad& load) const { return start_.layer.T(vertex, load.flux, load.work); }
  int hottest(const LayerLoad& load) const { return start_.layer.hottest(load.flux, load.work); }
  bool melts(const LayerLoad& load) const { return T(hottest(load), load) >= start_.limit.soft->melting_temperature; }
  double layer_at(const LayerLoad& load) const;
  double ceiling_of_stick(double high) const;
  LayerLoad stick_load(double a) const;
  LayerLoad slip_load(double a, double v) const;
  LayerLoad slip_load(double v) const;
  template <class LoadUnder>
  double not_molten(double a, const LoadUnder& load_under) const;
  LayerLoad solid(LayerLoad load) const;
  bool layer_holds(double v) const;
  void bound_slip_by_layer();
  // The jump over the step: its mean; what an interface that sticks leaves to the flow of the layer, as a stress; the
  // stress from which on it surely sticks.
  double mean_jump(double a) const {
    return start_.turns_within ? travel_.under(a).mean : slipping_.c - slipping_.b * a;
  }
  double mean_jump_slope(double a) const { return start_.turns_within ? travel_.under(a).by_stress : -slipping_.b; }
  double left_to_flow(double a) const {
    return start_.turns_within ? travel_.under(a).mean / trial_.per_stress : trial_.stress_stick - a;
  }
  double left_to_flow_slope(double a) const {
    return start_.turns_within ? travel_.under(a).by_stress / trial_.per_stress : -1.0;
  }
  double stick_balance(double slip) const { return stick_balance(load_.stress, slip); }
  double stick_balance(double a, double slip) const {
    return start_.turns_within ? compliance_ * slip - left_to_flow(a) : a + compliance_ * slip - trial_.stress_stick;
  }
  double stress_at_rest() const { return start_.turns_within ? travel_.rest_stress() : trial_.stress_stick; }
  double nearby_stick(const NearbyFlow& nearby) const;
  double nearby_slip(const NearbyFlow& nearby) const;
  double slip_balance(double slip) const;

  const FlowingStart& start_;
  TrialSlip trial_{{}, 1.0, 0.0, 0.0};
  Travel travel_;               // the jump under a constant stress; only if start_.turns_within
  FrictionHeating stopping_{};  // friction heating, if the interface sticks at the end of the step
  FrictionHeating slipping_{};  // friction heating, if the interface slips at the end of the step
  LaneStep rigid_{};            // the answer of the step if the layer does not flow, where rigid_is_known_
  // fall of the sticking stress per plastic slip across the layer, integral(dep): sqrt(3) / (dt per_stress)  [Pa/m]
  double compliance_ = 0.0;
  RootSearch search_;

  Phase phase_ = Phase::kDone;
  Kind kind_ = Kind::kRigid;
  LayerLoad load_;        // the load to evaluate next
  double slip_ = 0.0;     // slip velocity of the interface under this load, if it slips  [m/s]
  double a_stick_ = 0.0;  // stress at which the interface sticks while the layer flows  [Pa]
  // Search interval of the stress that sticks, or of the slip velocity; the balance at its lower end.
  double low_ = 0.0, low_value_ = 0.0, high_ = 0.0;
  bool high_is_ceiling_ = false;      // the layer is at its ceiling at the upper end of the interval
  bool at_ceiling_ = false;           // the stress of the answer is the ceiling of the layer
  bool stick_at_ceiling_ = false;     // so is the stress at which the interface sticks
  int guesses_ = 0;                   // number of stresses tried before the upper end of the interval
  bool first_vertex_bounds_ = false;  // the stress of the stick may be bounded by what the first vertex takes
  bool rigid_is_known_ = false;
  bool surely_flows_ = false;  // flows_beside_any_rigid_answer()
  bool stick_was_searched_ = false;
  bool stuck_below_limit_ = false;  // stick_below() was called
  bool several_ = false;            // another answer satisfies the equations of the step too
};

}  // namespace shearbus::physics
