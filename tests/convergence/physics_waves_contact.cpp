// Layers with inertia whose interface slips under a contact law: exact solutions of a wave that meets the law, order in
// time, and the limit of a layer without mass.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <functional>
#include <limits>
#include <vector>

#include "server/physics/reference/parts.hpp"
#include "server/physics/solver/parts.hpp"
#include "tests/support/orders.hpp"
#include "tests/support/waves.hpp"

namespace shearbus::testing {
namespace {

constexpr double kJump = 20.0;     // velocity at which the layer closes on the hard body  [m/s]
constexpr double kPressure = 5e8;  // compression of the contact  [Pa]
constexpr double kEnd = 10e-9;     // before the wave returns from z = h, after 12.5 ns  [s]

// An elastic layer of aluminium at one temperature, which closes on the hard body and slips on it.
struct Contact {
  const char* name;
  ModelOptions options;
  double state;                                            // at the start
  std::function<double(double slip, double state)> limit;  // stress that the contact carries  [Pa]
  std::function<double(double slip, double state)> rate;   // of the state  [1/s]
};

ModelOptions elastic_layer(FrictionLaw law) {
  ModelOptions options = with_inertia(paper_options());
  options.soft.temperature_coefficient = options.soft.pressure_coefficient = 0.0;
  options.soft.melting_temperature = 1e12;
  options.soft.yield_strength = 1e11;
  options.soft.yield_strength_max = std::numeric_limits<double>::infinity();
  options.friction_coefficient = 0.2;
  options.interface = {.friction_coefficient = 0.2,
                       .friction_law = law,
                       .friction_coefficient_fast = 0.05,
                       .velocity_decay = 0.1,
                       .slip_length = 3e-8,
                       .reference_velocity = 0.5,
                       .direct_effect = 0.004,
                       .evolution_effect = 0.03,
                       .state_evolution = StateEvolution::kAgeing};
  return options;
}

std::vector<Contact> contacts() {
  // At a step of no length the friction of the twin is that of the state before the step.
  const auto friction = [](const ModelOptions& options) {
    return [options](double slip, double state) {
      return reference::friction_of(options, kPressure, 300.0, slip, 0.0, state);
    };
  };
  const ModelOptions weakening = elastic_layer(FrictionLaws::place<VelocityWeakening>());
  const ModelOptions memory = elastic_layer(FrictionLaws::place<PrakashClifton>());
  const ModelOptions ageing = elastic_layer(FrictionLaws::place<RateAndState>());
  ModelOptions rough = elastic_layer({});
  rough.friction_coefficient.reset();
  rough.junctions = {0.5, 1e-7, rough.soft};
  Material& metal = rough.junctions->metal;
  metal.yield_strength = 1.5e8;
  metal.hardening_coefficient = 10.0;
  metal.hardening_exponent = 0.5;
  const double L = ageing.interface.slip_length, V0 = ageing.interface.reference_velocity;
  return {{"velocity weakening", weakening, 0.0, friction(weakening), [](double, double) { return 0.0; }},
          {"memory of pressure", memory, 0.0, friction(memory),
           [=](double slip, double psi) { return -(slip + V0) / L * (psi - kPressure); }},
          {"rate and state", ageing, 0.0, friction(ageing),
           [=](double slip, double zeta) { return V0 / L * std::exp(-zeta) - slip / L; }},
          {"junctions", rough, 0.0,
           [metal](double, double strain) {
             return 0.5 * metal.yield_strength / kSqrt3 *
                    std::pow(1.0 + metal.hardening_coefficient * strain, metal.hardening_exponent);
           },
           [](double slip, double) { return slip / (kSqrt3 * 1e-7); }}};
}

// What the wave leaves: the layer comes with kJump, and the stress s slows its face at z = 0 by s/Z.
struct Exact {
  double stress, slip;
};
Exact exact_answer(const Contact& of) {
  const double Z = impedance(of.options.soft);
  const auto slip = [&](double state) {
    return reference::bisect([&](double v) { return of.limit(v, state) - Z * (kJump - v); }, 0.0, kJump);
  };
  const auto rate = [&](double state) { return of.rate(slip(state), state); };
  double state = of.state;
  constexpr int kSteps = 20000;
  for (int n = 0; n < kSteps; ++n) {
    const double dt = kEnd / kSteps;
    const double k1 = rate(state), k2 = rate(state + 0.5 * dt * k1), k3 = rate(state + 0.5 * dt * k2),
                 k4 = rate(state + dt * k3);
    state += dt / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4);
  }
  const double v = slip(state);
  return {Z * (kJump - v), v};
}

TEST(PhysicsWavesContact, AWaveMeetsEachLawAsTheExactSolutionSays) {
  for (const Contact& contact : contacts()) {
    const Exact exact = exact_answer(contact);
    ASSERT_GT(exact.slip, 1.0) << contact.name;
    Orders orders(contact.name, 0.9, 0.0, Orders::kMore);
    for (const int refined : {1, 2, 4, 8}) {
      ModelOptions options = contact.options;
      options.grid.cells = 50 * refined;
      ASSERT_TRUE(refusals(options).empty()) << contact.name;
      Rig rig(options, 1);
      rig.set_all(kJump, kPressure);
      const int steps = 100 * refined;
      for (int n = 0; n < steps; ++n) rig.step(kEnd / steps);
      orders.add(steps, std::abs(rig.stress() / exact.stress - 1.0), refined == 8 && orders.last() > 1e-6);
      if (refined < 8) continue;
      EXPECT_LT(orders.last(), 5e-3) << contact.name;
      EXPECT_NEAR(rig.outputs.sliding_velocity[0] / exact.slip, 1.0, 5e-3) << contact.name;
    }
  }
}

// The paper's layer, hot and flowing, under every law: without mass it is the layer of one stress, which the
// quasi-static step solves.
double difference_without_mass(ModelOptions options, double density_factor) {
  options.soft.density *= density_factor;
  Rig uniform(options, 1), waves(with_inertia(options), 1);
  double largest = 0.0;
  for (int n = 1; n <= 200; ++n) {
    const double V = 50.0 * (1.0 - std::cos(M_PI * std::min(n / 100.0, 1.0)));
    for (Rig* rig : {&uniform, &waves}) {
      rig->set_all(V, n < 150 ? 11.2e9 : 6e9);
      rig->step(1e-9);
      EXPECT_EQ(rig->outputs.outcome[0] & kFailed, 0);
    }
    largest = std::max(largest, std::abs(waves.stress() - uniform.stress()));
  }
  EXPECT_GT(uniform.outputs.sliding_velocity[0], 1.0);
  return largest;
}

TEST(PhysicsWavesContact, WithoutMassEachLawGivesTheQuasiStaticAnswer) {
  std::printf("jump to 100 m/s in 100 ns, then less pressure: law, density over aluminium's, difference of s\n");
  for (int number = 1; const auto law = FrictionLaws::numbered(number); ++number) {
    if (law == FrictionLaws::place<Own>()) continue;  // a law of a library
    for (const bool junctions : {false, true}) {
      ModelOptions options = graded(paper_options(), 30, 1.1);
      options.interface = FrictionLaws::with(
          *law, [&](auto own) { return decltype(own)::type::typical(options.interface, options.soft); });
      options.interface.friction_law = *law;
      options.friction_coefficient = options.interface.friction_coefficient = 0.012;
      options.interface.friction_coefficient_fast = 0.006;
      options.interface.direct_effect = 0.0004;
      options.interface.evolution_effect = 0.0002;
      if (junctions) {
        options.junctions = {0.5, 1e-6, options.soft};
        options.junctions->metal.yield_strength = 2e8;
      }
      double before = 0.0;
      for (const double factor : {1e-3, 1e-4, 1e-14}) {
        const double difference = difference_without_mass(options, factor);
        std::printf("  %-18s %s %6.0e  %9.2e Pa\n", std::string(FrictionLaws::name_of(*law)).c_str(),
                    junctions ? "and junctions" : "             ", factor, difference);
        if (factor == 1e-4) {
          EXPECT_LT(difference, 0.2 * before + 1e3);
        }
        if (factor == 1e-14) {
          EXPECT_LT(difference, 1e-7 * 1e8);
        }
        before = difference;
      }
    }
  }
}

}  // namespace
}  // namespace shearbus::testing
