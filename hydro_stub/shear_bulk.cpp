#include "hydro_stub/shear_bulk.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "hydro_stub/lagrange/strength.hpp"

namespace shearbus::hydro {
namespace {

std::vector<double> widths_of(const BodyMesh& mesh) {
  std::vector<double> widths;
  for (std::size_t j = 0; j < mesh.zones; ++j) widths.push_back(mesh.width(j));
  return widths;
}

std::vector<double> spread(std::span<const double> of_columns, std::size_t zones) {
  std::vector<double> all;
  for (std::size_t j = 0; j < zones; ++j) all.insert(all.end(), of_columns.begin(), of_columns.end());
  return all;
}

}  // namespace

ShearBulk::ShearBulk(const physics::Material& soft, const physics::Material& hard, const ShearBody& soft_body,
                     const ShearBody& hard_body, std::span<const double> temperature, bool conducts_across)
    : metal_(soft),
      columns_(soft_body.mesh.columns),
      soft_{soft.conductivity, soft.diffusivity, widths_of(soft_body.mesh)},
      hard_{hard.conductivity, hard.diffusivity, widths_of(hard_body.mesh)},
      conducts_across_(conducts_across),
      soft_temperature_(spread(temperature, soft_body.mesh.zones)),
      hard_temperature_(spread(temperature, hard_body.mesh.zones)),
      plastic_strain_(soft_body.stress.size(), 0.0),
      increment_(soft_body.stress.size(), 0.0),
      stress_old_(soft_body.stress.size(), 0.0),
      plastic_rate_(columns_, 0.0),
      plastic_work_(columns_, 0.0),
      flux_(columns_) {}

void ShearBulk::strain_soft(ShearBody& body, double dt, std::span<const double> pressure) {
  const double capacity = soft_.conductivity / soft_.diffusivity;  // [J/(m3 K)]
  stress_old_ = body.stress;
  for (std::size_t j = 0; j < body.mesh.zones; ++j) {
    const double* inner = body.velocity_at(j);
    const double* outer = body.velocity_at(j + 1);
    double* stress = body.stress_at(j);
    const double inverse = 1.0 / soft_.width[j];
    for (std::size_t first = 0; first < columns_; first += lagrange::Strip::kMostZones) {
      const std::size_t last = std::min(columns_, first + lagrange::Strip::kMostZones);
      lagrange::Strip strip;
      for (std::size_t i = first; i < last; ++i) {
        // Half of the shear as a rate of xy, half of yx: no spin, since the column does not turn.
        const double half = 0.5 * (outer[i] - inner[i]) * inverse;
        strip.add({.xy = stress[i]}, {.xx = 0.0, .xy = half, .yx = half, .yy = 0.0, .tt = 0.0},
                  plastic_strain_[j * columns_ + i], pressure[i], soft_temperature_[j * columns_ + i]);
      }
      lagrange::advance_deviators(metal_, dt, strip);
      for (std::size_t i = first; i < last; ++i) {
        const lagrange::StrengthStep step = strip.step(static_cast<int>(i - first));
        const std::size_t at = j * columns_ + i;
        const double shear = std::copysign(std::numbers::sqrt3 * step.plastic_strain_increment, step.deviator.xy);
        plastic_work_[i] += soft_.width[j] * stress[i] * 0.5 * (increment_[at] + shear);
        increment_[at] = shear;
        stress[i] = step.deviator.xy;
        plastic_strain_[at] += step.plastic_strain_increment;
        soft_temperature_[at] += std::abs(step.deviator.xy * shear) / capacity;
        if (j == 0) plastic_rate_[i] = std::copysign(step.plastic_strain_increment / dt, step.deviator.xy);
      }
    }
  }
}

void ShearBulk::heat_interface(std::span<const double> soft, std::span<const double> hard) {
  for (std::size_t i = 0; i < columns_; ++i) {
    soft_temperature_[i] += soft[i] * soft_.diffusivity / (soft_.conductivity * soft_.width.front());
    hard_temperature_[i] += hard[i] * hard_.diffusivity / (hard_.conductivity * hard_.width.front());
  }
}

void ShearBulk::conduct_inside(const Conductor& body, double dt, std::vector<double>& temperature) {
  std::fill(flux_.begin(), flux_.end(), 0.0);  // into zone j from zone j - 1  [W/m2]
  for (std::size_t j = 0; j < body.width.size(); ++j) {
    double* here = temperature.data() + j * columns_;
    const bool last = j + 1 == body.width.size();
    const double conductance = last ? 0.0 : 2.0 * body.conductivity / (body.width[j] + body.width[j + 1]);
    const double scale = dt * body.diffusivity / (body.conductivity * body.width[j]);
    for (std::size_t i = 0; i < columns_; ++i) {
      const double out = last ? 0.0 : conductance * (here[i] - here[i + columns_]);
      here[i] += scale * (flux_[i] - out);
      flux_[i] = out;
    }
  }
}

void ShearBulk::conduct(double dt) {
  std::vector<double> across(columns_, 0.0);
  if (conducts_across_) {
    const double resistance =
        0.5 * (soft_.width.front() / soft_.conductivity + hard_.width.front() / hard_.conductivity);
    for (std::size_t i = 0; i < columns_; ++i)
      across[i] = dt * (soft_temperature_[i] - hard_temperature_[i]) / resistance;
  }
  conduct_inside(soft_, dt, soft_temperature_);
  conduct_inside(hard_, dt, hard_temperature_);
  if (!conducts_across_) return;
  std::vector<double> into_soft = across;
  for (double& heat : into_soft) heat = -heat;
  heat_interface(into_soft, across);
}

double ShearBulk::hottest(std::size_t column) const {
  double hottest = 0.0;
  for (std::size_t at = column; at < soft_temperature_.size(); at += columns_)
    hottest = std::max(hottest, soft_temperature_[at]);
  return hottest;
}

double ShearBulk::energy(const ShearBody& body, std::size_t column) const {
  double kinetic = 0.0, elastic = 0.0;
  for (std::size_t j = 0; j < body.mesh.zones; ++j) {
    const double inner = body.velocity_at(j)[column];
    const double outer = body.velocity_at(j + 1)[column];
    kinetic += 0.25 * body.mesh.density * soft_.width[j] * (inner * inner + outer * outer);
    elastic += 0.5 * soft_.width[j] * body.stress_at(j)[column] * stress_old_[j * columns_ + column];
  }
  return kinetic + elastic / body.mesh.shear_modulus;
}

}  // namespace shearbus::hydro
