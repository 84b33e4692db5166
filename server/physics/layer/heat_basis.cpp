#include "server/physics/layer/heat_basis.hpp"

#include <Eigen/Eigenvalues>
#include <Eigen/QR>
#include <algorithm>
#include <cmath>
#include <limits>

#include "server/physics/layer/wide.hpp"

namespace shearbus::physics {
namespace {

// Smallest amplitude of a live mode  [K]. A thousand modes below 1e-17 K sum to less than half an ulp of 300 K.
constexpr double kDead = 1e-17;

}  // namespace

// The heat equation C dT/dt = -K T, with capacities C and conductances K, is symmetric in the unknowns sqrt(C) T.
HeatBasis::HeatBasis(const HeatGrid& grid, const Material& soft, const Material& hard) {
  const int n = grid.num_vertices();
  Eigen::VectorXd root(n);  // square roots of the capacities
  for (int i = 0; i < n; ++i) root[i] = std::sqrt(grid.capacity(i, soft, hard));
  Eigen::VectorXd diagonal = Eigen::VectorXd::Zero(n);
  Eigen::VectorXd off(n - 1);
  for (int i = 0; i + 1 < n; ++i) {
    const double conductivity = i < grid.interface ? hard.conductivity : soft.conductivity;
    const double conductance = conductivity / grid.width[static_cast<std::size_t>(i)];  // [W/(m2 K)]
    diagonal[i] += conductance / (root[i] * root[i]);
    diagonal[i + 1] += conductance / (root[i + 1] * root[i + 1]);
    off[i] = -conductance / (root[i] * root[i + 1]);
  }
  Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> solver;
  solver.computeFromTridiagonal(diagonal, off);
  Eigen::MatrixXd mode = solver.eigenvectors();
  // Replaces the uniform mode of the eigenvalue solver by the exact one, to conserve heat. Between cells of very different
  // widths the solver's is off by far more than rounding; the other modes are made orthogonal again, slow ones first.
  mode.col(0) = root / root.norm();
  mode.rightCols(n - 1) = Eigen::MatrixXd(Eigen::HouseholderQR<Eigen::MatrixXd>(mode).householderQ()).rightCols(n - 1);

  for (int k = 0; k < n; ++k) {
    rate.push_back(k == 0 ? 0.0 : std::max(0.0, solver.eigenvalues()[k]));
    Eigen::VectorXd temperature = mode.col(k).cwiseQuotient(root);
    if (k == 0) temperature.setOnes();
    const double largest = temperature.cwiseAbs().maxCoeff();
    const double scale = k == 0 ? 1.0 / root.norm() : largest;
    double in_soft = 0.0;
    for (int i = 0; i < n; ++i) {
      shape.push_back(temperature[i] / largest);
      projection.push_back(mode(i, k) * root[i] * scale);
      const double length = grid.weight[static_cast<std::size_t>(i)];  // at z = 0 only the part in the soft body
      if (i >= grid.interface) in_soft += soft.conductivity / soft.diffusivity * length * shape.back();
      if (k == 0) heat += grid.capacity(i, soft, hard);
    }
    at_interface.push_back(temperature[grid.interface] / largest);
    soft_heat.push_back(in_soft);
  }
}

std::vector<double> HeatBasis::decay(double dt) const {
  std::vector<double> left;
  left.reserve(rate.size());
  for (const double r : rate) left.push_back(1.0 / (1.0 + r * dt));
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
