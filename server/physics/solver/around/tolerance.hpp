// Step control: divides a step into substeps until the estimated error of T0 is below the tolerance (METHODS.md).
#pragma once

#include <cstdint>

#include "server/physics/solver/around/substep_error.hpp"
#include "server/physics/solver/pipeline.hpp"
#include "server/physics/solver/problem.hpp"
#include "server/physics/solver/step_operators.hpp"

namespace shearbus::physics {

// One step of the active lanes of a tile in as many substeps as the tolerance needs. Each lane has substeps of its own.
// A substep is accepted if its two halves give the same answer up to its error budget; otherwise its first half is
// tried next. Where the error is small the next substep is twice as long. Lanes with equally long next substeps are
// solved together, the shortest substeps first. The substeps of a lane depend on its own state and inputs alone, and so
// does its work: a lane that has needed more than ModelOptions::work_budget before its end has no answer (kOverBudget).
//
// The step may be interrupted between two substeps. All arguments of the constructor must live until the step is done.
class ControlledStep {
 public:
  // `advance` solves one substep, `first_order` the same by backward Euler if `advance` is of second order, else it is
  // null. `accepted`: memory of one tile.
  ControlledStep(const Problem& problem, const StepOperators& operators, AdvanceTile advance, AdvanceTile first_order,
                 const TileInputs& inputs, const double* committed, double* trial, TileOutputs& outputs,
                 double* accepted);
  ControlledStep(const ControlledStep&) = delete;  // now_ points to work_
  ControlledStep& operator=(const ControlledStep&) = delete;

  // Goes on until the step is done, which the result tells, or all lanes together have done more than this work. When
  // the step is done, the whole of `trial` and the active lanes of `outputs` are written. Lanes without an answer keep
  // their state.
  bool run(double work);

 private:
  // Progress of one lane through its step.
  struct Progress {
    int level = 0;              // the next substep is dt / 2^level long
    std::int64_t at = 0;        // begin of the next substep, in units of the shortest substep
    SubstepAnswer sum;          // answer of the accepted substeps together
    SubstepAnswer coarse;       // answer of the next substep solved in one piece, if coarse_known
    SubstepAnswer first_order;  // the same by backward Euler, if first_order_known
    bool coarse_known = false, first_order_known = false;
    bool refined = false;  // the next substep was shortened because of its error
    bool awake = false;    // some accepted substep was solved
    int attempts = 0;
    double left = 0.0;         // remaining error budget of T0, relative to T_melt less the initial temperature
    double mean_stress = 0.0;  // sum of mean stress times fraction of the step, of the accepted substeps  [Pa]
    double estimate = 0.0;  // estimated error of T0 after the accepted substeps, relative to the same range as `left`
  };

  void begin();
  void relax(const TileOutputs& piece);
  double work_done() const;
  double flux_of(int l) const;
  double yield_of(int l) const;
  Sharing sharing_of(int l) const;
  Substep substep_of(int l) const;
  double share_of(int l) const;
  void take_first_order(int l, const TileOutputs& piece);
  void accept_piece(int l, const TileOutputs& piece, double error);
  std::uint32_t solve(int level, std::uint32_t together);
  void accept_or_refine(int l);
  void move_on(int l, double error);
  void finish(int l);
  void give_up(int l, std::uint8_t outcome);

  double work_[kLanes] = {};        // work of each lane so far
  TileInputs now_;                  // inputs of the next substep
  TileOutputs first_{}, second_{};  // answers of the two halves of the next substep
  const Problem& problem_;
  const StepOperators& operators_;
  const AdvanceTile advance_;      // solves one substep
  const AdvanceTile first_order_;  // solves one substep by backward Euler, or null
  const TileInputs& inputs_;
  const double* committed_;
  double* trial_;
  TileOutputs& outputs_;
  const std::int64_t end_;  // end of the step, in units of its shortest substep
  const SubstepErrors errors_;
  double* const accepted_;  // state after the substeps accepted so far
  double* half_ = nullptr;  // state after the first half of the next substep; scratch memory of the thread in run()
  double* fine_ = nullptr;  // state after both halves of the next substep, likewise
  Progress lanes_[kLanes];
  const int deepest_;
  std::uint32_t open_;  // lanes that have not reached the end of the step
  const bool forced_;
  bool begun_ = false;
};

// Work of a step of one node that the tolerance divides as often as it may; without a tolerance of an undivided step.
// An estimate: a search is assumed to need the usual number of evaluations.
double hard_step_work(const Problem& problem);

// The largest number of times that a step of dt may be halved.
int most_times_halved(double dt);

}  // namespace shearbus::physics
