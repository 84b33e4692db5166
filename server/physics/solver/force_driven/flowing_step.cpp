#include "server/physics/solver/force_driven/flowing_step.hpp"

#include <algorithm>
#include <iterator>

#include "server/physics/solver/flow/expanded_flow.hpp"
#include "server/physics/solver/flow/layer_flow.hpp"
#include "server/physics/solver/flow/searched_flow.hpp"
#include "server/physics/solver/force_driven/flowing_slip.hpp"
#include "server/physics/solver/force_driven/interface_step.hpp"
#include "server/physics/solver/force_driven/substeps.hpp"
#include "server/physics/solver/problem.hpp"
#include "server/physics/solver/scratch.hpp"
#include "server/physics/solver/step_operators.hpp"
#include "server/physics/solver/work.hpp"

namespace shearbus::physics {
namespace {

// The inputs and laws of one lane for a whole step or a substep. `knows_nearby`: the search is told the flow under loads
// nearby. `T_ad`: [vertex][lane] of the layer.
FlowingStart start_of(const Problem& problem, const Material& soft, const TileInputs& inputs, int lane,
                      const HeatOperator& heat, const double* T_ad, double first_strain, const LaneStep& before,
                      bool knows_nearby) {
  FlowingStart start{};
  start.limit = interface_strength(problem.interface, soft, inputs.pressure[lane], inputs.effort);
  start.ceiling = strength_ceiling(soft) / kSqrt3;
  start.hardens = hardens(soft);
  start.knows_nearby = knows_nearby;
  start.first_weight = problem.grid.weight[0];
  start.first_strain = first_strain;
  start.layer = {T_ad + lane, heat.layer_response(), 1, problem.options.hard_grid ? problem.grid.num_vertices() : 1};
  start.heat_partition = problem.heat_partition;
  start.dt = heat.dt;
  start.forcing = forcing_of(problem, inputs, lane);
  start.before = before;
  return start;
}

void add_surplus(const Problem& problem, const FlowingSlip::Answer& answer, int lane, double* strain) {
  strain[answer.hottest * kLanes + lane] +=
      answer.surplus / problem.grid.weight[static_cast<std::size_t>(answer.hottest)];
}

// Solves one substep of one lane. T: temperatures after conduction; `strain`: old plastic strain, replaced by the new.
LaneStep substep(const Problem& problem, const Material& soft, const TileInputs& inputs, int lane,
                 const HeatOperator& heat, const LaneStep& before, const double* T, double* strain) {
  if (inputs.pressure[lane] <= 0.0) {
    return open_step(forcing_of(inputs, lane), heat.dt, before.jump_new);
  }
  const FlowingStart start = start_of(problem, soft, inputs, lane, heat, T, strain[lane], before, false);
  const FlowProblem flow{&soft, &problem.grid, heat.layer_response(), T, strain, 0, heat.dt};
  const auto slip_under = [&](const FlowingSlip& step, double* strain_new) {
    if (!start.hardens) return 0.0;
    FlowLoad load;
    set_load(soft, inputs.pressure[lane], step.stress(), step.flux(), lane, load);
    if (inputs.effort != nullptr) ++inputs.effort->layer_sums;
    add_work(inputs, lane, flow_work(soft.flow_law) * problem.grid.num_vertices());
    return flow_of_lane(flow, load, lane, strain_new);
  };
  FlowingSlip step(start);
  while (!step.done()) step.update(slip_under(step, nullptr));
  const FlowingSlip::Answer answer = step.answer(slip_under(step, strain));
  add_surplus(problem, answer, lane, strain);
  return answer.step;
}

// The searches of the lanes of a tile, and the inputs of their sums.
struct Searches {
  const TileInputs* inputs;
  const LaneMaterials* soft_at;
  FlowingSlip lanes[kLanes];
  int sums[kLanes] = {};  // number of sums of the flow over the layer that each lane has needed

  bool all_done() const {
    return std::all_of(std::begin(lanes), std::end(lanes), [](const FlowingSlip& lane) { return lane.done(); });
  }
  void count_sum() const {
    if (inputs->effort != nullptr) ++inputs->effort->layer_sums;
  }
  double pressure(int l) const { return contains(inputs->active, l) ? std::max(0.0, inputs->pressure[l]) : 0.0; }
};

// The sums of a step for a law with an expanded flow.
class ExpandedSums {
 public:
  ExpandedSums(const FlowProblem& problem, const Searches& searches) : problem_(problem) {
    for (int l = 0; l < kLanes; ++l) {
      const FlowingSlip& lane = searches.lanes[l];
      set_load((*searches.soft_at)(l), searches.pressure(l), lane.stress(), lane.flux_per_stress(), l, load_);
    }
    start_flow(problem, scratch_tile(Scratch::kFlow, rows_of(*problem.grid)), flow);
  }
  void sum(double* strain_new) { sum_flow(problem_, load_, strain_new, flow); }
  NearbyFlow nearby(const FlowingSlip&, int l) { return nearby_flow(flow, load_, l); }
  void set(const Searches& searches, int l) {
    load_.stress[l] = searches.lanes[l].stress();
    load_.heating[l] = searches.lanes[l].flux_per_stress();
  }

  ExpandedFlow flow;

 private:
  const FlowProblem& problem_;
  StressLoad load_;
};

// The same for a law whose flow is searched for at each vertex.
class SearchedSums {
 public:
  SearchedSums(const FlowProblem& problem, const Searches& searches) : problem_(problem) {
    for (int l = 0; l < kLanes; ++l) set(searches, l);
    start_search(scratch_tile(Scratch::kFlow, searched_rows(*problem.grid)), flow);
  }
  void sum(double* strain_new) { sum_flow(problem_, load_, strain_new, flow); }
  NearbyFlow nearby(const FlowingSlip& lane, int l) { return nearby_flow(flow, lane.stress(), l); }
  void set(const Searches& searches, int l) {
    const FlowingSlip& lane = searches.lanes[l];
    set_load((*searches.soft_at)(l), searches.pressure(l), lane.stress(), lane.flux(), l, load_);
  }

  SearchedFlow flow;

 private:
  const FlowProblem& problem_;
  FlowLoad load_;
};

// Runs the searches of all lanes together. On return `slip` and `strain_new` hold the flow and the new strain under the
// loads found. Each sum writes the strain, so that a search that ends under the load of its last sum needs no other.
template <class Sums>
void search(const FlowProblem& flow, Searches& searches, double* strain_new, double (&slip)[kLanes]) {
  Sums sums(flow, searches);
  for (bool moved = true; moved;) {
    sums.sum(strain_new);
    searches.count_sum();
    moved = false;
    for (int l = 0; l < kLanes; ++l) {
      FlowingSlip& lane = searches.lanes[l];
      if (lane.done()) continue;
      ++searches.sums[l];
      const double stress = lane.stress(), flux = lane.flux();
      lane.update(sums.flow.slip[l], sums.nearby(lane, l));
      moved = moved || !lane.done() || lane.stress() != stress || lane.flux() != flux;
      sums.set(searches, l);
    }
  }
  std::copy_n(sums.flow.slip, kLanes, slip);
}

}  // namespace

void advance_force_driven_flowing(const Problem& problem, const StepOperators& operators, const TileInputs& inputs,
                                  const double* committed, double* trial, TileOutputs& outputs) {
  const TileLayout& layout = problem.layout;
  const Material& soft = problem.options.soft;
  bool may_flow = false;
  const int n = problem.heat_grid.num_vertices();
  const HeatOperator& heat = operators.heat();
  const double* T_old = committed + layout.first_temperature();
  const double* strain = committed + layout.plastic_strain;
  double* T_all = trial + layout.first_temperature();
  double* T = trial + layout.temperature;
  double* strain_new = trial + layout.plastic_strain;

  // 1. Compute the temperatures T_ad, after conduction without friction heat: DLP (28-35).
  conduct(heat, n, T_old, T_all);

  // 2. Start the search for the stress of each lane, and load the layer with the first guess of this stress.
  LaneStep before[kLanes];
  const LaneMaterials soft_at(soft, inputs);
  Searches searches{&inputs, &soft_at};
  for (int l = 0; l < kLanes; ++l) {
    const bool active = contains(inputs.active, l);
    const double pressure = active ? inputs.pressure[l] : 0.0;
    before[l] = InterfaceStep::before(layout, inputs, committed, l);
    if (pressure > 0.0) {
      may_flow = hardens(soft);
      searches.lanes[l] = FlowingSlip(start_of(problem, soft_at(l), inputs, l, heat, T, strain[l], before[l], true));
    }
  }

  // 3. Find stress, slip, temperature and strain of all lanes together: DLP (48), (61), (64), (65).
  double slip[kLanes] = {};
  const FlowProblem flow{&soft, &problem.grid, heat.layer_response(), T, strain, operators.num_heated(), heat.dt};
  if (may_flow && has_expanded_flow(soft)) {
    search<ExpandedSums>(flow, searches, strain_new, slip);
  } else if (may_flow) {
    search<SearchedSums>(flow, searches, strain_new, slip);
  } else {
    for (FlowingSlip& lane : searches.lanes) {
      while (!lane.done()) lane.update(0.0);
    }
    std::copy_n(strain, layout.num_strain_vertices * kLanes, strain_new);
  }

  // 4. Answers, lane by lane. A step that may have several answers is divided into shorter substeps until each has a
  // unique answer or the shortest substeps are reached.
  const double weight = flow_work(soft.flow_law);
  double flux[kLanes] = {};
  const auto heat_of = [&](int k) -> const HeatOperator& { return k == 0 ? heat : operators.heat_halved(k); };
  for (const int l : lanes_of(inputs.active)) {
    LaneStep whole = open_step(forcing_of(inputs, l), heat.dt, before[l].jump_new);
    if (inputs.pressure[l] > 0.0) {
      const FlowingSlip::Answer answer = searches.lanes[l].answer(slip[l]);
      whole = answer.step;
      add_surplus(problem, answer, l, strain_new);
    }
    LaneResult result = step_or_divide(
        whole, heat_of, operators.max_halvings(), {l, before[l], n, T_old, T_all},
        [&] { copy_lane(strain, strain_new, static_cast<std::size_t>(problem.grid.num_vertices()) * kLanes, l); },
        [&](const HeatOperator& shorter, const LaneStep& last) {
          return substep(problem, soft_at(l), inputs, l, shorter, last, T, strain_new);
        });
    // Next to a layer that does not flow the step is that of InterfaceStep.
    if (operators.max_halvings() > 0 && whole.unique && slip[l] == 0.0 &&
        InterfaceStep(problem, inputs, committed, soft_at(l), l)
            .changes_suddenly(before[l], whole, heat.dt, *heat.layer_response(), T[l]))
      result.outcome |= kSudden;
    flux[l] = result.flux;
    add_work(inputs, l, n + weight * (searches.sums[l] + 1.0) * problem.grid.num_vertices());
    write_answer(result, layout, l, trial, outputs);
    trial[layout.sticking + l] = result.step.sticks ? 1.0 : 0.0;
  }

  // 5. Add the friction heat of this step to the temperatures: T = T_ad + q B.
  add_flux(heat, n, flux, T_all);
  for (const int l : lanes_of(inputs.active)) outputs.interface_temperature[l] = T[l];
}

}  // namespace shearbus::physics
