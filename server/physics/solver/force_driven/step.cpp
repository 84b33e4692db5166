#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <type_traits>

#include "server/physics/solver/force_driven/interface_step.hpp"
#include "server/physics/solver/force_driven/substeps.hpp"
#include "server/physics/solver/force_driven/wide_slip.hpp"
#include "server/physics/solver/solvers.hpp"
#include "server/physics/solver/work.hpp"

namespace shearbus::physics {
namespace {

// Makes the step of the lanes that wide_slip() solves, except conduction, and returns these lanes. `remarks`: whether a
// step that changes suddenly says so.
std::uint32_t slip_of_tile(const Problem& problem, const WideStep& wide, const WideStage& whole, bool remarks,
                           const double* committed, double* trial, TileOutputs& outputs, WideAnswer& answer) {
  const std::uint32_t found = wide_slip(wide, whole, answer);
  write_answer(problem, answer, found, trial, outputs);
  const TileInputs& inputs = wide.interface.inputs;
  for (const int l : lanes_of(remarks ? answer.suspects : 0)) {
    const LaneStep step{answer.stress[l],
                        answer.slip[l],
                        answer.jump_new[l],
                        answer.flux[l],
                        outputs.regime[l],
                        outputs.regime[l] == Regime::kStick,
                        true,
                        false};
    const LaneStep before = InterfaceStep::before(problem.layout, inputs, committed, l);
    if (InterfaceStep(problem, inputs, committed, wide.interface.soft_at(l), l)
            .changes_suddenly(before, step, whole.dt, whole.B0, whole.T_ad[l]))
      outputs.outcome[l] = kSudden;
  }
  if (inputs.work != nullptr) {
    for (const int l : lanes_of(found)) add_work(inputs, l, problem.heat_rows + kSearchWork);
  }
  return found;
}

template <class Heat>
void advance(const Problem& problem, const StepOperators& operators, const TileInputs& inputs, const double* committed,
             double* trial, TileOutputs& outputs) {
  const auto heat_of = [&](int k) -> const Heat& {
    if constexpr (std::is_same_v<Heat, ModeOperator>)
      return operators.modes(k);
    else
      return operators.heat(k);
  };
  const int max_halvings = operators.max_halvings();
  const TileLayout& layout = problem.layout;
  const int n = problem.heat_rows;
  const double* T_old = committed + layout.first_temperature();
  double* T = trial + layout.first_temperature();
  const double* T0 = trial + layout.temperature;

  // 1. Conduction without friction, all lanes: DLP (28-35).
  conduct(heat_of(0), n, T_old, T, layout.distance_to_next_tile());

  // 2. Find stress and slip, DLP (61), (65): of all lanes at once where the model allows it, of the others lane by
  // lane.
  WideAnswer answer{};
  double(&flux)[kLanes] = answer.flux;
  const LaneMaterials soft_at(problem.options.soft, inputs);
  std::uint32_t found = 0;
  const double dt = heat_of(0).dt;
  const WideStep wide{WideInterface(problem, inputs, soft_at, dt, committed), problem.heat_partition, dt};
  if (wide.interface.has_forms())
    found = slip_of_tile(problem, wide, {T0, *heat_of(0).layer_response(), dt}, max_halvings > 0, committed, trial,
                         outputs, answer);
  for (const int lane : lanes_of(inputs.active & ~found)) {
    InterfaceStep interface_step(problem, inputs, committed, soft_at(lane), lane);
    const ContactState contact_old = interface_step.contact;
    const LaneStep before = InterfaceStep::before(layout, inputs, committed, lane);
    const auto step_from = [&](const auto& heat, const LaneStep& last) {
      add_work(inputs, lane, n + kSearchWork);
      return interface_step.from(last, heat.dt, *heat.layer_response(), T0[lane]);
    };

    // 3. A step that may have several answers is divided into shorter substeps until each has a unique answer or the
    // shortest substeps are reached.
    const LaneStep whole = step_from(heat_of(0), before);
    LaneResult result = step_or_divide(
        whole, heat_of, max_halvings, {lane, before, n, T_old, T}, [&] { interface_step.contact = contact_old; },
        step_from);
    if (max_halvings > 0 && whole.unique &&
        InterfaceStep(problem, inputs, committed, soft_at(lane), lane)
            .changes_suddenly(before, whole, heat_of(0).dt, *heat_of(0).layer_response(), T0[lane]))
      result.outcome |= kSudden;
    flux[lane] = result.flux;
    write_answer(result, layout, lane, trial, outputs);
    store_contact(problem, interface_step.contact, trial, lane);
  }

  // 4. Add the friction heat: T = T_ad + q B, with T_ad from 1., the heat flux q and the response B to a unit flux.
  add_flux(heat_of(0), n, flux, T);
  if (inputs.active == kAllLanes) {
    std::copy_n(T0, kLanes, outputs.interface_temperature);
  } else {
    for (const int lane : lanes_of(inputs.active)) outputs.interface_temperature[lane] = T0[lane];
  }
}

}  // namespace

void advance_force_driven(const Problem& problem, const StepOperators& operators, const TileInputs& inputs,
                          const double* committed, double* trial, TileOutputs& outputs) {
  const AdvanceTile step = problem.modes ? advance<ModeOperator> : advance<HeatOperator>;
  step(problem, operators, inputs, committed, trial, outputs);
}

std::optional<LaneResult> force_driven_step_at_rest(const Problem& problem, const StepOperators& operators,
                                                    const TileInputs& inputs, const double* committed,
                                                    const Material& soft, double T0, int lane) {
  const HeatOperator& heat = operators.heat();
  const LaneStep before = InterfaceStep::before(problem.layout, inputs, committed, lane);
  // Next to a layer that may flow, slip that stops in a step under a tolerance heats or flows.
  if (problem.options.tolerance && problem.options.plastic_layer && inputs.pressure[lane] > 0.0 &&
      !(before.jump_new == 0.0))
    return std::nullopt;
  const auto interface_step = [&] { return InterfaceStep(problem, inputs, committed, soft, lane); };
  const LaneStep step = interface_step().from(before, heat.dt, *heat.layer_response(), T0);
  if (!step.unique || step.flux != 0.0 || !(step.regime == Regime::kOpen || step.sticks)) return std::nullopt;
  const bool sudden = operators.max_halvings() > 0 &&
                      interface_step().changes_suddenly(before, step, heat.dt, *heat.layer_response(), T0);
  return LaneResult{step, 0.0, 0.0, sudden ? kSudden : std::uint8_t{0}};
}

}  // namespace shearbus::physics
