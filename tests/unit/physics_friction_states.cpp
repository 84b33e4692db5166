// Friction laws with a state: prakash_clifton and rate_and_state, against their exact solutions, and every law with slip.
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <vector>

#include "server/physics/interface/stress_limit.hpp"
#include "server/physics/reference/parts.hpp"
#include "tests/support/random_physics.hpp"

namespace shearbus::testing {
namespace {

constexpr double kMu = 0.3, kLength = 1e-6, kP = 1e8;

ModelOptions with_law(Strategy strategy, FrictionLaw law) {
  ModelOptions options = graded(paper_options(strategy), 20, 1.2);
  options.grid.far_boundary = FarBoundary::kHalfSpace;
  options.interface = {.friction_coefficient = kMu,
                       .yield_strength = 1e11,
                       .friction_law = law,
                       .slip_length = kLength,
                       .reference_velocity = 0.5,
                       .direct_effect = 0.01,
                       .evolution_effect = 0.015};
  if (strategy == Strategy::kVelocityDriven) options.friction_coefficient = kMu;
  return options;
}

ModelOptions force_driven(FrictionLaw law) {
  return with_law(Strategy::kForceDriven, law);
}

// One node with so much mass that its slip is the jump of the host.
struct Carriage {
  explicit Carriage(const ModelOptions& options) : rig(options, 1) {
    rig.inputs.mass_soft[0] = rig.inputs.mass_hard[0] = 1e18;
  }
  double step(double velocity, double pressure, double dt) {
    rig.inputs.velocity_jump[0] = velocity;
    rig.inputs.pressure[0] = pressure;
    rig.step(dt);
    EXPECT_EQ(rig.outputs.outcome[0], 0);
    return rig.outputs.shear_stress[0];
  }
  Rig rig;
};

// After a step of the pressure at a constant slip velocity friction goes over to the new pressure exponentially in the
// slip: mu (P2 + (P1 - P2) exp(-(v + V) t/L)). The step is exact, so that its length does not matter.
TEST(PhysicsPrakashClifton, FrictionFollowsAPressureStepOverTheSlipLength) {
  for (const double dt : {1e-9, 1e-8}) {
    Carriage node(force_driven(FrictionLaws::place<PrakashClifton>()));
    const double v = 10.0, rate = (v + 0.5) / kLength;
    // A contact that closes knows no pressure.
    EXPECT_NEAR(node.step(v, kP, dt) / (kMu * kP * -std::expm1(-rate * dt)), 1.0, 1e-12);
    for (int n = 0; n < 2e-6 / dt; ++n) node.step(v, kP, dt);
    for (const double P2 : {3.0 * kP, 0.2 * kP}) {
      const double P1 = node.rig.friction_state();
      for (int n = 1; n < 2e-7 / dt; ++n)
        ASSERT_NEAR(node.step(v, P2, dt) / (kMu * (P2 + (P1 - P2) * std::exp(-rate * n * dt))), 1.0, 1e-11) << n;
      for (int n = 0; n < 2e-6 / dt; ++n) node.step(v, P2, dt);
      EXPECT_NEAR(node.rig.friction_state() / P2, 1.0, 1e-8);
    }
    node.step(v, -1.0, dt);  // an open contact forgets
    EXPECT_EQ(node.rig.friction_state(), 0.0);
  }
}

// The velocity-step test of the field: friction jumps by a ln(v2/v1) and falls by b ln(v2/v1) over the slip length. The
// exact solutions: theta = D/v2 + (D/v1 - D/v2) exp(-x) by ageing and ln(v2 theta/D) = ln(v2/v1) exp(-x) by the slip
// law, with the slip x = v2 t/D.
TEST(PhysicsRateAndState, AVelocityStepHasItsExactSolution) {
  for (const StateEvolution evolution : {StateEvolution::kAgeing, StateEvolution::kSlip}) {
    for (const auto& [v1, v2] : {std::array{0.5, 20.0}, std::array{0.5, 0.02}}) {
      ModelOptions options = force_driven(FrictionLaws::place<RateAndState>());
      options.interface.state_evolution = evolution;
      Carriage node(options);
      const InterfaceOptions& law = options.interface;
      const double V0 = law.reference_velocity, a = law.direct_effect, b = law.evolution_effect;
      const double first = node.step(v1, kP, 1e-9);
      EXPECT_NEAR(first, kP * a * std::asinh(0.5 * v1 / V0 * std::exp(kMu / a)),
                  1e-10 * first);  // steady from the start
      const double dt = 0.01 * kLength / v2;
      for (int n = 1; n < 500; ++n) {
        const double kept = std::exp(-v2 * n * dt / kLength);
        const double steady = kLength / v2, theta_old = kLength / v1;
        const double theta = evolution == StateEvolution::kAgeing ? steady + (theta_old - steady) * kept
                                                                  : steady * std::exp(std::log(v2 / v1) * kept);
        const double mu = a * std::asinh(0.5 * v2 / V0 * std::exp((kMu + b * std::log(V0 * theta / kLength)) / a));
        ASSERT_NEAR(node.step(v2, kP, dt), kP * mu, 1e-9 * kP * mu) << n;
      }
    }
  }
}

// A body that friction slows down, against the ordinary differential equation: halving the step halves the error.
TEST(PhysicsRateAndState, ASlowingBodyConvergesAtFirstOrder) {
  const ModelOptions options = force_driven(FrictionLaws::place<RateAndState>());
  const InterfaceOptions& law = options.interface;
  const double mass = 0.5, end = 1e-7, start = 20.0;
  const auto rates = [&](const std::array<double, 2>& y) {  // of V and theta
    const double mu =
        law.direct_effect *
        std::asinh(0.5 * y[0] / law.reference_velocity *
                   std::exp((kMu + law.evolution_effect * std::log(law.reference_velocity * y[1] / kLength)) /
                            law.direct_effect));
    return std::array{-2.0 * mu * kP / mass, 1.0 - y[0] * y[1] / kLength};
  };
  std::array<double, 2> y{start, kLength / law.reference_velocity};
  constexpr int kSteps = 40000;
  for (int n = 0; n < kSteps; ++n) {
    const double h = end / kSteps;
    const auto at = [&](const std::array<double, 2>& k, double share) {
      return std::array{y[0] + share * h * k[0], y[1] + share * h * k[1]};
    };
    const auto k1 = rates(y), k2 = rates(at(k1, 0.5)), k3 = rates(at(k2, 0.5)), k4 = rates(at(k3, 1.0));
    for (int i = 0; i < 2; ++i) y[i] += h / 6.0 * (k1[i] + 2.0 * k2[i] + 2.0 * k3[i] + k4[i]);
  }
  double before = 0.0;
  for (const int steps : {50, 100, 200, 400}) {
    Rig rig(options, 1);
    rig.inputs.mass_soft[0] = rig.inputs.mass_hard[0] = mass;
    rig.inputs.pressure[0] = kP;
    rig.inputs.velocity_jump[0] = start;
    for (int n = 0; n < steps; ++n) {
      rig.step(end / steps);
      rig.inputs.velocity_jump[0] = rig.outputs.velocity_jump_new[0];
    }
    const double error = std::abs(rig.inputs.velocity_jump[0] - y[0]);
    if (before > 0.0) {
      EXPECT_NEAR(before / error, 2.0, 0.2) << steps;
    }
    before = error;
  }
  EXPECT_LT(before, 1e-2);
}

// Friction that vanishes at rest stops slip that far stresses turn, and holds what it carries at any speed.
TEST(PhysicsRateAndState, ABodyWhoseSlipTurnsStopsAndStays) {
  for (const bool flows : {false, true}) {
    ModelOptions options = force_driven(FrictionLaws::place<RateAndState>());
    options.plastic_layer = flows;
    Rig rig(options, 1);
    rig.inputs.mass_soft[0] = rig.inputs.mass_hard[0] = 0.5;
    rig.inputs.pressure[0] = kP;
    rig.inputs.velocity_jump[0] = -1.0;
    rig.inputs.stress_soft[0] = 7.5e7;  // turns the jump to 0.5 m/s, of which friction could take 1.2 m/s
    rig.step(1e-8);
    EXPECT_EQ(rig.outputs.velocity_jump_new[0], 0.0);
    EXPECT_NEAR(rig.outputs.shear_stress[0], 0.5 / 4e-8, 1.0);
    rig.inputs.velocity_jump[0] = 0.0;
    rig.inputs.stress_soft[0] = 1e7;
    for (int n = 0; n < 20; ++n) {
      rig.step(1e-8);
      EXPECT_EQ(rig.outputs.velocity_jump_new[0], 0.0);
      EXPECT_NEAR(rig.outputs.shear_stress[0], 5e6, 1.0);
    }
    rig.inputs.stress_soft[0] = 9e7;
    rig.step(1e-8);
    EXPECT_GT(rig.outputs.velocity_jump_new[0], 0.1);
  }
}

// Velocity-driven the interface slips by what elastic shear leaves of the jump, under the law's friction: both equations
// of each step, for every law and for junctions.
TEST(PhysicsContactLaws, AVelocityDrivenInterfaceSlipsUnderItsLaw) {
  for (int number = 1; const auto law = FrictionLaws::numbered(number); ++number) {
    if (law == FrictionLaws::place<Own>()) continue;  // below
    for (const bool junctions : {false, true}) {
      ModelOptions options = with_law(Strategy::kVelocityDriven, *law);
      options.interface.friction_coefficient_fast = 0.05;
      options.interface.velocity_decay = 0.1;
      options.interface.friction_reference_temperature = 300.0;
      options.interface.friction_softening_exponent = 2.0;
      options.soft.yield_strength = 1e11;  // the layer does not flow
      options.soft.yield_strength_max = std::numeric_limits<double>::infinity();
      if (junctions) {
        options.junctions = {0.5, 1e-7, paper_options().soft};
        options.junctions->metal.yield_strength = 5e7;
      }
      ASSERT_TRUE(refusals(options).empty()) << number;
      Rig rig(options, 1);
      rig.inputs.pressure[0] = 2e8;
      const double h = options.grid.thickness, G = options.soft.shear_modulus, dt = 1e-10;
      int slips = 0;
      double s_old = 0.0, strain = 0.0;
      for (int n = 0; n < 800; ++n) {
        const double V = 100.0 * std::cos(0.02 * n);
        rig.inputs.velocity_jump[0] = V;
        if (n == 400) rig.inputs.pressure[0] = 1e8;
        const double state = rig.model.layout().num_friction_states > 0 ? rig.friction_state() : 0.0;
        rig.step(dt);
        ASSERT_EQ(rig.outputs.outcome[0] & kFailed, 0);
        const double s = rig.outputs.shear_stress[0], v = rig.outputs.sliding_velocity[0];
        ASSERT_NEAR(v + h * (s - s_old) / (G * dt), V, 1e-9 * (std::abs(V) + h * std::abs(s - s_old) / (G * dt)));
        s_old = s;
        const double T0 = rig.outputs.interface_temperature[0], P = rig.inputs.pressure[0];
        double limit = reference::friction_of(options, P, T0, std::abs(v), dt, state);
        if (junctions) {
          strain += dt * std::abs(v) / (kSqrt3 * options.junctions->height);
          ASSERT_NEAR(rig.junction_strain(), strain, 1e-9 * strain);
          const double hardened = SteinbergCochranGuinan::hardened(options.junctions->metal, strain, 0.0, 0.0, 0.0);
          limit = std::min(limit, 0.5 * hardened / kSqrt3 * softening(options.soft, P, T0).g);
        }
        if (v == 0.0 && law == FrictionLaws::place<RateAndState>()) continue;  // slower than digits tell
        if (v == 0.0) {
          ASSERT_LE(std::abs(s), limit * (1.0 + 1e-9) + 1e-3) << number << " " << n;
        } else {
          ASSERT_NEAR(std::abs(s), limit, 1e-8 * limit) << number << " " << n << " v " << v;
          ASSERT_GE(s * v, 0.0);
          ++slips;
        }
      }
      EXPECT_GT(slips, 100) << FrictionLaws::name_of(*law) << junctions;
    }
  }
}

// A friction law may only say that it rises with one slip and falls with the other if it does: the searches prove with it
// that no answer was missed. Its derivatives are those of its values.
TEST(PhysicsContactLaws, FrictionRisesWithOneSlipAndFallsWithTheOther) {
  Draw draw(5);
  for (int n = 0; n < 20000; ++n) {
    ModelOptions options = force_driven({});
    draw_state_law(draw, options);
    if (n % 3 == 0) options.interface.friction_law = FrictionLaws::place<VelocityWeakening>();
    options.interface.friction_coefficient_fast = kMu * draw.uniform(0.0, 2.0);
    options.interface.velocity_decay = draw.log_uniform(1e-3, 1.0);
    const InterfaceOptions& law = options.interface;
    StressLimit limit = interface_strength(law, options.soft, kP, nullptr);
    limit.dt = draw.log_uniform(1e-12, 1e-5);
    const bool of_pressure = law.friction_law == FrictionLaws::place<PrakashClifton>();
    limit.state[0] = of_pressure ? kP * draw.uniform(0.0, 3.0) : draw.uniform(-20.0, 20.0);
    const double up = draw.log_uniform(1e-6, 1e4), down = draw.log_uniform(1e-6, 1e4);
    const auto at = [&](double rising, double falling) { return limit.friction(300.0, {rising, falling}); };
    const double digits = 1e-12 * kP;
    ASSERT_GE(at(1.1 * up, down).stress, at(up, down).stress - digits) << n;
    ASSERT_LE(at(up, 1.1 * down).stress, at(up, down).stress + digits) << n;
    ASSERT_LE(at(up, down).stress, at(up, 0.0).stress + digits) << n;
    ASSERT_GE(at(up, down).stress, at(0.0, down).stress - digits) << n;
    ASSERT_NEAR(at(up, up).stress, reference::friction_of(options, kP, 300.0, up, limit.dt, limit.state[0]), 1e-9 * kP)
        << n;
    const double by_up = (at(up * 1.0001, down).stress - at(up * 0.9999, down).stress) / (2e-4 * up);
    const double by_down = (at(up, down * 1.0001).stress - at(up, down * 0.9999).stress) / (2e-4 * down);
    ASSERT_NEAR(at(up, down).up_slope, by_up, 1e-3 * std::abs(by_up) + 1e-7 * kP / up) << n;
    ASSERT_NEAR(at(up, down).down_slope, by_down, 1e-3 * std::abs(by_down) + 1e-7 * kP / down) << n;
  }
}

double coulomb_of(const shearbus_contact_point* point) {
  return point->friction_coefficient * point->pressure;
}
// Linear slip weakening: friction falls to a half over the slip of 1 um.
double weakened(const shearbus_contact_point* point) {
  return coulomb_of(point) * (1.0 - 0.5 * std::min(1.0, point->state[0] / 1e-6));
}
void slip_further(const shearbus_contact_point* point, double dt, double* state) {
  state[0] = point->pressure > 0.0 ? point->state[0] + point->slip * dt : 0.0;
}
constexpr shearbus_friction_law kWeakening{
    SHEARBUS_FRICTION_LAW_VERSION, 1, SHEARBUS_CONSTANT, SHEARBUS_FALLS, 0, weakened, slip_further};

// A law from outside gives the stress and the state that it says.
TEST(PhysicsOwnFriction, ALawFromOutsideIsSolvedInBothStrategies) {
  ModelOptions options = force_driven(FrictionLaws::place<Own>());
  options.interface.own = &kWeakening;
  Carriage node(options);
  for (int n = 1; n < 300; ++n)
    ASSERT_NEAR(node.step(10.0, kP, 1e-9), kMu * kP * (1.0 - 0.5 * std::min(1.0, n * 1e-8 / 1e-6)), 1e-9 * kP) << n;
  options = with_law(Strategy::kVelocityDriven, FrictionLaws::place<Own>());
  options.interface.own = &kWeakening;
  options.soft.yield_strength = options.soft.yield_strength_max = 1e11;
  Rig rig(options, 1);
  rig.inputs.pressure[0] = kP;
  rig.inputs.velocity_jump[0] = 50.0;
  double slid = 0.0;
  for (int n = 0; n < 1000; ++n) {
    rig.step(1e-10);
    ASSERT_EQ(rig.outputs.outcome[0] & kFailed, 0);
    slid += 1e-10 * rig.outputs.sliding_velocity[0];
    if (rig.outputs.regime[0] != Regime::kCoulomb) continue;
    ASSERT_NEAR(rig.outputs.shear_stress[0], kMu * kP * (1.0 - 0.5 * std::min(1.0, slid / 1e-6)), 1e-7 * kP) << n;
  }
  EXPECT_GT(slid, 1e-6);
}

// A law that throws, gives no number or less than 0, or does not do what it declares fails its node, which keeps its
// state. The other nodes of the tile go on.
TEST(PhysicsOwnFriction, ALawThatBreaksItsWordFailsItsNodeAlone) {
  const shearbus_friction_law laws[] = {
      {1, 0, 0, 0, 0,
       [](const shearbus_contact_point* p) -> double {
         if (p->pressure > 2.0 * kP) throw 1;
         return coulomb_of(p);
       },
       nullptr},
      {1, 0, 0, 0, 0,
       [](const shearbus_contact_point* p) { return p->pressure > 2.0 * kP ? std::nan("") : coulomb_of(p); }, nullptr},
      {1, 0, 0, 0, 0, [](const shearbus_contact_point* p) { return p->pressure > 2.0 * kP ? -1.0 : coulomb_of(p); },
       nullptr},
      {1, 0, SHEARBUS_RISES, 0, 0,
       [](const shearbus_contact_point* p) {
         return coulomb_of(p) * (p->pressure > 2.0 * kP ? std::exp(-p->slip) : 1.0);
       },
       nullptr},
      {1, 0, 0, 0, 1,
       [](const shearbus_contact_point* p) {
         return coulomb_of(p) * (p->pressure > 2.0 * kP ? 1.0 + 1e-3 * p->temperature : 1.0);
       },
       nullptr},
      {1, 1, 0, SHEARBUS_CONSTANT, 0, coulomb_of, [](const shearbus_contact_point* p, double, double* state) {
         state[0] = p->pressure > 2.0 * kP ? std::nan("") : state[0] + 1.0;
       }}};
  for (const Strategy strategy : {Strategy::kForceDriven, Strategy::kVelocityDriven})
    for (const bool flows : {false, true})
      for (const shearbus_friction_law& law : laws) {
        ModelOptions options = with_law(strategy, FrictionLaws::place<Own>());
        options.interface.own = &law;
        options.plastic_layer = flows && strategy == Strategy::kForceDriven;
        if (flows) options.soft = catalog()[0].material;
        Rig rig(options);
        for (int l = 0; l < kLanes; ++l) rig.inputs.mass_soft[l] = rig.inputs.mass_hard[l] = 1.0;
        rig.set_all(20.0, kP);
        for (int n = 0; n < 5; ++n) rig.step(1e-9);
        rig.inputs.pressure[2] = 3.0 * kP;
        const std::vector<double> before = rig.committed;
        rig.step(1e-9);
        // At rest a law that falls where it said it rises shows nothing: an interface that sticks may go on.
        const bool at_rest = law.with_slip == SHEARBUS_RISES && rig.outputs.outcome[2] == 0;
        if (at_rest) {
          ASSERT_TRUE(flows && rig.outputs.regime[2] != Regime::kCoulomb);
        }
        for (int l = 0; l < kLanes; ++l)
          ASSERT_EQ((rig.outputs.outcome[l] & kFailed) != 0, l == 2 && !at_rest)
              << "law " << &law - laws << ", lane " << l << ", flows " << flows;
        if (at_rest) continue;
        for (std::size_t i = 2; i < before.size(); i += kLanes) ASSERT_EQ(rig.committed[i], before[i]);
      }
}

TEST(PhysicsContactLaws, ConstantsWithoutAMeaningAreRefused) {
  const auto key = [](ModelOptions options) {
    const std::vector<Refusal> found = refusals(options);
    return found.empty() ? std::string() : found.front().key;
  };
  for (const FrictionLaw law : {FrictionLaws::place<PrakashClifton>(), FrictionLaws::place<RateAndState>()}) {
    ModelOptions options = force_driven(law);
    EXPECT_EQ(key(options), "");
    options.interface.slip_length = 0.0;
    EXPECT_EQ(key(options), "interface.slip_length_m");
    options = force_driven(law);
    options.sleep = true;
    EXPECT_EQ(key(options), "interface.friction_law");
    EXPECT_EQ(refusals(options).front().remedy,
              "Take another interface.friction_law, or leave out layer.sleep = true.");
  }
  ModelOptions options = force_driven(FrictionLaws::place<RateAndState>());
  options.interface.direct_effect = 0.0;
  EXPECT_EQ(key(options), "interface.direct_effect");
}

// Junctions weaker than a layer at its ceiling when they are fresh, and stronger once they have slipped: the layer flows
// by any amount under its ceiling, and the junctions slip until they carry it.
TEST(PhysicsContactLaws, AContactThatHardensPastALayerAtItsCeilingSlipsUntilItCarriesIt) {
  for (const bool inertia : {false, true}) {
    ModelOptions options = graded(paper_options(), 20, 1.2);
    options.soft.hardening_coefficient = 0.0;
    options.soft.yield_strength = 2e8;
    options.soft.temperature_coefficient = options.soft.pressure_coefficient = 0.0;
    options.soft.melting_temperature = 1e9;
    options.junctions = {0.5, 1e-7, options.soft};
    options.junctions->metal.hardening_coefficient = 100.0;
    options.junctions->metal.hardening_exponent = 0.5;
    options.inertia = inertia;
    Rig rig(options, 1);
    rig.set_all(100.0, 1e9);
    double strain = 0.0;
    for (int n = 0; n < 20; ++n) {
      rig.step(1e-9);
      const double v = (rig.junction_strain() - strain) * kSqrt3 * 1e-7 / 1e-9;
      strain = rig.junction_strain();
      const double limit = 0.5 * 2e8 * std::sqrt(1.0 + 100.0 * strain) / kSqrt3;
      ASSERT_LE(rig.stress(), limit * (1.0 + 1e-10)) << inertia << n;
      if (v > 0.0) {
        ASSERT_NEAR(rig.stress(), limit, 1e-9 * limit) << inertia << n;
      }
    }
    EXPECT_NEAR(strain, 0.03, 1e-10) << inertia;  // twice the strength of fresh junctions
    EXPECT_NEAR(rig.stress(), 2e8 / kSqrt3, 1.0);
  }
}

}  // namespace
}  // namespace shearbus::testing
