#include "hydro_stub/lagrange/complementarity.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>

namespace shearbus::lagrange {

void Complementarity::set_matrix(const std::vector<std::vector<RowWeight>>& rows) {
  rows_ = &rows;
  pressed_.clear();
  factored_ = false;
}

void Complementarity::solve(std::vector<double>& p, std::vector<double>& w) {
  solve_by_sets(p, w);
  relax(p, w);
}

bool Complementarity::solve_by_sets(std::vector<double>& p, std::vector<double>& w) {
  const std::vector<std::vector<RowWeight>>& rows = *rows_;
  const int size = static_cast<int>(rows.size());
  q_ = w;
  for (int i = 0; i < size; ++i) {
    if (p[i] == 0.0) continue;
    for (const RowWeight& a : rows[i]) q_[a.row] -= a.weight * p[i];
  }
  guess_.clear();
  for (int i = 0; i < size; ++i) {
    if ((p[i] > 0.0 || w[i] < 0.0) && rows[i].front().weight > 0.0) guess_.push_back(i);
  }
  constexpr int kMostSets = 20;
  for (int tries = 0; tries < kMostSets; ++tries) {
    if (!factored_ || guess_ != pressed_) {
      pressed_ = guess_;
      factored_ = factor();
      if (!factored_) return false;
    }
    solve_under_pressure();
    next_ = q_;
    for (std::size_t a = 0; a < pressed_.size(); ++a) {
      for (const RowWeight& to : rows[pressed_[a]]) next_[to.row] += to.weight * x_[a];
    }
    guess_.clear();
    for (int i = 0; i < size; ++i) {
      const bool is_pressed = place_[i] >= 0;
      if (is_pressed ? x_[place_[i]] > 0.0 : next_[i] < 0.0 && rows[i].front().weight > 0.0) guess_.push_back(i);
    }
    if (guess_ != pressed_) continue;
    std::ranges::fill(p, 0.0);
    for (std::size_t a = 0; a < pressed_.size(); ++a) p[pressed_[a]] = x_[a];
    w = next_;
    return true;
  }
  return false;
}

// Cholesky's factor of the matrix of the rows under pressure, within its envelope. Returns false for a matrix that is not
// positive definite.
bool Complementarity::factor() {
  const std::vector<std::vector<RowWeight>>& rows = *rows_;
  place_.assign(rows.size(), -1);
  for (std::size_t a = 0; a < pressed_.size(); ++a) place_[pressed_[a]] = static_cast<int>(a);
  first_.resize(pressed_.size());
  diagonal_.resize(pressed_.size());
  factor_.clear();
  for (int a = 0; a < static_cast<int>(pressed_.size()); ++a) {
    const std::vector<RowWeight>& row = rows[pressed_[a]];
    int first = a;
    for (const RowWeight& entry : row) {
      if (place_[entry.row] >= 0) first = std::min(first, place_[entry.row]);
    }
    const int begin = static_cast<int>(factor_.size()) - first;  // of column 0, if the row had it
    factor_.resize(factor_.size() + static_cast<std::size_t>(a - first + 1), 0.0);
    double* own = factor_.data() + begin;
    for (const RowWeight& entry : row) {
      const int column = place_[entry.row];
      if (column >= 0 && column <= a) own[column] = entry.weight;
    }
    const double before = own[a];
    for (int c = first; c < a; ++c) {
      const double* other = factor_.data() + diagonal_[c] - c;
      double rest = own[c];
      for (int k = std::max(first, first_[c]); k < c; ++k) rest -= own[k] * other[k];
      own[c] = rest / other[c];
      own[a] -= own[c] * own[c];
    }
    constexpr double kRounding = 1e-12;
    if (!(own[a] > kRounding * before)) return false;
    own[a] = std::sqrt(own[a]);
    first_[a] = first;
    diagonal_[a] = begin + a;
  }
  return true;
}

void Complementarity::solve_under_pressure() {
  const int size = static_cast<int>(pressed_.size());
  x_.resize(size);
  for (int a = 0; a < size; ++a) {
    const double* own = factor_.data() + diagonal_[a] - a;
    double rest = -q_[pressed_[a]];
    for (int k = first_[a]; k < a; ++k) rest -= own[k] * x_[k];
    x_[a] = rest / own[a];
  }
  for (int a = size - 1; a >= 0; --a) {
    const double* own = factor_.data() + diagonal_[a] - a;
    x_[a] /= own[a];
    for (int k = first_[a]; k < a; ++k) x_[k] -= own[k] * x_[a];
  }
}

void Complementarity::relax(std::vector<double>& p, std::vector<double>& w) const {
  constexpr int kMostSweeps = 400;
  constexpr double kTolerance = 1e-13;
  constexpr double kRelaxation = 1.3;  // needs the fewest sweeps on slide lines of the cone: 42, and 84 without it
  const std::vector<std::vector<RowWeight>>& rows = *rows_;
  const int size = static_cast<int>(rows.size());
  const auto relax_row = [&](int i) {
    const double own = rows[i].front().weight;
    if (!(own > 0.0)) return 0.0;
    const double next = std::max(0.0, p[i] - kRelaxation * w[i] / own);
    const double change = next - p[i];
    if (change == 0.0) return 0.0;
    p[i] = next;
    for (const RowWeight& a : rows[i]) w[a.row] += a.weight * change;
    return std::abs(change);
  };
  for (int sweep = 0; sweep < kMostSweeps; ++sweep) {
    double largest = 0.0;
    for (int i = 0; i < size; ++i) largest = std::max(largest, relax_row(i));
    if (largest <= kTolerance * *std::ranges::max_element(p)) break;
  }
}

}  // namespace shearbus::lagrange
