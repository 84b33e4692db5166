// The columns of a session's steps: those that a model has, and as a shard takes and gives them.
#pragma once

#include <string>
#include <vector>

#include "proto/wire/batch.hpp"
#include "proto/wire/columns.hpp"
#include "server/shard/shard.hpp"

namespace shearbus::service {

// The name of a column in a capsule: its field's name, with an ending for the second tangential component.
inline std::string name_of(const wire::Column& column) {
  return std::string(wire::name(column.field)) + std::string(column.component == 0 ? "" : "_second");
}

inline wire::Strategy strategy_of(const physics::ModelOptions& options) {
  return options.strategy == physics::Strategy::kForceDriven ? wire::Strategy::kForceDriven
                                                             : wire::Strategy::kVelocityDriven;
}

// Optional columns of a request: only those that this model uses.
inline std::vector<wire::Field> optional_columns_of(const physics::ModelOptions& options) {
  if (options.strategy == physics::Strategy::kForceDriven)
    return options.plastic_layer ? std::vector{wire::Field::kSoftPlasticStrainRate} : std::vector<wire::Field>{};
  return options.drive == physics::Drive::kInterfaceSlip ? std::vector{wire::Field::kSoftShearRate}
                                                         : std::vector<wire::Field>{};
}

// Columns of a reply to requests that name them: the energy ledger where a layer has one stress, the estimate of steps under a tolerance.
inline std::vector<wire::Field> columns_on_request_of(const physics::ModelOptions& options) {
  std::vector<wire::Field> fields;
  if (!options.inertia) fields.assign(wire::kLedgerColumns.begin(), wire::kLedgerColumns.end());
  if (options.tolerance) fields.push_back(wire::Field::kErrorEstimate);
  return fields;
}

inline shard::StepInputs inputs_of(const wire::Batch& batch) {
  using wire::Field;
  return {.velocity_jump = batch.f64(Field::kVelocityJump),
          .second_velocity_jump = batch.f64(Field::kVelocityJump, 1),
          .pressure = batch.f64(Field::kPressure),
          .soft_shear_rate = batch.f64(Field::kSoftShearRate),
          .stress_soft = batch.f64(Field::kStressSoft),
          .second_stress_soft = batch.f64(Field::kStressSoft, 1),
          .stress_hard = batch.f64(Field::kStressHard),
          .second_stress_hard = batch.f64(Field::kStressHard, 1),
          .mass_soft = batch.f64(Field::kMassSoft),
          .mass_hard = batch.f64(Field::kMassHard),
          .soft_plastic_strain_rate = batch.f64(Field::kSoftPlasticStrainRate)};
}

inline shard::StepOutputs outputs_of(wire::Batch& batch) {
  using wire::Field;
  shard::StepOutputs outputs{.shear_stress = batch.f64(Field::kShearStress),
                             .second_shear_stress = batch.f64(Field::kShearStress, 1),
                             .sliding_velocity = batch.f64(Field::kSlidingVelocity),
                             .second_sliding_velocity = batch.f64(Field::kSlidingVelocity, 1),
                             .interface_temperature = batch.f64(Field::kInterfaceTemperature),
                             .velocity_jump_new = batch.f64(Field::kVelocityJumpNew),
                             .second_velocity_jump_new = batch.f64(Field::kVelocityJumpNew, 1),
                             .friction_heat = batch.f64(Field::kFrictionHeat),
                             .regime = batch.u8(Field::kRegime),
                             .outcome = batch.u8(Field::kOutcome),
                             .error_estimate = batch.f64(Field::kErrorEstimate)};
  static_assert(wire::kLedgerColumns.size() == physics::kLedgerTerms);
  for (std::size_t i = 0; i < physics::kLedgerTerms; ++i) outputs.ledger[i] = batch.f64(wire::kLedgerColumns[i]);
  return outputs;
}

}  // namespace shearbus::service
