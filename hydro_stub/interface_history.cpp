#include "hydro_stub/interface_history.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <utility>

namespace shearbus::hydro {
namespace {

std::vector<wire::Quantity> interface_quantities() {
  using wire::Field;
  using wire::quantity_of_column;
  return {quantity_of_column(Field::kShearStress, 0, "shear stress at the interface, during the step"),
          quantity_of_column(Field::kSlidingVelocity, 0, "sliding velocity, mean of the step"),
          quantity_of_column(Field::kInterfaceTemperature, 0, "temperature of the interface"),
          quantity_of_column(Field::kVelocityJumpNew, 0, "V_soft - V_hard as the law expects it"),
          quantity_of_column(Field::kPressure, 0, "sent: pressure on the interface"),
          quantity_of_column(Field::kVelocityJump, 0, "sent: V_soft - V_hard at the start of the step"),
          quantity_of_column(Field::kStressSoft, 0, "sent: shear stress of the soft body's zones"),
          quantity_of_column(Field::kStressHard, 0, "sent: shear stress of the hard body's zones"),
          {.name = "zone_temperature", .units = "K", .long_name = "of the soft zones at the interface"},
          {.name = "slip_distance", .units = "m", .long_name = "integral of |sliding velocity| while closed"},
          {.name = "radius", .units = "m", .long_name = "first coordinate of the node"},
          {.name = "height", .units = "m", .long_name = "second coordinate of the node"},
          quantity_of_column(Field::kRegime)};
}

std::vector<wire::Quantity> surface_quantities() {
  return {{.name = "axial_velocity", .units = "m s-1", .long_name = "along the second axis"},
          {.name = "radius", .units = "m", .long_name = "first coordinate of the node"},
          {.name = "height", .units = "m", .long_name = "second coordinate of the node"}};
}

}  // namespace

InterfaceHistory::InterfaceHistory(std::size_t nodes) : rows_(interface_quantities(), nodes), slip_(nodes, 0.0) {}

void InterfaceHistory::observe(const lagrange::Cycle& cycle) {
  const InterfaceInputs& in = cycle.contact().inputs();
  const InterfaceAnswer& answer = cycle.contact().answer();
  for (std::size_t i = 0; i < slip_.size(); ++i) {
    const auto regime = static_cast<std::size_t>(answer.regime[i]);
    ++regimes_[std::min(regime, regimes_.size() - 1)];
    peaks_[kTemperature] = std::max(peaks_[kTemperature], answer.interface_temperature[i]);
    peaks_[kPressure] = std::max(peaks_[kPressure], in.pressure[i]);
    if (in.pressure[i] > 0.0) slip_[i] += std::abs(answer.sliding_velocity[i]) * in.dt;
  }
  energy_.add(answer.energy);
}

void InterfaceHistory::record(const lagrange::Cycle& cycle) {
  const InterfaceInputs& in = cycle.contact().inputs();
  const InterfaceAnswer& answer = cycle.contact().answer();
  std::vector<double> radius, height;
  for (std::size_t i = 0; i < slip_.size(); ++i) {
    const lagrange::Vec2 x = cycle.state().position[cycle.contact().weights().node(static_cast<int>(i))];
    radius.push_back(x.x);
    height.push_back(x.y);
  }
  rows_.begin_row(in.time);
  std::size_t q = 0;
  for (const std::vector<double>* values : std::initializer_list<const std::vector<double>*>{
           &answer.shear_stress, &answer.sliding_velocity, &answer.interface_temperature, &answer.velocity_jump_new,
           &in.pressure, &in.velocity_jump, &in.stress_soft, &in.stress_hard, &in.zone_temperature, &slip_, &radius,
           &height}) {
    rows_.set(q++, *values);
  }
  rows_.set(q, answer.regime);
}

void InterfaceHistory::save(wire::DumpWriter& dump) const {
  rows_.save(dump, "interface");
  dump.numbers("interface_slip", slip_);
  dump.numbers("interface_regimes", regimes_);
  dump.numbers("interface_peaks", peaks_);
  dump.numbers("interface_energy", energy_.numbers());
}

void InterfaceHistory::load(const wire::DumpReader& dump) {
  rows_.load(dump, "interface");
  dump.fill("interface_slip", slip_);
  dump.fill("interface_regimes", regimes_);
  dump.fill("interface_peaks", peaks_);
  dump.fill("interface_energy", energy_.numbers());
}

void InterfaceHistory::write(const std::filesystem::path& file, const std::map<std::string, std::string>& meta) const {
  rows_.write(file, meta);
}

double InterfaceHistory::share(wire::Regime regime) const {
  const double all = std::accumulate(regimes_.begin(), regimes_.end(), 0.0);
  return all > 0.0 ? regimes_[static_cast<std::size_t>(regime)] / all : 0.0;
}
double InterfaceHistory::longest_slip() const {
  return *std::ranges::max_element(slip_);
}
double InterfaceHistory::mean_slip() const {
  return std::accumulate(slip_.begin(), slip_.end(), 0.0) / static_cast<double>(slip_.size());
}

SurfaceHistory::SurfaceHistory(std::vector<int> nodes)
    : nodes_(std::move(nodes)), rows_(surface_quantities(), nodes_.size()) {}

void SurfaceHistory::record(const lagrange::Cycle& cycle) {
  std::vector<double> speed, radius, height;
  for (const int n : nodes_) {
    speed.push_back(cycle.state().velocity[n].y);
    radius.push_back(cycle.state().position[n].x);
    height.push_back(cycle.state().position[n].y);
  }
  rows_.begin_row(cycle.state().time);
  rows_.set(0, speed);
  rows_.set(1, radius);
  rows_.set(2, height);
}

}  // namespace shearbus::hydro
