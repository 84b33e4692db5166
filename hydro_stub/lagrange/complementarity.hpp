// The pressures of a contact: p >= 0 with rates w = q + A p >= 0 and p w = 0, where A is symmetric and positive definite
// and couples each row with few others.
#pragma once

#include <vector>

#include "hydro_stub/lagrange/slide_line.hpp"

namespace shearbus::lagrange {

class Complementarity {
 public:
  // Takes the matrix; rows[i] has its own entry first. The matrix must outlive the solutions.
  void set_matrix(const std::vector<std::vector<RowWeight>>& rows);

  // Improves `p`, which on entry is any guess; `w` on entry has the rates at p. A set of rows under pressure is guessed,
  // their equations w = 0 are solved directly, and the set is corrected by the signs of the solution (M. Hintermueller,
  // K. Ito, K. Kunisch, SIAM J. Optim. 13 (2002) 865). Projected over-relaxation then checks the solution, and finds it
  // where the sets do not settle; each of its sweeps reduces the error by a constant factor.
  void solve(std::vector<double>& p, std::vector<double>& w);

 private:
  bool solve_by_sets(std::vector<double>& p, std::vector<double>& w);
  bool factor();
  void solve_under_pressure();
  void relax(std::vector<double>& p, std::vector<double>& w) const;

  const std::vector<std::vector<RowWeight>>* rows_ = nullptr;
  // The rows under pressure, their places among these rows (-1: none), and their Cholesky factor: row a has its entries
  // from column first_[a] to the diagonal, which is at diagonal_[a] of factor_.
  std::vector<int> pressed_, place_, guess_, first_, diagonal_;
  std::vector<double> factor_, q_, x_, next_;
  bool factored_ = false;
};

}  // namespace shearbus::lagrange
