// Two bodies and their interface: one step of the problem shear_column, and the ledgers that say what the step did.
#pragma once

#include <cstdint>
#include <vector>

#include "hydro_stub/interface_law.hpp"
#include "hydro_stub/problem.hpp"
#include "hydro_stub/shear_body.hpp"

namespace shearbus::hydro {

class ShearColumn {
 public:
  explicit ShearColumn(const Problem& problem);

  // One step of all columns. What the law was asked and what it answered stay readable until the next step.
  void advance(InterfaceLaw& law);

  const InterfaceInputs& inputs() const { return inputs_; }
  const InterfaceAnswer& answer() const { return answer_; }
  double time() const { return inputs_.time; }         // of the velocities and of the answer  [s]
  std::uint64_t step() const { return inputs_.step; }  // steps taken

  const ShearBody& soft() const { return soft_; }
  const ShearBody& hard() const { return hard_; }
  // For problems that start otherwise than at rest with a jump: change velocities before the first step.
  ShearBody& soft() { return soft_; }
  ShearBody& hard() { return hard_; }

  // Of one column since its first step. Each ledger's residual is what a perfect sum would leave at 0.
  struct Ledger {
    double momentum_start, momentum_end;  // [Pa s]
    double impulse_of_far_ends;           // [Pa s]
    double energy_start, energy_end;      // kinetic and elastic  [J/m2]
    double friction_work;                 // taken from the bodies at the interface, s [V]mid dt  [J/m2]
    double work_of_far_ends;              // done on the bodies; negative where waves leave  [J/m2]
    double momentum_residual() const { return momentum_end - momentum_start - impulse_of_far_ends; }
    double energy_residual() const { return energy_end - energy_start + friction_work - work_of_far_ends; }
  };
  Ledger ledger(std::size_t column) const;

 private:
  void gather_inputs();
  void check_answer() const;
  void apply_answer();
  double step_length() const { return inputs_.step == 0 ? 0.5 * dt_ : dt_; }

  double dt_;
  PressureHistory pressure_;
  ShearBody soft_;
  ShearBody hard_;
  InterfaceInputs inputs_;
  InterfaceAnswer answer_;
  std::vector<double> friction_work_;   // [J/m2]
  std::vector<double> momentum_start_;  // [Pa s]
  std::vector<double> energy_start_;    // [J/m2]
  std::vector<double> traction_hard_;   // -s: the interface pulls the hard body on  [Pa]
};

}  // namespace shearbus::hydro
