// Two bodies and their interface: the step of the problem shear_column, and its momentum and energy ledgers.
#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "hydro_stub/interface_law.hpp"
#include "hydro_stub/problem.hpp"
#include "hydro_stub/shear_body.hpp"
#include "hydro_stub/shear_bulk.hpp"

namespace shearbus::hydro {

class ShearColumn {
 public:
  explicit ShearColumn(const ColumnProblem& problem);

  // Advances all columns by one step. inputs() and answer() stay valid until the next step.
  void advance(InterfaceLaw& law);

  const InterfaceInputs& inputs() const { return inputs_; }
  const InterfaceAnswer& answer() const { return answer_; }
  double time() const { return inputs_.time; }         // time of the velocities and of the answer  [s]
  std::uint64_t step() const { return inputs_.step; }  // number of completed steps

  const ShearBody& soft() const { return soft_; }
  const ShearBody& hard() const { return hard_; }
  const std::optional<ShearBulk>& bulk() const { return bulk_; }  // absent: the bodies are elastic
  // Gives access to the velocities before the first step, for problems whose initial state is not a uniform jump.
  ShearBody& soft() { return soft_; }
  ShearBody& hard() { return hard_; }

  // Momentum and energy of one column since its first step. Both residuals are 0 in exact arithmetic.
  struct Ledger {
    double momentum_start, momentum_end;  // momentum of both bodies per area of interface  [Pa s]
    double impulse_of_far_ends;           // impulse of the far ends on the bodies  [Pa s]
    double energy_start, energy_end;      // kinetic plus elastic energy  [J/m2]
    double friction_work;                 // work of the bodies against friction, summed over the steps  [J/m2]
    double plastic_work;                  // plastic work of the soft body since the start  [J/m2]
    double work_of_far_ends;              // work of the far ends on the bodies; negative where waves leave  [J/m2]
    double momentum_residual() const { return momentum_end - momentum_start - impulse_of_far_ends; }
    double energy_residual() const {
      return energy_end - energy_start + friction_work + plastic_work - work_of_far_ends;
    }
  };
  Ledger ledger(std::size_t column) const;

 private:
  void gather_inputs();
  void check_answer() const;
  void apply_answer();
  void heat_zones();
  double step_length() const { return inputs_.step == 0 ? 0.5 * dt_ : dt_; }

  double dt_;
  PressureHistory pressure_;
  ShearBody soft_;
  ShearBody hard_;
  std::optional<ShearBulk> bulk_;
  bool law_has_layers_;
  InterfaceInputs inputs_;
  InterfaceAnswer answer_;
  std::vector<double> friction_work_;   // work against friction since the start, per column  [J/m2]
  std::vector<double> momentum_start_;  // momentum of each column before its first step  [Pa s]
  std::vector<double> energy_start_;    // energy of each column before its first step  [J/m2]
  std::vector<double> traction_hard_;   // tau of the hard body at z = 0: -s, because zeta = -z (shear_body.hpp)
};

}  // namespace shearbus::hydro
