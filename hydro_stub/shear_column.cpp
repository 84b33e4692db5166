#include "hydro_stub/shear_column.hpp"

#include <fmt/format.h>

#include <cmath>

#include "proto/wire/status.hpp"

namespace shearbus::hydro {

ShearColumn::ShearColumn(const ColumnProblem& problem)
    : dt_(problem.dt),
      pressure_(problem.pressure),
      soft_(problem.soft, problem.initial_jump),
      hard_(problem.hard, std::vector<double>(problem.columns, 0.0)),
      law_has_layers_(problem.law_has_layers),
      inputs_(problem.columns),
      answer_(problem.columns),
      friction_work_(problem.columns, 0.0),
      momentum_start_(problem.columns, 0.0),
      energy_start_(problem.columns, 0.0),
      traction_hard_(problem.columns, 0.0) {
  for (std::size_t i = 0; i < problem.columns; ++i) {
    inputs_.mass_soft[i] = soft_.mesh.half_zone_mass();
    inputs_.mass_hard[i] = hard_.mesh.half_zone_mass();
  }
  if (!problem.yields) return;
  bulk_.emplace(problem.soft_material, problem.hard_material, soft_, hard_, problem.initial_temperature,
                problem.conducts_across);
  inputs_.soft_plastic_strain_rate.assign(problem.columns, 0.0);
}

// Advances by one step. The run starts at t = 0 with velocities and stresses at the same time; the first half step
// brings the velocities to dt/2, and from there on velocities and stresses alternate:
//     times of the velocities: 0, 1/2 dt, 3/2 dt, ...       times of the stresses: 0, dt, 2 dt, ...
// With this half step, and dt equal to the transit time of a zone, a constant friction stress gives the exact jump of
// two half-spaces from the start; with a full first step the jump would alternate about the exact value.
void ShearColumn::advance(InterfaceLaw& law) {
  if (inputs_.step == 0) {
    for (std::size_t i = 0; i < inputs_.velocity_jump.size(); ++i) {
      momentum_start_[i] = momentum(soft_, i) + momentum(hard_, i);
      energy_start_[i] = energy(soft_, i, 0.0) + energy(hard_, i, 0.0);
    }
  }
  //   1. inputs of the interface law: zone stresses next to the interface, velocity jump, pressure       DLP (58)-(60)
  gather_inputs();
  //   2. interface law: shear stress of the step and the new jump                                        DLP (61)
  law.advance(inputs_, answer_);
  check_answer();
  //   3. momentum: first all nodes except the interface nodes of the two bodies, then these, with opposite tractions
  accelerate(soft_, inputs_.dt);
  accelerate(hard_, inputs_.dt);
  apply_answer();
  // 4. stresses of both bodies from the new velocities                                                 DLP (62)
  if (bulk_) {
    bulk_->strain_soft(soft_, dt_, inputs_.pressure);
    heat_zones();
  } else {
    strain(soft_, dt_);
  }
  strain(hard_, dt_);
}

void ShearColumn::gather_inputs() {
  const double level = static_cast<double>(inputs_.step) * dt_;  // time of the stresses, n dt for step n  [s]
  inputs_.dt = step_length();
  inputs_.time = level + 0.5 * dt_;
  ++inputs_.step;
  if (bulk_) {
    inputs_.zone_temperature.assign(bulk_->temperature().begin(), bulk_->temperature().end());
    inputs_.zone_plastic_strain.assign(bulk_->plastic_strain().begin(), bulk_->plastic_strain().end());
    inputs_.soft_plastic_strain_rate.assign(bulk_->plastic_rate().begin(), bulk_->plastic_rate().end());
  }
  const double* soft_stress = soft_.stress_at(0);
  const double* hard_stress = hard_.stress_at(0);
  for (std::size_t i = 0; i < inputs_.velocity_jump.size(); ++i) {
    inputs_.velocity_jump[i] = soft_.velocity_at(0)[i] - hard_.velocity_at(0)[i];
    inputs_.pressure[i] = pressure_.at(level, i);
    inputs_.stress_soft[i] = soft_stress[i];
    inputs_.stress_hard[i] = -hard_stress[i];  // tau of the hard body is -sigma_xz, as zeta = -z
  }
}

void ShearColumn::heat_zones() {
  if (!law_has_layers_) {
    std::vector<double> into_hard;
    for (std::size_t i = 0; i < answer_.friction_heat.size(); ++i)
      into_hard.push_back(answer_.shear_stress[i] * answer_.sliding_velocity[i] * inputs_.dt -
                          answer_.friction_heat[i]);
    bulk_->heat_interface(answer_.friction_heat, into_hard);
  }
  bulk_->conduct(dt_);
}

// Refuses answers of the interface law that are not finite or have an unknown regime. Without this check the fault
// would be noticed only some steps later.
void ShearColumn::check_answer() const {
  for (std::size_t i = 0; i < answer_.shear_stress.size(); ++i) {
    if (std::isfinite(answer_.shear_stress[i]) && std::isfinite(answer_.velocity_jump_new[i]) &&
        std::isfinite(answer_.interface_temperature[i]) && answer_.regime[i] < wire::kRegimeCount) {
      continue;
    }
    throw wire::Error(
        {.code = wire::Code::kUnexpectedReply,
         .text = fmt::format("the interface law answered shear stress {} Pa, jump {} m/s, temperature {} K, "
                             "regime {} for node {} in step {}",
                             answer_.shear_stress[i], answer_.velocity_jump_new[i], answer_.interface_temperature[i],
                             answer_.regime[i], i, inputs_.step),
         .remedy = "this is a fault of the law, not of the scene",
         .field = "shear_stress_pa",
         .node_ids = {i}});
  }
}

void ShearColumn::apply_answer() {
  const std::vector<double>& s = answer_.shear_stress;
  for (std::size_t i = 0; i < s.size(); ++i) traction_hard_[i] = -s[i];
  accelerate_interface(soft_, inputs_.dt, s);
  accelerate_interface(hard_, inputs_.dt, traction_hard_);

  const double mass_soft = soft_.mesh.half_zone_mass();
  const double mass_hard = hard_.mesh.half_zone_mass();
  double* soft_velocity = soft_.velocity_at(0);
  double* hard_velocity = hard_.velocity_at(0);
  for (std::size_t i = 0; i < s.size(); ++i) {
    // Bodies that stick get the same velocity to the last bit. Two separate momentum equations would leave a jump of
    // the size of rounding errors.
    if (answer_.velocity_jump_new[i] == 0.0) {
      const double common = (mass_soft * soft_velocity[i] + mass_hard * hard_velocity[i]) / (mass_soft + mass_hard);
      soft_velocity[i] = common;
      hard_velocity[i] = common;
    }
    const double jump_new = soft_velocity[i] - hard_velocity[i];
    friction_work_[i] += s[i] * 0.5 * (inputs_.velocity_jump[i] + jump_new) * inputs_.dt;
  }
}

ShearColumn::Ledger ShearColumn::ledger(std::size_t column) const {
  return {
      .momentum_start = momentum_start_[column],
      .momentum_end = momentum(soft_, column) + momentum(hard_, column),
      .impulse_of_far_ends = soft_.far_impulse[column] + hard_.far_impulse[column],
      .energy_start = energy_start_[column],
      .energy_end = (bulk_ ? bulk_->energy(soft_, column) : energy(soft_, column, dt_)) + energy(hard_, column, dt_),
      .friction_work = friction_work_[column],
      .plastic_work = bulk_ ? bulk_->plastic_work(column) : 0.0,
      .work_of_far_ends = soft_.far_work[column] + hard_.far_work[column]};
}

}  // namespace shearbus::hydro
