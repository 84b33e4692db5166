#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>
#include <optional>

#include "server/physics/solver/contact.hpp"
#include "server/physics/solver/flow/layer_flow.hpp"
#include "server/physics/solver/flow/plastic_heat.hpp"
#include "server/physics/solver/force_driven/flowing_slip.hpp"
#include "server/physics/solver/force_driven/interface_step.hpp"
#include "server/physics/solver/force_driven/substeps.hpp"
#include "server/physics/solver/pipeline.hpp"
#include "server/physics/solver/scratch.hpp"
#include "server/physics/solver/sdirk2.hpp"
#include "server/physics/solver/solvers.hpp"
#include "server/physics/solver/work.hpp"

namespace shearbus::physics {
namespace {

// The heat of plastic work in the steps of a tile: arrays [vertex][lane] of the layer, in one scratch tile.
class WorkHeat {
 public:
  // `shape`: phi of the step before, in the committed tile.
  WorkHeat(const Problem& problem, const StepOperators& operators, const double* shape)
      : size_(static_cast<std::size_t>(problem.grid.num_vertices()) * kLanes),
        rows_(scratch_tile(Scratch::kWorkHeat, 4 * size_)),
        spread_(operators.spread()),
        dt_(operators.dt()) {
    respond(operators.heat(), spread_, shape, response());
  }

  double* combined() const { return rows_; }             // response to the whole heat of a load
  double* response() const { return rows_ + size_; }     // B_phi of the whole step
  double* shorter() const { return rows_ + 2 * size_; }  // B_phi of a substep of one lane
  double* scaled_shape() const { return rows_ + 3 * size_; }
  const SpreadHeat& spread() const { return spread_; }

  // Finds shorter() for the next substep of a lane with the operator `heat` and the shape of the substep before.
  void begin_substep(const HeatOperator& heat, int lane, const double* shape) const {
    for (std::size_t i = static_cast<std::size_t>(lane); i < size_; i += kLanes)
      scaled_shape()[i] = shape[i] * (heat.dt / dt_);
    respond_lane(heat, spread_, lane, scaled_shape(), shorter());
  }

  // Writes the response per heat of a load of one lane: (q B + work B_phi) / (q + work).
  void combine(const LayerLoad& load, const double* B, const double* B_work, int lane) const {
    const double share = load.heat() > 0.0 ? load.work / load.heat() : 0.0;
    for (std::size_t i = 0; i < size_ / kLanes; ++i) {
      const std::size_t at = i * kLanes + static_cast<std::size_t>(lane);
      combined()[at] = (1.0 - share) * B[i] + share * B_work[at];
    }
  }

 private:
  std::size_t size_;
  double* rows_;
  const SpreadHeat& spread_;
  double dt_;
};

// What the steps and substeps of the lanes of a tile have in common.
struct FlowingTile {
  const Problem& problem;
  const LaneMaterials& soft_at;
  const TileInputs& inputs;
  const WorkHeat* work_heat;  // null: plastic work heats nothing
  const double* T;            // temperatures of the layer after conduction, [vertex][lane]
  double* strain;             // plastic strain of the layer, [vertex][lane]: after the step or the last substep
  double* shape;              // heat shape phi; null without `work_heat`
};

// The searches of lanes, which run side by side because their flow is summed in one pass.
struct Searches {
  const FlowingTile& tile;
  const double* B_work;  // B_phi of the step; null without `work_heat`
  FlowingSlip* lanes[kLanes] = {};
  double slip[kLanes] = {};  // plastic slip across the layer, integral(dep), under the loads found  [m]
  int sums[kLanes] = {};     // number of sums of the flow over the layer that each lane has needed

  // Runs the searches of the lanes `active` in a step with the operator `heat` from the strain `strain_old`. If the
  // layer hardens, the strain of the tile is the new strain under the loads found. Each sum writes the strain, so that
  // a search that ends under the load of its last sum needs no other.
  void run(const HeatOperator& heat, const double* strain_old, std::uint32_t active) {
    if (active != 0 && hardens(tile.problem.options.soft)) sum_flow(heat, strain_old, active);
    for (const int l : lanes_of(active)) {
      while (!lanes[l]->done()) lanes[l]->update(0.0);
    }
  }

 private:
  void sum_flow(const HeatOperator& heat, const double* strain_old, std::uint32_t active) {
    const Grid& grid = tile.problem.grid;
    const FlowProblem layers{&tile.problem.options.soft,
                             &grid,
                             heat.layer_response(),
                             tile.T,
                             strain_old,
                             heat.dt,
                             tile.work_heat != nullptr ? tile.work_heat->combined() : nullptr};
    LayerFlow flow(layers, scratch_tile(Scratch::kFlow, LayerFlow::size_of_rows(grid)));
    for (const int l : lanes_of(active)) {
      const LayerLoad& load = lanes[l]->load();
      flow.load(l, tile.soft_at(l), tile.inputs.pressure[l], load.stress, load.heat_per_stress());
      combine(layers.response, l);
    }
    for (bool moved = true; moved;) {
      flow.sum(active, tile.strain);
      if (tile.inputs.effort != nullptr) ++tile.inputs.effort->layer_sums;
      moved = false;
      for (const int l : lanes_of(active)) {
        FlowingSlip& lane = *lanes[l];
        if (lane.done()) continue;
        ++sums[l];
        const double work_before = lane.load().work;
        const bool known = flow.is_explicit || flow.slip[l] > 0.0;
        const bool ended = known && lane.ends_stuck(flow.slip[l], flow.accuracy(l));
        if (!ended || !flow.is_explicit) {
          const NearbyFlow nearby = flow.nearby(l);
          if (!ended) lane.update(flow.slip[l], nearby);
        }
        const LayerLoad& load = lane.load();
        const double heating = load.heat_per_stress();
        const bool changed = load.stress != flow.stress[l] || heating != flow.heating[l] || load.work != work_before;
        moved = moved || changed || !lane.done();
        flow.load(l, load.stress, heating);
        if (tile.work_heat == nullptr || !changed) continue;
        combine(layers.response, l);
        flow.forget(l);
      }
    }
    for (const int l : lanes_of(active)) slip[l] = flow.slip[l];
  }
  void combine(const double* B, int l) const {
    if (tile.work_heat != nullptr) tile.work_heat->combine(lanes[l]->load(), B, B_work, l);
  }
};

// One lane of a tile in a step or its substeps.
struct FlowingLane {
  const FlowingTile& tile;
  int lane;
  InterfaceStep interface;
  double heat_of_work;  // heat that plastic work has released in the substeps  [J/m2]
  bool peaks_inside;    // the layer may be hottest behind z = 0

  // The start of a step with the operator `heat`. `strain_old`: plastic strain before the step. `stress_rate`: change of
  // the stress in the step before, along itself, over its length  [Pa/s].
  FlowingStart start(const HeatOperator& heat, const double* strain_old, const FirstVertices& first,
                     const LaneStep& before, double stress_rate, const double* B_work) const {
    const Problem& problem = tile.problem;
    const Material& soft = tile.soft_at(lane);
    return {
        .limit = interface.limit_after(before, heat.dt),
        .ceiling = strength_ceiling(soft) / kSqrt3,
        .hardens = hardens(soft),
        .first_weight = problem.grid.weight[0],
        .first_strain = strain_old[lane],
        .first_strength = first.strength[lane],
        .first_g = first.g[lane],
        .layer = {tile.T + lane, heat.layer_response(), 1,
                  problem.options.hard_grid || peaks_inside ? problem.grid.num_vertices() : 1,
                  B_work != nullptr ? B_work + lane : nullptr},
        .heat_partition = problem.heat_partition,
        .dt = heat.dt,
        .forcing = forcing_of(tile.inputs, lane),
        .before = before,
        .rise = stress_rate * heat.dt,
        .turns_within = problem.options.tolerance.has_value(),
    };
  }

  // What follows from the answer of a step of length dt: the surplus of plastic slip, the shape of its heat, the
  // contact. `strain_old`: plastic strain before the step.
  void finish(FlowingSlip::Answer& answer, const double* strain_old, double dt, const Heated& layer) {
    const Grid& grid = tile.problem.grid;
    if (answer.surplus > 0.0)
      tile.strain[answer.hottest * kLanes + lane] +=
          answer.surplus / grid.weight[static_cast<std::size_t>(answer.hottest)];
    if (tile.work_heat != nullptr) {
      heat_of_work += answer.work * heated_share(grid, tile.shape + lane) * dt;
      reshape_heat(tile.problem, strain_old + lane, tile.strain + lane, 0.0, tile.shape + lane);
    }
    interface.slip_contact(answer.step, answer.rubs, dt, layer.T(0, answer.step.flux, answer.work));
  }

  // Solves one substep, after its conduction. T_all: rows of both bodies, to which the heat of plastic work is added.
  LaneStep substep(const HeatOperator& heat, const LaneStep& before, double* T_all) {
    const TileInputs& inputs = tile.inputs;
    if (inputs.pressure[lane] <= 0.0) return interface.from(before, heat.dt, 0.0, tile.T[lane]);
    const WorkHeat* work_heat = tile.work_heat;
    double* B_work = work_heat != nullptr ? work_heat->shorter() : nullptr;
    if (work_heat != nullptr) work_heat->begin_substep(heat, lane, tile.shape);
    const std::size_t strains = tile.problem.layout.num_strain_vertices * kLanes;
    double* strain_old = scratch_tile(Scratch::kStrain, strains);
    copy_lane(tile.strain, strain_old, strains, lane);
    FirstVertices first;
    find_first_vertices(tile.soft_at, 1u << lane, inputs.pressure, tile.T, strain_old, first);
    const FlowingStart start_of_step = start(heat, strain_old, first, before, 0.0, B_work);
    FlowingSlip step(start_of_step);
    Searches search{tile, B_work};
    search.lanes[lane] = &step;
    search.run(heat, strain_old, 1u << lane);
    add_work(inputs, lane,
             flow_work(tile.soft_at(lane).flow_law) * search.sums[lane] * tile.problem.grid.num_vertices());
    FlowingSlip::Answer answer = step.answer(search.slip[lane]);
    finish(answer, strain_old, heat.dt, start_of_step.layer);
    if (work_heat != nullptr) add_spread_lane(heat, work_heat->spread(), lane, answer.work, B_work, T_all);
    return answer.step;
  }
};

// Lanes whose temperatures were conducted to second order.
struct Conducted {
  std::uint32_t out = 0;     // out of the range of the temperatures before
  std::uint32_t inside = 0;  // hottest behind z = 0, before the heat of the step
};
// Takes rounding away.
Conducted lanes_conducted(int num_rows, std::ptrdiff_t interface, const double* before, double* after) {
  constexpr double kRounding = 1e-12;
  double coldest[kLanes], hottest[kLanes], lowest[kLanes], highest[kLanes];
  range_of_rows(num_rows, before, coldest, hottest);
  range_of_rows(num_rows, after, lowest, highest);
  Conducted lanes;
  for (int l = 0; l < kLanes; ++l) {
    if (highest[l] > after[interface * kLanes + l]) lanes.inside |= 1u << l;
    if (!(lowest[l] >= coldest[l] * (1.0 - kRounding) && highest[l] <= hottest[l] * (1.0 + kRounding))) {
      lanes.out |= 1u << l;
    } else if (lowest[l] < coldest[l] || highest[l] > hottest[l]) {
      for (int i = 0; i < num_rows; ++i)
        after[i * kLanes + l] = std::clamp(after[i * kLanes + l], coldest[l], hottest[l]);
    }
  }
  return lanes;
}

// The step of the active lanes. Their temperatures T_ad after conduction without heat of the step, DLP (28-35), are in
// `trial`; `heat` has the response. `inside`: lanes that may be hottest behind z = 0 though one body conducts.
void advance(const Problem& problem, const StepOperators& operators, const HeatOperator& heat, std::uint32_t inside,
             const TileInputs& inputs, const double* committed, double* trial, TileOutputs& outputs) {
  const TileLayout& layout = problem.layout;
  const Material& soft = problem.options.soft;
  const int n = problem.heat_grid.num_vertices();
  const std::size_t strains = layout.num_strain_vertices * kLanes;
  const double* T_old = committed + layout.first_temperature();
  const double* strain = committed + layout.plastic_strain;
  double* T_all = trial + layout.first_temperature();
  double* T = trial + layout.temperature;
  double* strain_new = trial + layout.plastic_strain;

  // 1. Where plastic work becomes heat is taken from the step before; its amount is found with the stress.
  const bool work_heats = layout.heat_shape != TileLayout::kAbsent;
  const double* shape = work_heats ? committed + layout.heat_shape : nullptr;
  double* shape_new = work_heats ? trial + layout.heat_shape : nullptr;
  std::optional<WorkHeat> work_heat;
  if (work_heats) {
    work_heat.emplace(problem, operators, shape);
    std::copy_n(shape, strains, shape_new);
  }
  const WorkHeat* work = work_heat ? &*work_heat : nullptr;

  // 2. Start the search for the stress of each lane, and load the layer with the first guess of this stress.
  LaneStep before[kLanes];
  const LaneMaterials soft_at(soft, inputs);
  const FlowingTile tile{problem, soft_at, inputs, work, T, strain_new, shape_new};
  const double* B_work = work != nullptr ? work->response() : nullptr;
  struct Search {
    FlowingLane lane;
    FlowingStart start;
    FlowingSlip slip;
  };
  union Slot {  // without the zeros that a compiler writes into an array of std::optional
    Slot() {}
    Search search;
  } slots[kLanes];
  Searches searches{tile, B_work};
  std::uint32_t closed = 0;
  for (const int l : lanes_of(inputs.active)) closed |= inputs.pressure[l] > 0.0 ? 1u << l : 0u;
  FirstVertices first;
  find_first_vertices(soft_at, closed, inputs.pressure, T, strain, first);
  for (const int l : lanes_of(inputs.active)) {
    before[l] = InterfaceStep::before(layout, inputs, committed, l);
    Search& search = slots[l].search;
    new (&search.lane)
        FlowingLane{tile, l, InterfaceStep(problem, inputs, committed, soft_at(l), l), 0.0, contains(inside, l)};
    if (!contains(closed, l)) continue;
    const double rate = committed[layout.stress_rate + l];
    new (&search.start) FlowingStart(search.lane.start(heat, strain, first, before[l], rate, B_work));
    searches.lanes[l] = std::construct_at(&search.slip, search.start);
  }

  // 3. Find stress, slip, temperature and strain of all lanes together: DLP (48), (61), (64), (65).
  if (closed == 0 || !hardens(soft) || is_one_lane(closed)) std::copy_n(strain, strains, strain_new);
  searches.run(heat, strain, closed);

  // 4. Answers, lane by lane. A step that may have several answers is divided into shorter substeps until each has a
  // unique answer or the shortest substeps are reached.
  const double weight = flow_work(soft.flow_law);
  const int halvings = operators.max_halvings();
  double flux[kLanes] = {}, power[kLanes] = {};
  const auto heat_of = [&](int k) -> const HeatOperator& { return k == 0 ? heat : operators.heat(k); };
  for (const int l : lanes_of(inputs.active)) {
    FlowingLane& lane = slots[l].search.lane;
    FlowingSlip::Answer answer{};
    if (contains(closed, l)) {
      answer = searches.lanes[l]->answer(searches.slip[l]);
      power[l] = answer.work;
      lane.finish(answer, strain, heat.dt, slots[l].search.start.layer);
    } else {
      answer.step = lane.interface.from(before[l], heat.dt, 0.0, T[l]);
    }
    const LaneStep& whole = answer.step;
    LaneResult result = step_or_divide(
        whole, heat_of, halvings, {l, before[l], n, T_old, T_all},
        [&] {
          copy_lane(strain, strain_new, strains, l);
          if (work_heats) copy_lane(shape, shape_new, strains, l);
          lane.interface.contact = contact_before(problem, committed, l);
          lane.heat_of_work = power[l] = 0.0;
        },
        [&](const HeatOperator& shorter, const LaneStep& last) { return lane.substep(shorter, last, T_all); });
    result.heat += lane.heat_of_work;
    // Next to a layer that does not flow the step is that of InterfaceStep.
    if (halvings > 0 && whole.unique && searches.slip[l] == 0.0 &&
        InterfaceStep(problem, inputs, committed, soft_at(l), l)
            .changes_suddenly(before[l], whole, heat.dt, *heat.layer_response(), T[l]))
      result.outcome |= kSudden;
    flux[l] = result.flux;
    add_work(inputs, l, n + weight * (searches.sums[l] + 1.0) * problem.grid.num_vertices());
    write_answer(result, layout, l, trial, outputs);
    const bool whole_step = (result.outcome & kSubstepped) == 0 && searches.slip[l] > 0.0;
    trial[layout.stress_rate + l] =
        whole_step ? std::copysign(1.0, result.step.stress) * (result.step.stress - before[l].stress) / heat.dt : 0.0;
    trial[layout.sticking + l] = result.step.sticks ? 1.0 : 0.0;
    store_contact(problem, lane.interface.contact, trial, l);
  }

  // 5. Add the heat of this step to the temperatures: T = T_ad + q B, and the work times B_phi.
  add_flux(heat, n, flux, T_all);
  if (work_heats) add_spread(heat, operators.spread(), power, work->response(), T_all);
  for (const int l : lanes_of(inputs.active)) outputs.interface_temperature[l] = T[l];
}

void advance_first_order(const Problem& problem, const StepOperators& operators, const TileInputs& inputs,
                         const double* committed, double* trial, TileOutputs& outputs) {
  const std::size_t first = problem.layout.first_temperature();
  conduct(operators.heat(), problem.heat_rows, committed + first, trial + first);
  advance(problem, operators, operators.heat(), 0, inputs, committed, trial, outputs);
}

}  // namespace

void advance_force_driven_flowing(const Problem& problem, const StepOperators& operators, const TileInputs& inputs,
                                  const double* committed, double* trial, TileOutputs& outputs) {
  if (operators.even() == nullptr) return advance_first_order(problem, operators, inputs, committed, trial, outputs);
  // Under a tolerance heat is conducted to second order, except where that would leave the range of the temperatures.
  const HeatOperator& even = *operators.even();
  const int n = problem.heat_rows;
  const double* T_old = committed + problem.layout.first_temperature();
  double* T = trial + problem.layout.first_temperature();
  conduct(even, n, T_old, T);
  extrapolate_rows(n, sdirk2::kExtrapolation, T_old, T);
  conduct(even, n, T, T);
  TileInputs part = inputs;
  const Conducted lanes = lanes_conducted(n, problem.heat_grid.interface, T_old, T);
  part.active = inputs.active & ~lanes.out;
  if (part.active != 0) advance(problem, operators, even, lanes.inside, part, committed, trial, outputs);
  advance_aside(advance_first_order, problem, operators, inputs, inputs.active & lanes.out, committed, trial, outputs);
}

}  // namespace shearbus::physics
