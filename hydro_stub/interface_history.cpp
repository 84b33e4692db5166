#include "hydro_stub/interface_history.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <utility>

namespace shearbus::hydro {
namespace {

using wire::Field;

constexpr LawColumn kColumns[] = {
    {Field::kShearStress, "shear stress at the interface, during the step", {}, &InterfaceAnswer::shear_stress},
    {Field::kSlidingVelocity, "sliding velocity, mean of the step", {}, &InterfaceAnswer::sliding_velocity},
    {Field::kInterfaceTemperature, "temperature of the interface", {}, &InterfaceAnswer::interface_temperature},
    {Field::kVelocityJumpNew, "V_soft - V_hard as the law expects it", {}, &InterfaceAnswer::velocity_jump_new},
    {Field::kPressure, "sent: pressure on the interface", &InterfaceInputs::pressure},
    {Field::kVelocityJump, "sent: V_soft - V_hard at the start of the step", &InterfaceInputs::velocity_jump},
    {Field::kStressSoft, "sent: shear stress of the soft body's zones", &InterfaceInputs::stress_soft},
    {Field::kStressHard, "sent: shear stress of the hard body's zones", &InterfaceInputs::stress_hard},
    {Field::kRegime, ""}};

// The quantities behind kColumns, in the order in which record() sets them.
std::vector<files::Quantity> interface_quantities(bool bound) {
  std::vector<files::Quantity> all;
  for (const LawColumn& column : kColumns) all.push_back(column.quantity());
  all.insert(
      all.end(),
      {{.name = "zone_temperature", .units = "K", .long_name = "of the soft zones at the interface"},
       {.name = "slip_distance", .units = "m", .long_name = "integral of |sliding velocity| while closed"},
       {.name = "displacement_half_mm", .units = "m", .long_name = "of metal against metal over +-0.5 mm while closed"},
       {.name = "displacement_one_mm", .units = "m", .long_name = "of metal against metal over +-1 mm while closed"},
       {.name = "radius", .units = "m", .long_name = "first coordinate of the node"},
       {.name = "height", .units = "m", .long_name = "second coordinate of the node"}});
  if (bound)
    all.push_back({.name = "bound_used", .units = "1", .long_name = "friction work over its bound below melting"});
  return all;
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

NodeTotals::NodeTotals(std::size_t nodes) {
  for (const auto& [name, values] : kTotals) (this->*values).assign(nodes, 0.0);
}

InterfaceHistory::InterfaceHistory(const Problem2d& problem)
    : line_(problem.bodies),
      bound_(problem.heat_bound),
      rows_("interface", interface_quantities(has_bound()), line_.lengths().size()),
      totals_(line_.lengths().size()) {
  if (nodes() == 0) return;
  bands_.emplace(problem.bodies);
  if (problem.strength) critical_jump_.emplace(problem.soft, problem.hard, problem.strength->start_temperature);
}

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
      if (bands_) add_displacement(cycle, i);
      if (critical_jump_) {
        const double share = std::abs(in.velocity_jump[i]) / critical_jump_->at(in.pressure[i]);
        totals_.critical_jump_share[i] = std::max(totals_.critical_jump_share[i], share);
      }
    }
    if (in.pressure[i] > 0.0 && answer.regime[i] != static_cast<std::uint8_t>(wire::Regime::kStick)) {
      totals_.pressure_impulse[i] += in.pressure[i] * in.dt;
      totals_.slip_time[i] += in.dt;
    }
    if (bound_) use_bound(i, answer.shear_stress[i] * answer.sliding_velocity[i] * in.dt, in);
  }
  energy_.add(answer.energy);
}

void InterfaceHistory::add_displacement(const lagrange::Cycle& cycle, std::size_t i) {
  const double dt = cycle.contact().inputs().dt;
  totals_.displacement_half_mm[i] += dt * bands_->velocity_difference(cycle, 0, i);
  totals_.displacement_one_mm[i] += dt * bands_->velocity_difference(cycle, 1, i);
}

void InterfaceHistory::use_bound(std::size_t i, double work, const InterfaceInputs& in) {
  totals_.friction_work[i] += work;
  if (!(totals_.friction_work[i] > 0.0)) return;
  totals_.friction_time[i] += in.dt;
  totals_.highest_melting[i] = std::max(totals_.highest_melting[i], bound_->melting_temperature(in.pressure[i]));
  totals_.bound_used[i] = totals_.friction_work[i] / bound_->work(totals_.highest_melting[i], totals_.friction_time[i]);
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
  for (const LawColumn& column : kColumns)
    column.record(in, answer, [&](const auto& values) { rows_.set(q++, values); });
  for (const std::vector<double>* values : std::initializer_list<const std::vector<double>*>{
           &in.zone_temperature, &totals_.slip, &totals_.displacement_half_mm, &totals_.displacement_one_mm, &radius,
           &height})
    rows_.set(q++, *values);
  if (bound_) rows_.set(q, totals_.bound_used);
}

void InterfaceHistory::save(files::DumpWriter& dump) const {
  rows_.save(dump);
  for (const auto& [name, values] : kTotals) dump.numbers(name, totals_.*values);
  dump.numbers("interface_regimes", regimes_);
  dump.numbers("interface_regime_slip", regime_slip_);
  dump.numbers("interface_peaks", peaks_);
  dump.numbers("interface_energy", energy_.numbers());
}

void InterfaceHistory::load(const files::DumpReader& dump) {
  rows_.load(dump);
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
  if (!bands_) return std::nullopt;
  return line_.mean(displacement(totals_, band), [&](std::size_t i) { return bands_->reaches(band, i); });
}
double InterfaceHistory::mean_pressure_root_time() const {
  std::vector<double> loads;
  for (std::size_t i = 0; i < nodes(); ++i) {
    const double time = totals_.slip_time[i];
    loads.push_back(time > 0.0 ? totals_.pressure_impulse[i] / std::sqrt(time) : 0.0);
  }
  return mean(loads);
}

}  // namespace shearbus::hydro
