#include "hydro_stub/interface_history.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <utility>

namespace shearbus::hydro {
namespace {

std::vector<files::Quantity> interface_quantities(bool bound) {
  using files::quantity_of_column;
  using wire::Field;
  std::vector<files::Quantity> all = {
      quantity_of_column(Field::kShearStress, 0, "shear stress at the interface, during the step"),
      quantity_of_column(Field::kSlidingVelocity, 0, "sliding velocity, mean of the step"),
      quantity_of_column(Field::kInterfaceTemperature, 0, "temperature of the interface"),
      quantity_of_column(Field::kVelocityJumpNew, 0, "V_soft - V_hard as the law expects it"),
      quantity_of_column(Field::kPressure, 0, "sent: pressure on the interface"),
      quantity_of_column(Field::kVelocityJump, 0, "sent: V_soft - V_hard at the start of the step"),
      quantity_of_column(Field::kStressSoft, 0, "sent: shear stress of the soft body's zones"),
      quantity_of_column(Field::kStressHard, 0, "sent: shear stress of the hard body's zones"),
      {.name = "zone_temperature", .units = "K", .long_name = "of the soft zones at the interface"},
      {.name = "slip_distance", .units = "m", .long_name = "integral of |sliding velocity| while closed"},
      {.name = "displacement_half_mm", .units = "m", .long_name = "of metal against metal over +-0.5 mm while closed"},
      {.name = "displacement_one_mm", .units = "m", .long_name = "of metal against metal over +-1 mm while closed"},
      {.name = "radius", .units = "m", .long_name = "first coordinate of the node"},
      {.name = "height", .units = "m", .long_name = "second coordinate of the node"},
      quantity_of_column(Field::kRegime)};
  if (bound)
    all.push_back({.name = "bound_used", .units = "1", .long_name = "friction work over its bound below melting"});
  return all;
}

std::vector<files::Quantity> surface_quantities() {
  return {{.name = "axial_velocity", .units = "m s-1", .long_name = "along the second axis"},
          {.name = "radius", .units = "m", .long_name = "first coordinate of the node"},
          {.name = "height", .units = "m", .long_name = "second coordinate of the node"}};
}

// The members of NodeTotals by their names in restart dumps.
constexpr std::pair<const char*, std::vector<double> NodeTotals::*> kTotals[] = {
    {"interface_slip", &NodeTotals::slip},
    {"interface_highest_pressure", &NodeTotals::highest_pressure},
    {"interface_fastest_slip", &NodeTotals::fastest_slip},
    {"interface_displacement_half_mm", &NodeTotals::displacement_half_mm},
    {"interface_displacement_one_mm", &NodeTotals::displacement_one_mm},
    {"interface_friction_impulse", &NodeTotals::friction_impulse},
    {"interface_critical_jump_share", &NodeTotals::critical_jump_share},
    {"interface_pressure_impulse", &NodeTotals::pressure_impulse},
    {"interface_slip_time", &NodeTotals::slip_time},
    {"interface_friction_work", &NodeTotals::friction_work},
    {"interface_friction_time", &NodeTotals::friction_time},
    {"interface_highest_melting", &NodeTotals::highest_melting},
    {"interface_bound_used", &NodeTotals::bound_used}};

}  // namespace

InterfaceHistory::InterfaceHistory(InterfaceLine line, InterfaceFacts facts)
    : line_(std::move(line)),
      rows_(interface_quantities(facts.bound.has_value()), line_.lengths().size()),
      facts_(std::move(facts)),
      totals_(line_.lengths().size()) {}

void InterfaceHistory::observe(const lagrange::Cycle& cycle) {
  const InterfaceInputs& in = cycle.contact().inputs();
  const InterfaceAnswer& answer = cycle.contact().answer();
  for (std::size_t i = 0; i < nodes(); ++i) {
    const std::size_t regime = std::min<std::size_t>(answer.regime[i], regimes_.size() - 1);
    const double speed = std::abs(answer.sliding_velocity[i]);
    ++regimes_[regime];
    peaks_[kTemperature] = std::max(peaks_[kTemperature], answer.interface_temperature[i]);
    peaks_[kPressure] = std::max(peaks_[kPressure], in.pressure[i]);
    if (in.pressure[i] > 0.0) {
      totals_.slip[i] += speed * in.dt;
      regime_slip_[regime] += line_.lengths()[i] * speed * in.dt;
      totals_.highest_pressure[i] = std::max(totals_.highest_pressure[i], in.pressure[i]);
      totals_.fastest_slip[i] = std::max(totals_.fastest_slip[i], speed);
      totals_.friction_impulse[i] += answer.shear_stress[i] * in.dt;
      if (facts_.bands) add_displacement(cycle, i);
      if (facts_.critical_jump) {
        const double share = std::abs(in.velocity_jump[i]) / facts_.critical_jump->at(in.pressure[i]);
        totals_.critical_jump_share[i] = std::max(totals_.critical_jump_share[i], share);
      }
    }
    if (in.pressure[i] > 0.0 && answer.regime[i] != static_cast<std::uint8_t>(wire::Regime::kStick)) {
      totals_.pressure_impulse[i] += in.pressure[i] * in.dt;
      totals_.slip_time[i] += in.dt;
    }
    if (facts_.bound) use_bound(i, answer.shear_stress[i] * answer.sliding_velocity[i] * in.dt, in);
  }
  energy_.add(answer.energy);
}

void InterfaceHistory::add_displacement(const lagrange::Cycle& cycle, std::size_t i) {
  const double dt = cycle.contact().inputs().dt;
  totals_.displacement_half_mm[i] += dt * facts_.bands->velocity_difference(cycle, 0, i);
  totals_.displacement_one_mm[i] += dt * facts_.bands->velocity_difference(cycle, 1, i);
}

void InterfaceHistory::use_bound(std::size_t i, double work, const InterfaceInputs& in) {
  totals_.friction_work[i] += work;
  if (!(totals_.friction_work[i] > 0.0)) return;
  totals_.friction_time[i] += in.dt;
  totals_.highest_melting[i] = std::max(totals_.highest_melting[i], facts_.bound->melting_temperature(in.pressure[i]));
  totals_.bound_used[i] =
      totals_.friction_work[i] / facts_.bound->work(totals_.highest_melting[i], totals_.friction_time[i]);
  peaks_[kBoundUsed] = std::max(peaks_[kBoundUsed], totals_.bound_used[i]);
}

void InterfaceHistory::record(const lagrange::Cycle& cycle) {
  const InterfaceInputs& in = cycle.contact().inputs();
  const InterfaceAnswer& answer = cycle.contact().answer();
  std::vector<double> radius, height;
  for (std::size_t i = 0; i < nodes(); ++i) {
    const lagrange::Vec2 x = cycle.state().position[cycle.contact().weights().node(static_cast<int>(i))];
    radius.push_back(x.x);
    height.push_back(x.y);
  }
  rows_.begin_row(in.time);
  std::size_t q = 0;
  for (const std::vector<double>* values : std::initializer_list<const std::vector<double>*>{
           &answer.shear_stress, &answer.sliding_velocity, &answer.interface_temperature, &answer.velocity_jump_new,
           &in.pressure, &in.velocity_jump, &in.stress_soft, &in.stress_hard, &in.zone_temperature, &totals_.slip,
           &totals_.displacement_half_mm, &totals_.displacement_one_mm, &radius, &height}) {
    rows_.set(q++, *values);
  }
  rows_.set(q++, answer.regime);
  if (facts_.bound) rows_.set(q, totals_.bound_used);
}

void InterfaceHistory::save(files::DumpWriter& dump) const {
  rows_.save(dump, "interface");
  for (const auto& [name, values] : kTotals) dump.numbers(name, totals_.*values);
  dump.numbers("interface_regimes", regimes_);
  dump.numbers("interface_regime_slip", regime_slip_);
  dump.numbers("interface_peaks", peaks_);
  dump.numbers("interface_energy", energy_.numbers());
}

void InterfaceHistory::load(const files::DumpReader& dump) {
  rows_.load(dump, "interface");
  for (const auto& [name, values] : kTotals) dump.fill(name, totals_.*values);
  dump.fill("interface_regimes", regimes_);
  dump.fill("interface_regime_slip", regime_slip_);
  dump.fill("interface_peaks", peaks_);
  dump.fill("interface_energy", energy_.numbers());
}

void InterfaceHistory::write(const std::filesystem::path& file, const std::map<std::string, std::string>& meta,
                             const files::ProfileRecord& profiles, const std::vector<double>& start_temperature) const {
  rows_.write(file, meta, &profiles, start_temperature);
}

double InterfaceHistory::share(wire::Regime regime) const {
  const double all = std::accumulate(regimes_.begin(), regimes_.end(), 0.0);
  return all > 0.0 ? regimes_[static_cast<std::size_t>(regime)] / all : 0.0;
}
double InterfaceHistory::share_of_slip(wire::Regime regime) const {
  const double all = std::accumulate(regime_slip_.begin(), regime_slip_.end(), 0.0);
  return all > 0.0 ? regime_slip_[static_cast<std::size_t>(regime)] / all : 0.0;
}
double InterfaceHistory::longest_slip() const {
  return *std::ranges::max_element(totals_.slip);
}
std::size_t InterfaceHistory::nodes_above_critical_jump() const {
  return static_cast<std::size_t>(
      std::ranges::count_if(totals_.critical_jump_share, [](double share) { return share > 1.0; }));
}
std::optional<double> InterfaceHistory::mean_displacement(std::size_t band) const {
  if (!facts_.bands) return std::nullopt;
  return line_.mean(displacement(totals_, band), [&](std::size_t i) { return facts_.bands->reaches(band, i); });
}
double InterfaceHistory::mean_pressure_root_time() const {
  std::vector<double> loads;
  for (std::size_t i = 0; i < nodes(); ++i) {
    const double time = totals_.slip_time[i];
    loads.push_back(time > 0.0 ? totals_.pressure_impulse[i] / std::sqrt(time) : 0.0);
  }
  return mean(loads);
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
