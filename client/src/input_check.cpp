#include "client/src/input_check.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

namespace shearbus {
namespace {

constexpr double kLongStep = 1e-6;         // a longer first step draws a warning  [s]
constexpr double kLonger = 1e3;            // a step longer by this factor than all before it draws a warning
constexpr double kLargeChange = 1e3;       // a larger change of the jump in the first step draws a warning  [m/s]
constexpr double kLeastImpedance = 1e3;    // bodies of less draw a warning: metals have 1e7 and more  [Pa s/m]
constexpr double kSliding = 1.0;           // from this jump on a contact slides  [m/s]
constexpr double kLowestSliding = 1e6;     // a contact that slides under less pressure draws a warning  [Pa]
constexpr double kLowest = 1e3;            // a contact under less pressure draws a warning  [Pa]
constexpr double kNoise = 1e-3;            // up to this a pressure may be a rounding error  [Pa]
constexpr double kNegative = -1.0;         // a pressure of at most this was meant to be negative  [Pa]
constexpr double kGrowth = 1.1;            // a pressure that grows by this factor has not settled
constexpr std::uint64_t kSettled = 10;     // a loading that grows for longer than this is a pressure of its own
constexpr std::uint64_t kNoContact = 100;  // steps with negative pressures, and none in contact, until a warning
constexpr std::uint64_t kEveryStep = 100;  // first steps, each of which is looked at
constexpr std::uint64_t kLookEvery = 16;   // later steps of which one is looked at

// What a number would be in the units that hosts use for pressures, where that is a pressure of a shock.
std::string in_other_units(double value) {
  constexpr struct {
    const char* name;
    double pascal;
  } kUnits[] = {{"bar", 1e5}, {"MPa", 1e6}, {"kbar", 1e8}, {"GPa", 1e9}, {"Mbar", 1e11}};
  std::vector<std::string> all;
  for (const auto& [name, pascal] : kUnits)
    if (value * pascal >= 1e8 && value * pascal <= 1e12)
      all.push_back(fmt::format("as {} it would be {:.4g} GPa", name, value * pascal * 1e-9));
  return all.empty() ? std::string() : fmt::format(" ({})", fmt::join(all, ", "));
}

std::string length_warning(double dt_s) {
  if (dt_s <= kLongStep) return {};
  return fmt::format(
      "dt_s: the first step is {:.6g} s long; a step of a shock is rarely longer than {} s. Is dt_s in seconds?", dt_s,
      kLongStep);
}

// The first node whose jump the host's own forces change by too much.
std::string forces_warning(const Batch& request, double dt_s, std::span<const std::uint64_t> node_ids) {
  const bool sticks = request.has(Field::kImpedance);
  const auto jump = request.f64(Field::kVelocityJump), impedance = request.f64(Field::kImpedance),
             stick = request.f64(Field::kStickStress), soft = request.f64(Field::kStressSoft),
             hard = request.f64(Field::kStressHard), mass_soft = request.f64(Field::kMassSoft),
             mass_hard = request.f64(Field::kMassHard);
  if (!sticks && mass_soft.empty()) return {};  // velocity-driven: the host sends no forces
  for (std::size_t row = 0; row < jump.size(); ++row) {
    const double change = sticks ? stick[row] / impedance[row] - jump[row]
                                 : dt_s * (soft[row] / mass_soft[row] + hard[row] / mass_hard[row]);
    if (std::abs(change) <= kLargeChange) continue;
    return fmt::format(
        "{}: without friction the jump of node {} changes from {:.6g} to {:.6g} m/s in the first step. Are stresses in "
        "pascal "
        "and {}?",
        wire::name(sticks ? Field::kStickStress : Field::kMassSoft),
        (request.has(Field::kNodeId) ? request.u64(Field::kNodeId) : node_ids)[row], jump[row], jump[row] + change,
        sticks ? "the impedance in Pa s/m" : "masses per area in kg/m2");
  }
  return {};
}

// Masses or impedances of nodes in place of those per area: a zone of metal has at least density times speed of sound.
std::string impedance_warning(const Batch& request, double dt_s) {
  const bool sticks = request.has(Field::kImpedance);
  const auto impedance = request.f64(Field::kImpedance), mass_soft = request.f64(Field::kMassSoft),
             mass_hard = request.f64(Field::kMassHard);
  double largest = 0.0;
  for (const double value : impedance) largest = std::max(largest, value);
  for (std::size_t row = 0; row < mass_soft.size(); ++row)
    largest = std::max(largest, 1.0 / (dt_s * (1.0 / mass_soft[row] + 1.0 / mass_hard[row])));
  if (!(largest > 0.0) || largest >= kLeastImpedance) return {};
  return fmt::format(
      "{}: {} of at most {:.3g} Pa s/m; a zone of metal has 1e7 and more (density times speed of sound). {}",
      wire::name(sticks ? Field::kImpedance : Field::kMassSoft),
      sticks ? "the first step has impedances" : "masses and dt_s of the first step make an impedance", largest,
      sticks ? "Are impedance and stick stress per area, in Pa s/m and Pa?"
             : "Are masses per area, in kg/m2, and dt_s in seconds?");
}

void add_text(std::vector<std::string>& all, std::string text) {
  if (!text.empty()) all.push_back(std::move(text));
}

}  // namespace

std::string InputCheck::pressure_warning() const {
  const double lowest = fastest_ > kSliding ? kLowestSliding : kLowest;
  if (in_contact_ == 0 || highest_ > lowest) return {};
  return fmt::format(
      "{}: the highest pressure of the first {} steps in contact is {:.6g} Pa, while the jump is up to {:.4g} m/s; "
      "expected more than {:g} Pa. Is the pressure in pascal{}?",
      wire::name(Field::kPressure), in_contact_, highest_, fastest_, lowest, in_other_units(highest_));
}

std::string InputCheck::longer_warning(double dt_s) {
  const double before = std::exchange(longest_, std::max(longest_, dt_s));
  if (before == 0.0 || dt_s <= kLonger * before || longer_told_) return {};
  longer_told_ = true;
  return fmt::format(
      "dt_s: a step of {:.6g} s, after steps of at most {:.6g} s. Is dt_s in seconds, and this step meant?", dt_s,
      before);
}

std::string InputCheck::contact_warning() const {
  if (in_contact_ > 0 || lowest_ > kNegative) return {};
  return fmt::format(
      "{}: no node was ever in contact in {} steps; lowest pressure {:.6g} Pa, highest pressure {:.6g} Pa: compression "
      "is positive",
      wire::name(Field::kPressure), steps_, lowest_, highest_);
}

std::vector<std::string> InputCheck::add(const Batch& request, double dt_s, std::span<const std::uint64_t> node_ids) {
  std::vector<std::string> warnings;
  if (first_) {
    first_ = false;
    add_text(warnings, length_warning(dt_s));
    add_text(warnings, forces_warning(request, dt_s, node_ids));
    if (warnings.empty()) add_text(warnings, impedance_warning(request, dt_s));
    doubts_units_ = !warnings.empty();
  }
  add_text(warnings, longer_warning(dt_s));
  const auto pressure = request.f64(Field::kPressure);
  if (judged_ || pressure.empty()) return warnings;
  // Bodies that do not meet for long are looked at now and then, so that this costs their steps nothing.
  if (steps_ > kEveryStep && negative_ == 0 && steps_ % kLookEvery != 0) {
    ++steps_;
    return warnings;
  }
  const auto [low, high] = std::ranges::minmax(pressure);
  lowest_ = steps_ == 0 ? low : std::min(lowest_, low);
  highest_ = steps_ == 0 ? high : std::max(highest_, high);
  ++steps_;
  negative_ += low <= kNegative ? 1 : 0;
  if (highest_ > kLowestSliding) {
    judged_ = true;
    return warnings;
  }
  if (high > kNoise) {
    ++in_contact_;
    const auto jump = request.f64(Field::kVelocityJump), second = request.f64(Field::kVelocityJump, 1);
    for (std::size_t row = 0; row < pressure.size(); ++row)
      if (pressure[row] > kNoise)
        fastest_ = std::max({fastest_, std::abs(jump[row]), second.empty() ? 0.0 : std::abs(second[row])});
    const bool grows = highest_ > kGrowth * settled_at_;
    settled_ = grows ? 0 : settled_ + 1;
    if (grows) settled_at_ = highest_;
  }
  std::string found = settled_ >= kSettled ? pressure_warning() : negative_ == kNoContact ? contact_warning() : "";
  judged_ = !found.empty();
  add_text(warnings, std::move(found));
  return warnings;
}

std::vector<std::string> InputCheck::end() {
  std::vector<std::string> warnings;
  if (judged_) return warnings;
  judged_ = true;
  add_text(warnings, pressure_warning());
  add_text(warnings, contact_warning());
  return warnings;
}

}  // namespace shearbus
