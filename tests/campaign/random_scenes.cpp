#include "tests/campaign/random_scenes.hpp"

#include <cstdint>
#include <iterator>
#include <limits>

#include "server/shard/pairs.hpp"

namespace shearbus::study::stability {

using namespace shearbus::testing;  // NOLINT(google-build-using-namespace): rigs, draws of tests/support

namespace {

void follow_simon(Draw& draw, Material& metal, bool extreme) {
  metal.simon_temperature = metal.melting_temperature * (draw.chance(0.5) ? 1.0 : draw.uniform(1.0, 1.5));
  metal.simon_pressure = draw.log_uniform(extreme ? 1e8 : 1e9, extreme ? 1e13 : 1e11);
  metal.simon_exponent = draw.chance(0.2) ? 1.0 : draw.uniform(1.0, extreme ? 20.0 : 5.0);
  choose_melting_curve(metal, MeltingCurve::kSimon);
}

void hold_far_faces(Draw& draw, ModelOptions& options) {
  const int faces = options.hard_grid ? draw.integer(1, 3) : 1;
  if ((faces & 1) != 0) options.grid.far_boundary = FarBoundary::kIsothermal;
  if ((faces & 2) != 0) options.hard_grid->far_boundary = FarBoundary::kIsothermal;
}

using Change = void (*)(Draw& draw, ModelOptions& options);

// What may differ between the pairs of a scene, each change in a constant that a node may have for itself.
constexpr Change kChanges[] = {
    [](Draw& draw, ModelOptions& o) { o.soft.yield_strength *= draw.log_uniform(0.3, 1.0); },
    [](Draw& draw, ModelOptions& o) {
      const double factor = draw.log_uniform(0.2, 5.0);
      o.soft.conductivity *= factor;
      o.soft.diffusivity *= factor;
    },
    [](Draw& draw, ModelOptions& o) { o.soft.shear_modulus *= draw.log_uniform(0.3, 3.0); },
    [](Draw& draw, ModelOptions& o) { o.hard.conductivity *= draw.log_uniform(0.2, 5.0); },
    [](Draw& draw, ModelOptions& o) { o.interface.friction_coefficient *= draw.log_uniform(0.5, 2.0); },
    [](Draw& draw, ModelOptions& o) { o.interface.yield_strength *= draw.log_uniform(0.3, 3.0); },
    [](Draw& draw, ModelOptions& o) {
      if (o.friction_coefficient) *o.friction_coefficient *= draw.log_uniform(0.5, 2.0);
    },
    [](Draw& draw, ModelOptions& o) { o.grid.thickness *= draw.log_uniform(0.3, 3.0); },
    [](Draw& draw, ModelOptions& o) { o.initial_temperature *= draw.uniform(0.3, 1.0); },
};

}  // namespace

ModelOptions with_further_options(Draw& draw, ModelOptions options, bool extreme) {
  const auto maybe = [&](double probability, const auto& change) {
    if (!draw.chance(probability)) return;
    ModelOptions more = options;
    change(more);
    if (refusals(more).empty()) options = more;
  };
  maybe(0.25, [&](ModelOptions& o) {
    follow_simon(draw, o.soft, extreme);
    if (!o.junctions) return;
    o.junctions->metal.melting_temperature = o.soft.melting_temperature;
    o.junctions->metal.simon_temperature = o.soft.simon_temperature;
    o.junctions->metal.simon_pressure = o.soft.simon_pressure;
    o.junctions->metal.simon_exponent = o.soft.simon_exponent;
    o.junctions->metal.melting_curve = o.soft.melting_curve;
  });
  maybe(0.2, [&](ModelOptions& o) { hold_far_faces(draw, o); });
  if (!extreme) maybe(0.03, [&](ModelOptions& o) { o = discretised(o, draw.log_uniform(3e-3, 1e-1)); });
  // Draws from another generator, so that scenes without sleep stay as they were before it was drawn.
  Draw copy = draw, aside(static_cast<std::uint64_t>(copy.integer(0, std::numeric_limits<int>::max())));
  if (ModelOptions asleep = options; aside.chance(0.15)) {
    asleep.sleep = true;
    if (refusals(asleep).empty()) options = asleep;
  }
  return options;
}

ModelOptions another_pair(Draw& draw, const ModelOptions& first) {
  const Model model(first);
  for (int tries = 0; tries < 20; ++tries) {
    ModelOptions other = first;
    if (draw.chance(0.5)) {
      kChanges[draw.integer(0, static_cast<int>(std::size(kChanges)) - 1)](draw, other);
    } else {
      for (const Change change : kChanges)
        if (draw.chance(0.5)) change(draw, other);
    }
    if (other.tolerance) other = discretised(other, *other.tolerance);
    if (refusals(other).empty() && shard::same_states(model, Model(other))) return other;
  }
  return first;
}

}  // namespace shearbus::study::stability
