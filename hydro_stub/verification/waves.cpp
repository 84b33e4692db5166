// Plane waves in metals: a piston, and impacts of flyers.
#include <algorithm>
#include <cmath>
#include <utility>

#include "hydro_stub/verification/exact.hpp"
#include "hydro_stub/verification/problems.hpp"
#include "server/physics/material/strength.hpp"

namespace shearbus::hydro {

using lagrange::Block;
using lagrange::Bodies;
using lagrange::Cycle;
using lagrange::Mesh;
using lagrange::Side;
using lagrange::Vec2;

Block Strip::add(Mesh& mesh, int zones, double from, double to) const {
  const double step = (to - from) / zones;
  if (axial()) {
    return mesh.add_block(kRows, zones, [=](int i, int j) { return Vec2{step * i, from + step * j}; });
  }
  return mesh.add_block(zones, kRows, [=](int i, int j) { return Vec2{from + step * i, step * j}; });
}

lagrange::Surface Strip::face(const Block& block, bool far_end) const {
  const Side start = axial() ? Side::kBottom : Side::kLeft, end = axial() ? Side::kTop : Side::kRight;
  return lagrange::surface(block, far_end ? end : start);
}

void Strip::guide(Bodies& bodies, const Block& block) const {
  const Vec2 across = axial() ? Vec2{1.0, 0.0} : Vec2{0.0, 1.0};
  bodies.walls.push_back({block.side(axial() ? Side::kLeft : Side::kBottom), across, 0.0});
  bodies.walls.push_back({block.side(axial() ? Side::kRight : Side::kTop), across, 0.0});
}

double Strip::stress(const Cycle& cycle, int zone) const {
  return cycle.state().pressure[zone] - (axial() ? cycle.state().deviator_yy[zone] : cycle.state().deviator_xx[zone]);
}

namespace {

// A zone of the strip's first block, and the coordinates of its two ends along the strip.
struct Part {
  int zone;
  double low, high;
};

std::vector<Part> parts_of(const Strip& strip, const Cycle& cycle) {
  const Block& block = cycle.mesh().blocks()[0];
  std::vector<Part> parts;
  for (int i = 0; i < (strip.axial() ? block.ny : block.nx); ++i) {
    const int zone = strip.axial() ? block.zone(0, i) : block.zone(i, 0);
    const int* n = cycle.mesh().zone_nodes(zone);
    parts.push_back(
        {zone, strip.component(cycle.state().position[n[0]]), strip.component(cycle.state().position[n[2]])});
  }
  return parts;
}

}  // namespace

double Strip::mean_stress(const Cycle& cycle, double from, double to) const {
  double sum = 0.0;
  int count = 0;
  for (const Part& part : parts_of(*this, cycle)) {
    const double middle = 0.5 * (part.low + part.high);
    if (middle < from || middle > to) continue;
    sum += stress(cycle, part.zone);
    ++count;
  }
  return sum / count;
}

Bodies make_bodies(const PistonProblem& p) {
  const Strip strip{p.symmetry};
  Mesh mesh(p.symmetry);
  const Block block = strip.add(mesh, p.zones, 0.0, p.length);
  Bodies bodies(std::move(mesh));
  bodies.materials.push_back(body_material(p.metal));
  fill(bodies, block, p.metal.eos.density, 0.0, {});
  bodies.walls.push_back({strip.face(block, false).nodes, strip.along(1.0), p.speed});
  strip.guide(bodies, block);
  return bodies;
}

std::vector<Comparison> compare(const PistonProblem& p, const Cycle& cycle) {
  const Strip strip{p.symmetry};
  const TwoWaves exact = two_waves(p.metal, p.speed);
  const double plastic_front = exact.plastic_speed * cycle.state().time;
  const double elastic_front = exact.elastic_speed * cycle.state().time;
  double error = 0.0;
  for (const Part& part : parts_of(strip, cycle)) {
    const double x = 0.5 * (part.low + part.high);
    const double right = x < plastic_front ? exact.stress : x < elastic_front ? exact.elastic_stress : 0.0;
    error += (part.high - part.low) * std::abs(strip.stress(cycle, part.zone) - right);
  }
  const double gap = elastic_front - plastic_front;
  return {{"stress behind both waves", "Pa", exact.stress,
           strip.mean_stress(cycle, 0.3 * plastic_front, 0.8 * plastic_front)},
          {"elastic limit", "Pa", exact.elastic_stress,
           strip.mean_stress(cycle, plastic_front + 0.3 * gap, plastic_front + 0.7 * gap)},
          {"mean error of the stress", "1", 0.0, error / (exact.stress * elastic_front)}};
}

Bodies make_bodies(const FlyerProblem& p) {
  const Strip strip{p.symmetry};
  Mesh mesh(p.symmetry);
  const Block target = strip.add(mesh, p.zones, 0.0, p.length);
  const double flyer_length = p.flyer_length > 0.0 ? p.flyer_length : p.length;
  const int flyer_zones = std::max(2, static_cast<int>(std::lround(p.zones * flyer_length / p.length)));
  const Block flyer = strip.add(mesh, flyer_zones, -flyer_length, 0.0);
  Bodies bodies(std::move(mesh));
  bodies.materials = {body_material(p.target), body_material(p.flyer)};
  fill(bodies, target, p.target.eos.density, 0.0, {});
  fill(bodies, flyer, p.flyer.eos.density, 0.0, strip.along(p.speed));
  strip.guide(bodies, target);
  strip.guide(bodies, flyer);
  bodies.slide_lines.push_back({strip.face(target, false), strip.face(flyer, true), false});
  return bodies;
}

std::vector<int> free_surface(const FlyerProblem& p, const Bodies& bodies) {
  return Strip{p.symmetry}.face(bodies.mesh.blocks()[0], true).nodes;
}

std::vector<Comparison> compare(const FlyerProblem& p, const Cycle& cycle) {
  const Strip strip{p.symmetry};
  if (physics::hardens(p.target.strength) || physics::hardens(p.flyer.strength)) return {};
  const double shorter = p.flyer_length > 0.0 ? std::min(p.flyer_length, p.length) : p.length;
  const double elastic =
      std::max(two_waves(p.target, 0.5 * p.speed).elastic_speed, two_waves(p.flyer, 0.5 * p.speed).elastic_speed);
  if (elastic * cycle.state().time > 2.0 * shorter) return {};
  const Impact exact = impact(p.flyer, p.target, p.speed);
  const double shock = two_waves(p.target, exact.velocity).plastic_speed * cycle.state().time;
  const double face = exact.velocity * cycle.state().time;
  return {{"velocity of the struck face", "m s-1", exact.velocity,
           strip.component(cycle.state().velocity[cycle.contact().weights().node(0)])},
          {"stress behind the shock", "Pa", exact.stress,
           strip.mean_stress(cycle, face + 0.1 * (shock - face), face + 0.5 * (shock - face))}};
}

}  // namespace shearbus::hydro
