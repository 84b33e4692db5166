#include "server/physics/solver/velocity_driven/at_rest.hpp"

#include <cmath>

#include "server/physics/solver/contact.hpp"
#include "server/physics/solver/velocity_driven/elastic_trial.hpp"

namespace shearbus::physics {

bool velocity_driven_may_rest(const Problem& problem, const TileInputs& inputs, int lane) {
  return problem.options.drive != Drive::kInterfaceSlip || inputs.velocity_jump[lane] == 0.0;
}

std::optional<RestingStep> velocity_driven_step_at_rest(const Problem& problem, const StepOperators& operators,
                                                        const TileInputs& inputs, const double* committed,
                                                        const Material& soft, double T0, int lane) {
  const double jump = inputs.velocity_jump[lane];
  const double pressure = inputs.pressure[lane];
  const auto resting = [jump](double stress, double slip, Regime regime, bool sticks) {
    return RestingStep{{stress, slip, jump, 0.0, regime, sticks, true, false}, outside_domain(slip, jump)};
  };
  if (pressure <= 0.0) return resting(0.0, jump, Regime::kOpen, false);
  const ElasticTrial trial = elastic_trial(problem, soft, inputs, lane, operators.dt(),
                                           stress_before(problem.layout, inputs, committed, lane));
  const double limit =
      contact_limit(problem, soft, pressure, operators.dt(), contact_before(problem, committed, lane), nullptr)
          .at(T0)
          .stress;
  if (trial.heats() || !velocity_driven_may_rest(problem, inputs, lane) || limit < std::abs(trial.stress))
    return std::nullopt;
  // The slip is 0 with the sign that solve_balance() gives it, so that both functions give the same bits.
  const double slip = problem.options.drive == Drive::kLayerShear ? std::copysign(0.0, trial.direction) : 0.0;
  return resting(trial.stress, slip, Regime::kStick, true);
}

}  // namespace shearbus::physics
