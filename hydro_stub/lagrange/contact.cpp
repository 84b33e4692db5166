#include "hydro_stub/lagrange/contact.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <utility>

namespace shearbus::lagrange {
namespace {

// Smallest share of a node's area that the other body must cover for the law to be asked: a stress over a smaller area
// is not meaningful.
constexpr double kLeastCovered = 0.05;
// A node under a smaller pressure counts as open: pressures below 1e4 Pa come from rounding or from the foot of a
// smeared shock.
constexpr double kLeastPressure = 1e4;  // smallest pressure of a closed node  [Pa]
// Bounds on the change of a gap in one step, so that curved surfaces which slide along each other stay together
// (Baumgarte, Comput. Methods Appl. Mech. Eng. 1 (1972) 1).
constexpr double kPushOut = 0.2;   // where the bodies overlap: share of the overlap that one step removes
constexpr double kApproach = 0.5;  // where the bodies are apart: largest share of the gap that one step may close

// Returns the share of a zone's plastic strain rate that is shear along a surface with tangent t. By the flow rule it
// is sqrt(3) s_tn / sigma_eq, with the component s_tn of the stress deviator; the normal n is t turned by 90 degrees.
// It is positive if the zone pulls the surface along t.
double shear_share(const State& state, int zone, Vec2 t) {
  const double xx = state.deviator_xx[zone], yy = state.deviator_yy[zone], xy = state.deviator_xy[zone];
  const double tn = t.x * t.y * (yy - xx) + (t.x * t.x - t.y * t.y) * xy;              // shear component s_tn
  const double squares = 0.5 * (xx * xx + yy * yy + (xx + yy) * (xx + yy)) + xy * xy;  // invariant J2
  return squares > 0.0 ? tn / std::sqrt(squares) : 0.0;
}

}  // namespace

Contact::Contact(Symmetry symmetry, std::vector<SlideLine> lines, const ContactOptions& options, int num_nodes)
    : weights_(symmetry, std::move(lines)),
      options_(options),
      inputs_(weights_.rubbing()),
      answer_(weights_.rubbing()),
      pressing_(weights_.size(), 0.0),
      impulse_(num_nodes),
      before_(weights_.size(), 0.0),
      excess_rate_(weights_.size(), 0.0),
      compliance_(weights_.size()),
      pushed_(num_nodes),
      hard_area_(num_nodes),
      mean_pressure_(weights_.rubbing()),
      friction_time_(weights_.rubbing(), 0.0) {
  inputs_.zone_plastic_strain.assign(weights_.rubbing(), 0.0);
  inputs_.soft_plastic_strain_rate.assign(weights_.rubbing(), 0.0);
}

void Contact::prepare(const State& state, const std::vector<Vec2>& middle_position, const Guides& guides) {
  weights_.find(middle_position);
  find_compliance(guides, state);
}

void Contact::ask(const State& state, const Guides& guides, double dt, std::uint64_t step, hydro::InterfaceLaw* law,
                  std::vector<Vec2>& velocity_new) {
  std::ranges::fill(impulse_, Vec2{});
  std::ranges::fill(pressing_, 0.0);
  press(guides, state, dt, velocity_new);
  ask_law(state, dt, step, law, velocity_new);
}

void Contact::answered(const State& state, const Guides& guides, double dt, hydro::InterfaceLaw* law,
                       std::vector<Vec2>& velocity_new) {
  if (law != nullptr && size() > 0 && options_.overlap) law->finish();
  for (int i = 0; i < size(); ++i) {
    if (std::isfinite(answer_.shear_stress[i])) continue;
    throw std::runtime_error(fmt::format("the interface law answered shear stress {} Pa for node {} in step {}",
                                         answer_.shear_stress[i], i, inputs_.step));
  }
  rub(guides, state, dt, velocity_new);
  press(guides, state, dt, velocity_new);
}

double Contact::opening_rate(int i, const std::vector<Vec2>& velocity) const {
  double rate = 0.0;
  for (const PushWeight& w : weights_.push(i)) rate += dot(w.weight, velocity[w.node]);
  return rate;
}

double Contact::jump(int i, const std::vector<Vec2>& velocity) const {
  Vec2 hard;
  for (const RubWeight& w : weights_.rub(i)) hard += w.weight * velocity[w.node];
  return dot(velocity[weights_.node(i)] - (1.0 / weights_.area(i)) * hard, weights_.tangent(i));
}

void Contact::give(int node, Vec2 impulse, const Guides& guides, const State& state, std::vector<Vec2>& velocity) {
  impulse_[node] += impulse;
  velocity[node] += (1.0 / state.node_mass[node]) * guides.free_part(node, impulse);
}

// Finds the matrix of the complementarity problem, whose rows resemble those of a one-dimensional mass matrix:
// compliance_[i] has the rate at which the gap of node i opens per pressure impulse of each node j.
void Contact::find_compliance(const Guides& guides, const State& state) {
  for (int i = 0; i < weights_.size(); ++i) {
    for (const PushWeight& w : weights_.push(i)) {
      pushed_[w.node].push_back({i, (1.0 / state.node_mass[w.node]) * guides.free_part(w.node, w.weight)});
    }
  }
  for (int i = 0; i < weights_.size(); ++i) {
    compliance_[i].assign(1, {.row = i, .weight = 0.0});
    for (const PushWeight& w : weights_.push(i)) {
      for (const Response& r : pushed_[w.node])
        add(compliance_[i], &RowWeight::row, &RowWeight::weight, r.row, dot(w.weight, r.velocity));
    }
  }
  for (int i = 0; i < weights_.size(); ++i) {
    for (const PushWeight& w : weights_.push(i)) pushed_[w.node].clear();
  }
  pressures_.set_matrix(compliance_);
}

// Finds the normal pressures; the velocities get the impulses of their change.
void Contact::press(const Guides& guides, const State& state, double dt, std::vector<Vec2>& velocity) {
  const int size = weights_.size();
  if (size == 0) return;
  before_ = pressing_;
  for (int i = 0; i < size; ++i) {  // excess_rate_: the opening rate of a gap less the least rate that is allowed
    const double gap = weights_.gap(i);
    const double least = -(gap > 0.0 ? kApproach : kPushOut) * gap / dt * weights_.area(i);
    excess_rate_[i] = opening_rate(i, velocity) - least;
  }
  pressures_.solve(pressing_, excess_rate_);
  for (int i = 0; i < size; ++i) {
    const double change = pressing_[i] - before_[i];
    if (change == 0.0) continue;
    for (const PushWeight& w : weights_.push(i)) give(w.node, change * w.weight, guides, state, velocity);
  }
}

// The inverse mass 1/m_hard at a node is computed as if all interface nodes had the same shear stress: the compliances
// that all of them give the hard nodes add up. The true coupling of neighbouring nodes is never stronger, so sticking
// converges without oscillation.
void Contact::ask_law(const State& state, double dt, std::uint64_t step, hydro::InterfaceLaw* law,
                      const std::vector<Vec2>& velocity) {
  const int size = weights_.rubbing();
  std::ranges::fill(hard_area_, 0.0);
  for (int i = 0; i < size; ++i) {
    for (const RubWeight& w : weights_.rub(i)) hard_area_[w.node] += w.weight;
  }
  inputs_.step = step;
  inputs_.time = state.time + dt;
  inputs_.dt = dt;
  inputs_.zone_temperature.assign(size, 0.0);
  find_plastic_rates(state);
  find_mean_pressures(dt);
  for (int i = 0; i < size; ++i) {
    inputs_.velocity_jump[i] = inputs_.pressure[i] = inputs_.stress_soft[i] = inputs_.stress_hard[i] = 0.0;
    // Nodes that the hard surface hardly covers keep unit masses. Such nodes have pressure 0, where nothing depends on
    // the masses.
    inputs_.mass_soft[i] = inputs_.mass_hard[i] = 1.0;
    for (const int zone : weights_.zones_at(i)) {
      inputs_.zone_temperature[i] += 0.5 * wall_temperature(state, zone, i);
    }
    if (!weights_.faces(i) || weights_.covered(i) < kLeastCovered) continue;
    const int node = weights_.node(i);
    const double area = weights_.area(i);
    const double old_jump = jump(i, state.velocity);
    const Vec2 t = weights_.tangent(i);
    double hard_compliance = 0.0;  // 1/m_hard, with the mass per area m_hard of the hard side  [m2/kg]
    double hard_change = 0.0;
    for (const RubWeight& w : weights_.rub(i)) {
      hard_compliance += w.weight * hard_area_[w.node] / (state.node_mass[w.node] * area);
      hard_change += w.weight * dot(velocity[w.node] - state.velocity[w.node], t) / area;
    }
    inputs_.velocity_jump[i] = old_jump;
    if (mean_pressure_[i] >= kLeastPressure) inputs_.pressure[i] = pressure_at(i);
    inputs_.mass_soft[i] = state.node_mass[node] / area;
    inputs_.mass_hard[i] = 1.0 / hard_compliance;
    inputs_.stress_soft[i] = dot(velocity[node] - state.velocity[node], t) * inputs_.mass_soft[i] / dt;
    inputs_.stress_hard[i] = -hard_change * inputs_.mass_hard[i] / dt;
  }
  std::ranges::fill(answer_.shear_stress, 0.0);
  if (law == nullptr || size == 0) return;
  if (options_.overlap) {
    law->start(inputs_, answer_);
  } else {
    law->advance(inputs_, answer_);
  }
}

// The means over the nodes' areas smooth the scatter that the nodal pressures p_i have where the zones of the two bodies
// differ in width.
void Contact::find_mean_pressures(double dt) {
  for (int i = 0; i < weights_.rubbing(); ++i) {
    mean_pressure_[i] = 0.0;
    if (!weights_.faces(i)) continue;
    for (const RowWeight& w : weights_.overlap(i)) mean_pressure_[i] += w.weight * pressing_[w.row];
    mean_pressure_[i] /= weights_.area(i) * dt;
  }
}

// Returns the pressure of friction at an interface node: the value at the node that belongs to the means, to second order
// in the width of the zones, without new extremes. The means themselves widen the front of a shock that runs along the
// interface, and friction, which is concave in the pressure, is too strong in a wide front.
double Contact::pressure_at(int i) const {
  const double own = mean_pressure_[i];
  double mean_of_means = 0.0, lowest = own, highest = own;
  for (const RowWeight& w : weights_.overlap(i)) {
    mean_of_means += w.weight * mean_pressure_[w.row];
    lowest = std::min(lowest, mean_pressure_[w.row]);
    highest = std::max(highest, mean_pressure_[w.row]);
  }
  mean_of_means /= weights_.area(i);
  return std::clamp(2.0 * own - mean_of_means, lowest, highest);
}

double Contact::wall_temperature(const State& state, int zone, int i) const {
  if (!options_.heat_depth) return state.temperature[zone];
  return options_.heat_depth->mean(zone, friction_time_[i], state.temperature);
}

// Sets for each interface node the mean plastic strain of the two soft zones there, and the rate at which shear along
// the interface has increased it over the last accepted step.
void Contact::find_plastic_rates(const State& state) {
  const double dt = state.time - plastic_time_;
  plastic_time_ = state.time;
  for (int i = 0; i < weights_.rubbing(); ++i) {
    double strain = 0.0, share = 0.0;
    for (const int zone : weights_.zones_at(i)) {
      strain += 0.5 * state.plastic_strain[zone];
      share += 0.5 * shear_share(state, zone, weights_.tangent(i));
    }
    const double grown = std::max(0.0, strain - inputs_.zone_plastic_strain[i]);
    if (dt > 0.0) inputs_.soft_plastic_strain_rate[i] = share * grown / dt;
    inputs_.zone_plastic_strain[i] = strain;
  }
}

void Contact::rub(const Guides& guides, const State& state, double dt, std::vector<Vec2>& velocity) {
  for (int i = 0; i < weights_.rubbing(); ++i) {
    if (!weights_.faces(i) || answer_.shear_stress[i] == 0.0) continue;
    const Vec2 pull = (answer_.shear_stress[i] * dt) * weights_.tangent(i);
    for (const RubWeight& w : weights_.rub(i)) {
      give(w.node, w.weight * pull, guides, state, velocity);
      give(weights_.node(i), -w.weight * pull, guides, state, velocity);
    }
  }
}

void Contact::deposit_heat(const std::vector<Vec2>& velocity_mean, double dt, const std::vector<double>& mass,
                           std::vector<double>& energy) {
  for (int i = 0; i < weights_.size(); ++i) {
    if (!weights_.faces(i)) continue;
    const double closing = -pressing_[i] * opening_rate(i, velocity_mean);
    const double friction =
        i < weights_.rubbing() ? answer_.shear_stress[i] * weights_.area(i) * jump(i, velocity_mean) * dt : 0.0;
    heat_[kClosing] += closing;
    heat_[kFriction] += friction;
    // Where the layer flows less than the soft zone that it is half of (DLP 64), the nodes move against the stress. The
    // zone has counted the work of this flow as its own, and returns it.
    const double soft_share = friction < 0.0 ? 1.0 : options_.soft_share;
    double soft = 0.5 * closing, hard = soft;
    if (options_.heat_depth && i < weights_.rubbing()) {
      if (friction != 0.0 || friction_time_[i] > 0.0) friction_time_[i] += dt;
      const auto spread = [&](const ZoneShare& z, double heat) {
        options_.heat_depth->give(z.zone, z.share * heat, friction_time_[i], mass, energy);
      };
      for (const ZoneShare& z : weights_.soft_zones(i)) spread(z, soft_share * friction);
      for (const ZoneShare& z : weights_.hard_zones(i)) spread(z, (1.0 - soft_share) * friction);
    } else {
      soft += soft_share * friction;
      hard += (1.0 - soft_share) * friction;
    }
    for (const ZoneShare& z : weights_.soft_zones(i)) energy[z.zone] += z.share * soft / mass[z.zone];
    for (const ZoneShare& z : weights_.hard_zones(i)) energy[z.zone] += z.share * hard / mass[z.zone];
  }
}

}  // namespace shearbus::lagrange
