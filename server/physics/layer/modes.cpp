#include "server/physics/layer/modes.hpp"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>

#include "server/physics/layer/conduction.hpp"
#include "server/physics/material/elementary.hpp"

namespace shearbus::physics {
namespace {

constexpr double kPi = 3.14159265358979323846;
constexpr double kUnfelt = 160.0;  // for larger h^2/(alpha t) the first image source, exp(-h^2/(alpha t)), counts as 0
constexpr double kSpent = 40.0;    // exp(-x) is below rounding for larger x
constexpr double kPanelRatio = 8.0;  // ratio of mu = sqrt(rate) between the two ends of a panel of the spectrum
constexpr int kSamples = 64;         // number of samples of the continuous spectrum in a panel
constexpr int kLongestRule = 24;     // largest number of nodes of the Gauss rule of a panel
constexpr int kTimesPerDecade = 40;  // times per decade of t at which the error of K(t) is measured

// Discrete lines of the spectrum of the heat kernel: K(t) = sum of weight exp(-mu^2 t), where mu is the square root of
// a decay rate (here mu is not the friction coefficient).
struct Lines {
  std::vector<double> mu;  // square root of the decay rate of each line  [s^(-1/2)]
  std::vector<double> weight;
};

// Nodes and weights of the Gauss rule whose orthogonal polynomials have the given three-term recurrence (Golub, Welsch
// 1969).
struct Rule {
  Eigen::VectorXd node, weight;
};
Rule rule_from_recurrence(const Eigen::VectorXd& centre, const Eigen::VectorXd& off, double mass) {
  Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> solver;
  solver.computeFromTridiagonal(centre, off);
  return {solver.eigenvalues(), mass * solver.eigenvectors().row(0).transpose().array().square().matrix()};
}

// The Gauss-Legendre rule with n nodes on [-1, 1].
Rule legendre(int n) {
  Eigen::VectorXd off(n - 1);
  for (int i = 1; i < n; ++i) off[i - 1] = i / std::sqrt(4.0 * i * i - 1.0);
  return rule_from_recurrence(Eigen::VectorXd::Zero(n), off, 2.0);
}

// The n-point Gauss rule that replaces a sum over the points x with weights w (Stieltjes' procedure).
Rule gauss_rule(const Eigen::ArrayXd& x, const Eigen::ArrayXd& w, int n) {
  const double mass = w.sum();
  Eigen::VectorXd centre(n), off(n);
  Eigen::ArrayXd before = Eigen::ArrayXd::Zero(x.size());
  Eigen::ArrayXd p = Eigen::ArrayXd::Constant(x.size(), 1.0 / std::sqrt(mass));
  double scale = 0.0;
  for (int i = 0; i < n; ++i) {
    centre[i] = (w * x * p * p).sum();
    const Eigen::ArrayXd next = (x - centre[i]) * p - scale * before;
    scale = std::sqrt((w * next * next).sum());
    off[i] = scale;
    before = p;
    p = next / scale;
  }
  return rule_from_recurrence(centre, off.head(n - 1), mass);
}

// Appends to `sum` the n lines of the Gauss rule that replaces the lines of a panel (an interval of the spectrum). In
// the first panel, which begins at 0, the variable of the rule is the rate mu^2, because exp(-rate t) is nearly linear
// there. In the other panels it is log(mu), which makes these panels alike.
void add_reduced(const Lines& panel, int n, bool first, Lines& sum) {
  if (static_cast<int>(panel.mu.size()) <= n) {
    sum.mu.insert(sum.mu.end(), panel.mu.begin(), panel.mu.end());
    sum.weight.insert(sum.weight.end(), panel.weight.begin(), panel.weight.end());
    return;
  }
  const auto size = static_cast<Eigen::Index>(panel.mu.size());
  const Eigen::Map<const Eigen::ArrayXd> mu(panel.mu.data(), size);
  const Eigen::Map<const Eigen::ArrayXd> weight(panel.weight.data(), size);
  const Eigen::ArrayXd x = first ? Eigen::ArrayXd(mu * mu) : Eigen::ArrayXd(mu.unaryExpr(&logarithm));
  const Rule rule = gauss_rule(x, weight, n);
  for (int i = 0; i < n; ++i) {
    sum.mu.push_back(first ? std::sqrt(std::max(0.0, rule.node[i])) : exponential(rule.node[i]));
    sum.weight.push_back(rule.weight[i]);
  }
}

// Returns the spectrum of the heat kernel from mu = `from` to mu = `to`, where mu is the square root of a decay rate
// [s^(-1/2)]. With `even`: samples of the half-space, whose spectrum is continuous with constant density in mu.
// Otherwise: the discrete lines of the slab, without the line at rate 0.
Lines spectrum(const HeatKernel& kernel, const Rule& samples, bool even, double from, double to) {
  Lines lines;
  if (even) {
    const double density = 2.0 * kernel.half_space / std::sqrt(kPi);
    for (int i = 0; i < kSamples; ++i) {
      lines.mu.push_back(0.5 * (from + to) + 0.5 * (to - from) * samples.node[i]);
      lines.weight.push_back(0.5 * (to - from) * density * samples.weight[i]);
    }
    return lines;
  }
  const double spacing = std::sqrt(kernel.diffusivity) * kPi / kernel.thickness;
  const double lowest = kernel.lowest_line();
  for (double m = lowest + std::max(0.0, std::ceil(from / spacing - lowest)); m * spacing < to; m += 1.0) {
    lines.mu.push_back(m * spacing);
    lines.weight.push_back(2.0 * kernel.diffusivity / (kernel.conductivity * kernel.thickness));
  }
  return lines;
}

double largest_error(const HeatKernel& kernel, const Lines& lines, double shortest, double longest) {
  const int times = std::max(2, static_cast<int>(kTimesPerDecade * logarithm(longest / shortest) / logarithm(10.0)));
  double worst = 0.0;
  for (int i = 0; i <= times; ++i) {
    const double t = shortest * exponential(logarithm(longest / shortest) * i / times);
    double sum = 0.0;
    for (std::size_t j = 0; j < lines.mu.size(); ++j) {
      sum += lines.weight[j] * exponential(-lines.mu[j] * lines.mu[j] * t);
    }
    worst = std::max(worst, std::abs(sum / kernel.at(t) - 1.0));
  }
  return worst;
}

}  // namespace

HeatKernel::HeatKernel(const Material& soft, const GridOptions& layer)
    : thickness(layer.far_boundary == FarBoundary::kHalfSpace ? std::numeric_limits<double>::infinity()
                                                              : layer.thickness),
      held(layer.far_boundary == FarBoundary::kIsothermal),
      conductivity(soft.conductivity),
      diffusivity(soft.diffusivity),
      half_space(std::sqrt(soft.diffusivity / kPi) / soft.conductivity) {}

bool HeatKernel::far_face_unfelt(double t) const {
  return thickness * thickness > kUnfelt * diffusivity * t;
}

// The kernel of a slab is the sum over its spectrum, K = alpha / (k h) (1 + 2 sum exp(-rate_m t)), where
// rate_m = alpha (m pi / h)^2. Few terms are needed: short times, which would need many, are left to the formula of the
// half-space (far_face_unfelt()). The sums of 1/rate_m and 1/rate_m^2 over all m are h^2/(6 alpha) and h^4/(90
// alpha^2). With a held far face m is half-integer, the term 1 is missing, and these sums are h^2/(2 alpha) and
// h^4/(6 alpha^2).
double HeatKernel::at(double t) const {
  if (far_face_unfelt(t)) return half_space / std::sqrt(t);
  const double first = diffusivity * (kPi / thickness) * (kPi / thickness);
  double sum = held ? 0.0 : 1.0;
  for (double m = lowest_line(); m * m * first * t < kSpent; m += 1.0) sum += 2.0 * exponential(-m * m * first * t);
  return diffusivity / (conductivity * thickness) * sum;
}

double HeatKernel::integral(double t) const {
  if (far_face_unfelt(t)) return 2.0 * half_space * std::sqrt(t);
  const double first = diffusivity * (kPi / thickness) * (kPi / thickness);
  const double square = thickness * thickness / diffusivity;
  double sum = held ? square : t + thickness * thickness / (3.0 * diffusivity);
  for (double m = lowest_line(); m * m * first * t < kSpent; m += 1.0) {
    const double rate = m * m * first;
    sum -= 2.0 * exponential(-rate * t) / rate;
  }
  return diffusivity / (conductivity * thickness) * sum;
}

double HeatKernel::moment(double t) const {
  if (far_face_unfelt(t)) return 2.0 / 3.0 * half_space * t * std::sqrt(t);
  const double first = diffusivity * (kPi / thickness) * (kPi / thickness);
  const double square = thickness * thickness / diffusivity;
  double sum = held ? square * square / 3.0 : 0.5 * t * t + square * square / 45.0;
  for (double m = lowest_line(); m * m * first * t < kSpent; m += 1.0) {
    const double rate = m * m * first;
    sum -= 2.0 * (1.0 + rate * t) * exponential(-rate * t) / (rate * rate);
  }
  return diffusivity / (conductivity * thickness) * sum;
}

HeatModes::HeatModes(const HeatKernel& of, const ModesOptions& options) : kernel(of) {
  const double shortest = options.shortest_step / kHalvingsCovered;
  const double first_end = 1.0 / std::sqrt(options.longest_time);
  const double end = std::sqrt(logarithm(4.0 / options.accuracy) / shortest);
  const int panels = std::max(1, static_cast<int>(std::ceil(logarithm(end / first_end) / logarithm(kPanelRatio))));
  const double ratio = exponential(logarithm(end / first_end) / panels);
  const bool even = kernel.far_face_unfelt(options.longest_time);

  const Rule samples = legendre(kSamples);
  std::vector<Lines> spectra = {spectrum(kernel, samples, even, 0.0, first_end)};
  for (double from = first_end; static_cast<int>(spectra.size()) <= panels; from *= ratio) {
    spectra.push_back(spectrum(kernel, samples, even, from, from * ratio));
  }

  Lines best;
  for (int n = 2; n <= kLongestRule; ++n) {
    best = {};
    if (!even && !kernel.held) best = {{0.0}, {kernel.diffusivity / (kernel.conductivity * kernel.thickness)}};
    for (std::size_t i = 0; i < spectra.size(); ++i) add_reduced(spectra[i], i == 0 ? (n + 2) / 2 : n, i == 0, best);
    error = largest_error(kernel, best, shortest, options.longest_time);
    if (error <= options.accuracy) break;
  }
  for (const double mu : best.mu) rate.push_back(mu * mu);
  weight = std::move(best.weight);
}

ModeOperator::ModeOperator(int num_rows, double step)
    : dt(step),
      interface(num_rows - 1),
      decay(static_cast<std::size_t>(num_rows) - 2),
      gain(static_cast<std::size_t>(num_rows) - 2) {}

ModeOperator::ModeOperator(const HeatModes& modes, double step) : ModeOperator(modes.num_rows(), step) {
  fill(modes);
}

void ModeOperator::fill(const HeatModes& modes) {
  response = modes.kernel.integral(dt);
  for (std::size_t j = 0; j < modes.rate.size(); ++j) {
    const double x = modes.rate[j] * dt;
    decay[j] = exponential(-x);
    gain[j] = modes.weight[j] * dt * (x > 0.0 ? -exponential_minus_1(-x) / x : 1.0);
  }
}

// The flux at the time s before the end of the step is q - (q - q_early) s / ((1 - early) dt): linear in time, with the
// value q_early at the time `early` dt.
ModeOperator::ModeOperator(const HeatModes& modes, double step, double early) : ModeOperator(modes, step) {
  const double span = (1.0 - early) * dt;
  early_response = modes.kernel.moment(dt) / span;
  response -= early_response;
  for (std::size_t j = 0; j < modes.rate.size(); ++j) {
    const double x = modes.rate[j] * dt;
    // Computes (1 - (1 + x) exp(-x)) / x^2, by its series where the closed form would cancel.
    constexpr double kSmall = 0.02;
    const double moment = x < kSmall ? 0.5 - x * (1.0 / 3 - x * (1.0 / 8 - x * (1.0 / 30 - x * (1.0 / 144 - x / 840))))
                                     : (1.0 - (1.0 + x) * decay[j]) / (x * x);
    early_gain.push_back(modes.weight[j] * dt * dt * moment / span);
    gain[j] -= early_gain[j];
  }
}

void conduct(const ModeOperator& heat, int num_rows, const double* before, double* after, std::ptrdiff_t /*next*/) {
  double* T0 = after + (std::ptrdiff_t{num_rows} - 1) * kLanes;
  std::copy_n(before, kLanes, T0);
  std::copy_n(before, kLanes, after);
  conduct_rows(heat.decay, before + kLanes, after + kLanes, T0);
}

void conduct_lane(const ModeOperator& heat, int num_rows, int lane, double* rows) {
  double T0 = rows[lane];
  for (std::ptrdiff_t i = 1; i < num_rows - 1; ++i) {
    T0 += rows[i * kLanes + lane] *= heat.decay[static_cast<std::size_t>(i - 1)];
  }
  rows[(num_rows - 1) * kLanes + lane] = T0;
}

void add_flux(const ModeOperator& heat, int num_rows, const double (&flux)[kLanes], double* rows) {
  add_to_rows(heat.gain, flux, rows + kLanes);
  add_to_rows({&heat.response, 1}, flux, rows + (std::ptrdiff_t{num_rows} - 1) * kLanes);
}
void add_early_flux(const ModeOperator& heat, int num_rows, const double (&flux)[kLanes], double* rows) {
  add_to_rows(heat.early_gain, flux, rows + kLanes);
  add_to_rows({&heat.early_response, 1}, flux, rows + (std::ptrdiff_t{num_rows} - 1) * kLanes);
}

void add_flux_lane(const ModeOperator& heat, int num_rows, int lane, double flux, double* rows) {
  for (std::ptrdiff_t i = 1; i < num_rows - 1; ++i) {
    rows[i * kLanes + lane] += flux * heat.gain[static_cast<std::size_t>(i - 1)];
  }
  rows[(std::ptrdiff_t{num_rows} - 1) * kLanes + lane] += flux * heat.response;
}

}  // namespace shearbus::physics
