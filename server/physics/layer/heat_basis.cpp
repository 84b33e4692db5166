#include "server/physics/layer/heat_basis.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>

#include "server/physics/layer/wide.hpp"
#include "server/physics/material/elementary.hpp"

namespace shearbus::physics {
namespace {

// Smallest amplitude of a live mode  [K]. A thousand modes below 1e-17 K sum to less than half an ulp of 300 K.
constexpr double kDead = 1e-17;
// Modes whose decay rates differ by less than this fraction are made orthogonal to each other.
constexpr double kClose = 1e-2;

// The modes u of C dT/dt = -K T with capacities C and conductances K between neighbouring vertices: K u = rate C u.
// Every step below is a sum of terms of one sign, a product or a quotient, except where an admittance meets a shift:
// rates and modes have few wrong digits relative to themselves, not to the fastest rate (Dhillon and Parlett 2004,
// "Multiple representations"). A fast mode thus is tiny far from the thin cells in which it lives, by its own digits.
class Chain {
 public:
  // Of the vertices that are not held; a held one is the ground to which its neighbour conducts.
  Chain(const HeatGrid& grid, const Material& soft, const Material& hard) {
    const int n = grid.num_vertices();
    const int first = grid.hard_end_is_held ? 1 : 0, last = n - (grid.soft_end_is_held ? 2 : 1);
    for (int i = first; i <= last; ++i) capacity_.push_back(grid.capacity(i, soft, hard));
    for (int i = 0; i + 1 < n; ++i) {
      const double conductivity = i < grid.interface ? hard.conductivity : soft.conductivity;
      const double conductance = conductivity / grid.width[static_cast<std::size_t>(i)];
      if (i < first) {
        ground_before_ = conductance;
      } else if (i >= last) {
        ground_behind_ = conductance;
      } else {
        conductance_.push_back(conductance);
      }
    }
  }

  bool grounded() const { return ground_before_ > 0.0 || ground_behind_ > 0.0; }
  // Temperatures that are steady while the held vertex before the chain has 1 K and that behind it 0 K, or nothing flows.
  std::vector<double> steady() const {
    std::vector<double> u(size(), 1.0);
    if (ground_before_ == 0.0 || ground_behind_ == 0.0) return u;
    double resistance = 1.0 / ground_behind_;
    for (std::size_t i = size(); i-- > 0;) {
      u[i] = resistance;
      resistance += 1.0 / (i > 0 ? conductance_[i - 1] : ground_before_);
    }
    for (double& each : u) each /= resistance;
    return u;
  }

  const std::vector<double>& capacity() const { return capacity_; }
  std::size_t size() const { return capacity_.size(); }

  // All decay rates, ascending, each bisected to its last digit.
  std::vector<double> rates() const {
    const std::size_t n = size();
    double bound = 0.0;
    for (std::size_t i = 0; i < n; ++i)
      bound = std::max(
          bound, ((i > 0 ? conductance_[i - 1] : ground_before_) + (i + 1 < n ? conductance_[i] : ground_behind_)) /
                     capacity_[i]);
    std::vector<double> low(n, 0.0), high(n, 2.0001 * bound);
    for (std::size_t k = grounded() ? 0 : 1; k < n; ++k) {
      for (;;) {
        const double middle = 0.5 * (low[k] + high[k]);
        if (middle <= low[k] || middle >= high[k]) break;
        const std::size_t slower = num_slower(middle);
        for (std::size_t j = k; j < slower; ++j) high[j] = std::min(high[j], middle);
        for (std::size_t j = std::max(k, slower); j < n; ++j) low[j] = std::max(low[j], middle);
      }
    }
    return low;
  }

  // The mode of a decay rate. `taken`: the share of each vertex that modes of nearly the same rate have, 0 to 1.
  std::vector<double> mode(double rate, const std::vector<double>& taken) const {
    const std::size_t n = size();
    // Admittances of the bodies up to and from each vertex on, without the rest.
    std::vector<double> before(n), behind(n), u(n);
    before[0] = ground_before_ - rate * capacity_[0];
    for (std::size_t i = 0; i + 1 < n; ++i) before[i + 1] = passed(i, before[i]) - rate * capacity_[i + 1];
    behind[n - 1] = ground_behind_ - rate * capacity_[n - 1];
    for (std::size_t i = n - 1; i-- > 0;) behind[i] = passed(i, behind[i + 1]) - rate * capacity_[i];
    // The vertex from which the mode is built is that whose own balance is met best.
    std::size_t from = 0;
    double least = std::numeric_limits<double>::infinity();
    for (std::size_t i = 0; i < n; ++i) {
      const double unmet = std::abs(before[i] + (behind[i] + rate * capacity_[i]));
      const double open = capacity_[i] * std::max(1.0 - taken[i], std::numeric_limits<double>::epsilon());
      if (unmet < least * open) {
        least = unmet / open;
        from = i;
      }
    }
    u[from] = 1.0;
    for (std::size_t i = from; i-- > 0;) u[i] = u[i + 1] * (conductance_[i] / pivot(i, before[i]));
    for (std::size_t i = from; i + 1 < n; ++i) u[i + 1] = u[i] * (conductance_[i] / pivot(i, behind[i + 1]));
    return u;
  }

  double product(const double* u, const double* v) const {
    double sum = 0.0;
    for (std::size_t i = 0; i < size(); ++i) sum += capacity_[i] * u[i] * v[i];
    return sum;
  }

 private:
  // Number of modes that decay more slowly than `rate`: of negative pivots of K - rate C (Sylvester's law of inertia).
  std::size_t num_slower(double rate) const {
    std::size_t count = 0;
    double admittance = ground_before_ - rate * capacity_[0];
    for (std::size_t i = 0; i + 1 < size(); ++i) {
      count += pivot(i, admittance) < 0.0;
      admittance = passed(i, admittance) - rate * capacity_[i + 1];
    }
    return count + (admittance + ground_behind_ < 0.0);
  }
  double pivot(std::size_t cell, double admittance) const {
    const double sum = conductance_[cell] + admittance;
    return sum != 0.0 ? sum : -std::numeric_limits<double>::epsilon() * conductance_[cell];
  }
  // Admittance of a conductance in series with an admittance.
  double passed(std::size_t cell, double admittance) const {
    return conductance_[cell] * (admittance / pivot(cell, admittance));
  }

  std::vector<double> capacity_, conductance_;
  double ground_before_ = 0.0, ground_behind_ = 0.0;  // conductances to held vertices; 0: none
};

}  // namespace

HeatBasis::HeatBasis(const HeatGrid& grid, const Material& soft, const Material& hard)
    : holds_ends(grid.soft_end_is_held || grid.hard_end_is_held) {
  const Chain chain(grid, soft, hard);
  const auto num_vertices = static_cast<std::size_t>(grid.num_vertices());
  const std::size_t n = chain.size(), first = grid.hard_end_is_held ? 1 : 0;
  const std::vector<double>& capacity = chain.capacity();
  for (int i = 0; i < grid.num_vertices(); ++i) heat += grid.capacity(i, soft, hard);
  if (holds_ends) add_steady_modes(grid, soft, hard, chain.steady());
  const std::vector<double> rates = chain.rates(), steady = chain.steady();
  std::vector<double> taken(n), shapes, projections;
  for (std::size_t k = 0; k < n; ++k) {
    std::size_t close = k;  // the first mode whose rate is close to that of mode k
    while (close > (holds_ends ? 0U : 1U) && rates[k] - rates[close - 1] < kClose * rates[k]) --close;
    const auto shape_of = [&](std::size_t j) { return shapes.data() + j * n; };
    std::fill(taken.begin(), taken.end(), 0.0);
    for (std::size_t j = close; j < k; ++j)
      for (std::size_t i = 0; i < n; ++i) taken[i] += projections[j * n + i] * shapes[j * n + i];
    std::vector<double> u = k == 0 && !holds_ends ? std::vector<double>(n, 1.0) : chain.mode(rates[k], taken);
    for (std::size_t j = close; j < k; ++j) {
      const double share = chain.product(shape_of(j), u.data()) / chain.product(shape_of(j), shape_of(j));
      for (std::size_t i = 0; i < n; ++i) u[i] -= share * shape_of(j)[i];
    }
    double largest = 0.0;
    for (const double each : u) largest = std::max(largest, std::abs(each));
    for (double& each : u) each /= largest;
    const double square = chain.product(u.data(), u.data());
    std::vector<double> whole(num_vertices, 0.0), of_whole(num_vertices, 0.0);
    for (std::size_t i = 0; i < n; ++i) {
      shapes.push_back(u[i]);
      projections.push_back(capacity[i] * u[i] / square);
      whole[first + i] = u[i];
      of_whole[first + i] = projections.back();
      // The mode is that of the temperatures above the steady ones, which follow from those of the held ends.
      if (grid.hard_end_is_held) of_whole.front() -= projections.back() * steady[i];
      if (grid.soft_end_is_held)
        of_whole.back() -= projections.back() * (grid.hard_end_is_held ? 1.0 - steady[i] : 1.0);
    }
    add_mode(grid, soft, hard, rates[k], whole, of_whole);
  }
}

void HeatBasis::add_mode(const HeatGrid& grid, const Material& soft, const Material& hard, double decay_rate,
                         const std::vector<double>& u, const std::vector<double>& of_profile) {
  double in_soft = 0.0, in_hard = 0.0;
  for (int i = 0; i < grid.num_vertices(); ++i) {
    const auto vertex = static_cast<std::size_t>(i);
    const double length = grid.weight[vertex];  // at z = 0 only the part in the soft body
    if (i >= grid.interface) in_soft += soft.conductivity / soft.diffusivity * length * u[vertex];
    const double in_hard_body = i < grid.interface ? length : i == grid.interface ? grid.hard_weight : 0.0;
    in_hard += hard.conductivity / hard.diffusivity * in_hard_body * u[vertex];
  }
  rate.push_back(decay_rate);
  shape.insert(shape.end(), u.begin(), u.end());
  projection.insert(projection.end(), of_profile.begin(), of_profile.end());
  at_interface.push_back(u[static_cast<std::size_t>(grid.interface)]);
  soft_heat.push_back(in_soft);
  hard_heat.push_back(in_hard);
}

// The modes of rate 0 of a chain with held ends: all vertices as warm as one end and, if both are held, the steady
// temperatures of a hard end that is 1 K warmer than the soft one.
void HeatBasis::add_steady_modes(const HeatGrid& grid, const Material& soft, const Material& hard,
                                 const std::vector<double>& steady) {
  const auto n = static_cast<std::size_t>(grid.num_vertices());
  std::vector<double> of_end(n, 0.0);
  (grid.soft_end_is_held ? of_end.back() : of_end.front()) = 1.0;
  add_mode(grid, soft, hard, 0.0, std::vector<double>(n, 1.0), of_end);
  if (!grid.soft_end_is_held || !grid.hard_end_is_held) return;
  std::vector<double> u(n, 0.0), of_difference(n, 0.0);
  u.front() = of_difference.front() = 1.0;
  std::copy(steady.begin(), steady.end(), u.begin() + 1);
  of_difference.back() = -1.0;
  add_mode(grid, soft, hard, 0.0, u, of_difference);
}

std::vector<double> HeatBasis::decay(double dt, bool exact) const {
  std::vector<double> left;
  left.reserve(rate.size());
  for (const double r : rate) left.push_back(exact || exact_in_time ? exponential(-r * dt) : 1.0 / (1.0 + r * dt));
  return left;
}

SHEARBUS_WIDE int to_modes(const HeatBasis& basis, int lane, double* rows) {
  const std::ptrdiff_t n = basis.num_modes();
  double temperature[kMaxBasisVertices];
  // Modes represent temperatures above that of the colder end, which mode 0 takes up again below.
  const double far = std::min(rows[lane], rows[(n - 1) * kLanes + lane]);
  for (std::ptrdiff_t i = 0; i < n; ++i) temperature[i] = rows[i * kLanes + lane] - far;
  for (std::ptrdiff_t k = 0; k < n; ++k) {
    const double* projection = basis.projection.data() + k * n;
    double part[kLanes] = {};  // partial sums, which vectorise
    std::ptrdiff_t i = 0;
    for (; i + kLanes <= n; i += kLanes)
      for (int j = 0; j < kLanes; ++j) part[j] += projection[i + j] * temperature[i + j];
    for (; i < n; ++i) part[0] += projection[i] * temperature[i];
    rows[k * kLanes + lane] = ((part[0] + part[1]) + (part[2] + part[3])) + ((part[4] + part[5]) + (part[6] + part[7]));
  }
  rows[lane] += far;
  return still_living(basis.num_modes(), lane, rows);
}

SHEARBUS_WIDE void to_profile(const HeatBasis& basis, int num_live, int lane, const double* amplitudes,
                              double* temperature) {
  const std::ptrdiff_t n = basis.num_modes();
  double sum[kMaxBasisVertices];
  std::fill_n(sum, n, 0.0);
  // Mode 0, the mean, is added last: if added first, it would round off the other modes.
  for (std::ptrdiff_t k = num_live; k-- > 0;) {
    const double* shape = basis.shape.data() + k * n;
    const double amplitude = amplitudes[k * kLanes + lane];
    for (std::ptrdiff_t i = 0; i < n; ++i) sum[i] += amplitude * shape[i];
  }
  for (std::ptrdiff_t i = 0; i < n; ++i) temperature[i * kLanes + lane] = sum[i];
}

SHEARBUS_WIDE void interface_later(const HeatBasis& basis, const double* decay, int num_live, const double* amplitudes,
                                   double (&T0)[kLanes]) {
  double sum[kLanes] = {};
  for (std::ptrdiff_t k = num_live; k-- > 0;) {
    const double share = basis.at_interface[static_cast<std::size_t>(k)];
    for (int l = 0; l < kLanes; ++l) sum[l] += share * (decay[k] * amplitudes[k * kLanes + l]);
  }
  for (int l = 0; l < kLanes; ++l) T0[l] = sum[l];
}

SHEARBUS_WIDE void decay_modes(const double* decay, int num_live, int num_modes, const double* before, double* after) {
  for (std::ptrdiff_t k = 0; k < num_live; ++k) {
    for (int l = 0; l < kLanes; ++l) after[k * kLanes + l] = decay[k] * before[k * kLanes + l];
  }
  std::fill_n(after + std::ptrdiff_t{num_live} * kLanes, std::ptrdiff_t{num_modes - num_live} * kLanes, 0.0);
}

int still_living(int num_live, int lane, double* amplitudes) {
  while (num_live > 1) {
    double& last = amplitudes[std::ptrdiff_t{num_live - 1} * kLanes + lane];
    if (std::abs(last) >= kDead) break;
    last = 0.0;
    --num_live;
  }
  return num_live;
}

}  // namespace shearbus::physics
