// The flow of a layer (layer_flow.hpp) against the law as its paper prints it, which the reference evaluates vertex by
// vertex: laws with an explicit strain increment, whose sums are expanded about a stress, and laws that search for the
// increment of each vertex, which the reference inverts by bisection.
#include "server/physics/solver/flow/layer_flow.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <vector>

#include "server/physics/reference/parts.hpp"
#include "tests/support/random_physics.hpp"

namespace shearbus::testing {
namespace {

// A layer, the loads of its lanes, and where its strain after the step goes.
struct Layer {
  explicit Layer(const GridOptions& options)
      : grid(options),
        n(static_cast<std::size_t>(grid.num_vertices())),
        response(n),
        T_ad(n * kLanes),
        strain(n * kLanes),
        spread(n * kLanes),
        strain_new(n * kLanes) {}
  FlowProblem problem() const {
    const double* spread_response = spreads ? spread.data() : nullptr;
    return {&soft, &grid, response.data(), T_ad.data(), strain.data(), dt, spread_response};
  }

  Material soft = make_material("aluminium_dlp", {}).material;
  Grid grid;
  std::size_t n;
  double dt = 1e-9;
  bool spreads = false;
  double pressure[kLanes], stress[kLanes], heating[kLanes];
  std::vector<double> response, T_ad, strain, spread, strain_new;
};

std::size_t place(std::size_t vertex, int lane) {
  return vertex * kLanes + static_cast<std::size_t>(lane);
}

// Sums of the layer under its loads.
class Summed {
 public:
  explicit Summed(Layer& layer)
      : rows_(LayerFlow::size_of_rows(layer.grid)), flow(layer.problem(), rows_.data()), layer_(layer) {}
  void set(int l, double a) { flow.load(l, layer_.soft, layer_.pressure[l], a, layer_.heating[l]); }
  void sum(std::uint32_t lanes = kAllLanes) { flow.sum(lanes, layer_.strain_new.data()); }

 private:
  std::vector<double> rows_;

 public:
  LayerFlow flow;

 private:
  Layer& layer_;
};

// A layer whose lanes are heated and hardened at random: most of them hottest and hardest at z = 0, some anywhere.
struct ExpandedLayer : Layer {
  explicit ExpandedLayer(Draw& draw)
      : Layer({1e-5, draw.integer(1, 70), draw.uniform(1.0, 1.2), FarBoundary::kInsulated}) {
    soft.hardening_exponent = draw.log_uniform(0.01, 1.0);
    soft.hardening_coefficient = draw.log_uniform(1.0, 1000.0);
    spreads = draw.chance(0.3);
    const double depth = draw.log_uniform(0.5, 30.0);
    for (std::size_t i = 0; i < n; ++i) response[i] = 1e-9 * std::exp(-static_cast<double>(i) / depth);
    for (int l = 0; l < kLanes; ++l) {
      const bool falls = draw.chance(0.8), strained_anywhere = draw.chance(0.5);
      const double T_rise = draw.chance(0.1) ? 1000.0 : draw.uniform(0.0, 900.0), most = draw.log_uniform(1e-4, 1e3);
      for (std::size_t i = 0; i < n; ++i) {
        const double at = falls ? std::exp(-static_cast<double>(i) / depth) : draw.uniform(0.0, 1.0);
        T_ad[place(i, l)] = 300.0 + T_rise * at;
        strain[place(i, l)] = most * (strained_anywhere ? draw.uniform(0.0, 1.0) : at);
        spread[place(i, l)] = 1e-9 * draw.uniform(0.0, 1.0);
      }
      pressure[l] = draw.uniform(0.0, 2e10);
      stress[l] = draw.chance(0.1) ? 0.0 : soft.yield_strength * draw.log_uniform(0.05, 20.0);
      heating[l] = draw.chance(0.2) ? 0.0 : draw.log_uniform(1.0, 1000.0);
    }
  }
  // The slip of a lane under the stress a, vertex by vertex.
  double slip(int lane, double a) const {
    double sum = 0.0;
    for (std::size_t i = 0; i < n; ++i) {
      const std::size_t at = place(i, lane);
      const double T = T_ad[at] + heating[lane] * a * (spreads ? spread[at] : response[i]);
      sum += grid.weight[i] * reference::strain_increment(soft, a, pressure[lane], T, strain[at], 1e-9);
    }
    return sum;
  }
};

// Sums of the layer under its stresses; further sums, under others, are expanded about these.
struct Expanded : Summed {
  explicit Expanded(Layer& layer) : Summed(layer) {
    for (int l = 0; l < kLanes; ++l) set(l, layer.stress[l]);
    sum();
  }
};

// The error that a slip may have: rounding of the temperatures, the stress and the exponentials in `hot`, of which the
// strain is a small difference.
double grain(const ExpandedLayer& layer, int lane, double a) {
  const double change = layer.slip(lane, a * (1.0 + 4e-15)) - layer.slip(lane, a * (1.0 - 4e-15));
  double strained = 0.0;
  for (std::size_t i = 0; i < layer.n; ++i) {
    strained += layer.grid.weight[i] * (1.0 / layer.soft.hardening_coefficient + layer.strain[place(i, lane)]);
  }
  return change + 1e-12 * strained + 5e-12 * layer.slip(lane, a);
}

// Compares the sum of a lane, and the strain that it wrote, with the flow vertex by vertex. Returns this flow; negative
// where the layer is molten, where nothing is compared.
double compare(const ExpandedLayer& layer, const Summed& summed, int lane) {
  const double a = summed.flow.stress[lane];
  const double expected = layer.slip(lane, a);
  if (!(expected < 1e-2)) return -1.0;
  EXPECT_NEAR(summed.flow.slip[lane], expected, grain(layer, lane, a));
  double written = 0.0;
  for (std::size_t i = 0; i < layer.n; ++i) {
    const std::size_t at = place(i, lane);
    EXPECT_GE(layer.strain_new[at], layer.strain[at]);
    written += layer.grid.weight[i] * (layer.strain_new[at] - layer.strain[at]);
  }
  EXPECT_NEAR(written, expected, grain(layer, lane, a));
  return expected;
}

TEST(PhysicsExpandedFlow, IsTheFlowVertexByVertex) {
  Draw draw(5);
  int flowing = 0, followed = 0, left_out = 0;
  for (int n = 0; n < 400; ++n) {
    ExpandedLayer layer(draw);
    Expanded summed(layer);
    for (const double change : {0.0, 1e-9, 1e-4, -1e-3, 0.1}) {
      for (int l = 0; l < kLanes; ++l) summed.flow.stress[l] = layer.stress[l] * (1.0 + change);
      if (change != 0.0) summed.sum();
      for (int l = 0; l < kLanes; ++l) {
        const double expected = compare(layer, summed, l);
        ASSERT_FALSE(HasFailure()) << n << ", lane " << l << ", " << change;
        flowing += expected > 0.0 ? 1 : 0;
        followed += expected > 0.0 && summed.flow.expanded.base[l] != summed.flow.stress[l] ? 1 : 0;
      }
      left_out += summed.flow.expanded.limit[0] < layer.grid.num_vertices() ? 1 : 0;
    }
  }
  EXPECT_GT(flowing, 2000);
  EXPECT_GT(followed, 300);
  EXPECT_GT(left_out, 150);
}

// A force-driven lane changes its heat flux by another factor than its stress. The expansion follows both, and tells
// the flow under loads nearby where the same vertices yield.
TEST(PhysicsExpandedFlow, FollowsAFluxThatChangesByItself) {
  Draw draw(31);
  int flowing = 0, followed = 0, told = 0;
  for (int n = 0; n < 200; ++n) {
    ExpandedLayer layer(draw);
    const std::vector<double> heating(layer.heating, layer.heating + kLanes);
    Expanded summed(layer);
    for (const double change : {1e-9, 1e-5, -1e-4, 1e-3, 0.5, -0.8}) {
      NearbyFlow nearby[kLanes];
      for (int l = 0; l < kLanes; ++l) {
        nearby[l] = summed.flow.nearby(l);
        summed.flow.stress[l] = layer.stress[l] * (1.0 - 0.1 * change);
        summed.flow.heating[l] = layer.heating[l] = heating[static_cast<std::size_t>(l)] * (1.0 + change);
      }
      summed.sum();
      for (int l = 0; l < kLanes; ++l) {
        const double expected = compare(layer, summed, l);
        ASSERT_FALSE(HasFailure()) << n << ", lane " << l << ", " << change;
        flowing += expected > 0.0 ? 1 : 0;
        const bool follows = expected > 0.0 && heating[static_cast<std::size_t>(l)] > 0.0 &&
                             summed.flow.expanded.base_heating[l] != summed.flow.heating[l];
        followed += follows ? 1 : 0;
        if (!follows || std::abs(change) > 1e-4) continue;
        const double a = summed.flow.stress[l];
        const NearbyFlow::Slip slip = nearby[l].at(a, summed.flow.heating[l] * a);
        told += std::abs(slip.value - expected) <= 1e-6 * expected + grain(layer, l, a) ? 1 : 0;
      }
    }
  }
  EXPECT_GT(flowing, 1000);
  EXPECT_GT(followed, 200);
  EXPECT_GT(told, 100);
}

// In a search each lane moves by its own steps. Lane 0 moves from a stress at which the whole layer yields to a lower
// one at which its hot part does. Lane 1, which is just below its yield stress everywhere and stays, keeps all vertices
// in the sums of their register: what lane 0 had there at the higher stress must not count any more.
TEST(PhysicsExpandedFlow, KeepsNoVertexOfAStressLeftBehind) {
  Draw draw(5);
  ExpandedLayer layer(draw);
  layer.soft.hardening_exponent = 0.5;
  layer.soft.hardening_coefficient = 100.0;
  layer.spreads = false;
  layer.grid = Grid(GridOptions{1e-5, 60, 1.05, FarBoundary::kInsulated});
  layer.n = static_cast<std::size_t>(layer.grid.num_vertices());
  for (std::vector<double>* rows : {&layer.T_ad, &layer.strain, &layer.spread, &layer.strain_new})
    rows->assign(layer.n * kLanes, 0.0);
  layer.response.assign(layer.n, 0.0);
  for (std::size_t i = 0; i < layer.n; ++i) {
    for (int l = 0; l < kLanes; ++l)
      layer.T_ad[place(i, l)] = 300.0 + (l == 0 ? 800.0 * std::exp(-0.1 * static_cast<double>(i)) : 0.0);
  }
  const double yield = flow_stress(layer.soft, 0.0, 0.0, 300.0) / kSqrt3;
  std::fill_n(layer.pressure, kLanes, 0.0);
  std::fill_n(layer.heating, kLanes, 0.0);
  std::fill_n(layer.stress, kLanes, yield * std::pow(0.93, layer.soft.hardening_exponent));
  layer.stress[0] = 1.2 * yield;
  Expanded summed(layer);
  for (const double share : {0.6, 0.6 * (1.0 + 1e-6), 0.6 * (1.0 + 2e-6)}) {
    summed.flow.stress[0] = share * yield;
    summed.sum();
    EXPECT_GT(compare(layer, summed, 0), 0.0) << share;
    for (int l = 1; l < kLanes; ++l) EXPECT_EQ(compare(layer, summed, l), 0.0) << l;
  }
}

// The root by the expansion balances, where the expansion reaches it and the same vertices yield.
TEST(PhysicsExpandedFlow, TheRootOfTheExpansionBalances) {
  Draw draw(9);
  int compared = 0, exact = 0;
  for (int n = 0; n < 400; ++n) {
    ExpandedLayer layer(draw);
    Expanded summed(layer);
    const double compliance = 1e15;
    alignas(64) double a_trial[kLanes], root[kLanes];
    for (int l = 0; l < kLanes; ++l) {  // the balance at a stress that is lower by 1e-4
      const double a = layer.stress[l] * (1.0 - 1e-4);
      a_trial[l] = a + compliance * layer.slip(l, a);
    }
    summed.flow.find_roots(kAllLanes, compliance, a_trial, root);
    for (int l = 0; l < kLanes; ++l) {
      const double a = layer.stress[l] * (1.0 - 1e-4);
      if (!(layer.slip(l, layer.stress[l]) < 1e-2) || summed.flow.expanded.steepest[l] > 10.0) continue;
      if (!(layer.slip(l, a) > 0.01 * summed.flow.slip[l])) continue;
      if (root[l] < 0.0) continue;
      EXPECT_NEAR(root[l], a, 0.5e-4 * a);  // a vertex that does not yield at the root still counts
      ++compared;
      exact += std::abs(root[l] - a) <= 1e-10 * a ? 1 : 0;
    }
  }
  EXPECT_GT(compared, 300);
  EXPECT_GT(exact, compared / 2);
}

// A layer whose lanes are heated and hardened at random, and loaded around their yield stress at z = 0.
struct SearchedLayer : Layer {
  explicit SearchedLayer(Draw& draw)
      : Layer({1e-5, draw.integer(1, 50), draw.uniform(1.0, 1.2), FarBoundary::kInsulated}) {
    if (draw.chance(0.5)) {
      soft = make_material("copper_ofhc_jc", {}).material;
      soft.hardening_exponent = draw.log_uniform(0.02, 1.0);
      soft.hardening_modulus = draw.log_uniform(1e6, 1e10);
      soft.thermal_exponent = draw.log_uniform(0.4, 2.0);
      soft.rate_coefficient = draw.chance(0.2) ? 0.0 : draw.log_uniform(1e-3, 0.2);
      soft.reference_strain_rate = draw.log_uniform(1e-3, 1e8);
    } else {
      adopt_flow_law(soft, random_preston_tonks_wallace(draw));
    }
    dt = draw.log_uniform(1e-11, 1e-7);
    const double depth = draw.log_uniform(0.5, 30.0);
    for (std::size_t i = 0; i < n; ++i) response[i] = 1e-9 * std::exp(-static_cast<double>(i) / depth);
    for (int l = 0; l < kLanes; ++l) {
      const bool smooth = draw.chance(0.8);
      const double T_rise = draw.uniform(0.0, 0.95) * (soft.melting_temperature - 300.0);
      const double most = draw.chance(0.2) ? 0.0 : draw.log_uniform(1e-4, 10.0);
      for (std::size_t i = 0; i < n; ++i) {
        const double at = smooth ? std::exp(-static_cast<double>(i) / depth) : draw.uniform(0.0, 1.0);
        T_ad[place(i, l)] = 300.0 + T_rise * at;
        strain[place(i, l)] = most * at;
      }
      pressure[l] = draw.uniform(0.0, 2e10);
      const double yield = flow_stress(soft, strain[place(0, l)], pressure[l], T_ad[place(0, l)]);
      stress[l] = draw.chance(0.1) ? 0.0 : yield / kSqrt3 * draw.uniform(0.9, 2.0);
      heating[l] = draw.chance(0.2) ? 0.0 : draw.log_uniform(1.0, 100.0);
    }
  }
};

// Compares the strain of a lane, vertex by vertex, within what 5e-14 of stress and temperature make of it: the error
// functions of both differ by 1e-15.
// Returns the number of vertices that flow.
int compare(const SearchedLayer& layer, const Summed& summed, int lane) {
  const double a = summed.flow.stress[lane];
  int flowing = 0;
  for (std::size_t i = 0; i < layer.n; ++i) {
    const std::size_t at = place(i, lane);
    const double ep = layer.strain[at], T = layer.T_ad[at] + layer.heating[lane] * a * layer.response[i];
    const auto flow_under = [&](double scale) {
      return reference::strain_increment(layer.soft, a * scale, layer.pressure[lane], T * scale, ep, layer.dt);
    };
    const double expected = flow_under(1.0);
    if (expected > 1e6) continue;  // molten
    const double grain = flow_under(1.0 + 5e-14) - flow_under(1.0 - 5e-14) + 1e-12 * expected + 1e-15 * ep;
    EXPECT_NEAR(layer.strain_new[at], ep + expected, grain) << "vertex " << i << ", before " << ep;
    flowing += expected > 0.0 ? 1 : 0;
  }
  return flowing;
}

TEST(PhysicsSearchedFlow, IsTheFlowVertexByVertex) {
  Draw draw(5);
  int flowing = 0;
  for (int n = 0; n < 40; ++n) {
    SearchedLayer layer(draw);
    Summed summed(layer);
    for (const double change : {0.0, 1e-3, 1.1e-3, 1.1e-3 + 1e-8, -0.05, 0.3}) {
      for (int l = 0; l < kLanes; ++l) summed.set(l, layer.stress[l] * (1.0 + change));
      summed.sum();
      for (int l = 0; l < kLanes; ++l) {
        flowing += compare(layer, summed, l);
        ASSERT_FALSE(HasFailure()) << n << ", lane " << l << ", " << change;
      }
    }
  }
  EXPECT_GT(flowing, 6'000);
}

// The slope of the slip, with the heat of the stress, is its derivative.
TEST(PhysicsSearchedFlow, TheSlopeIsTheDerivative) {
  Draw draw(6);
  int compared = 0;
  for (int n = 0; n < 200; ++n) {
    SearchedLayer layer(draw);
    const auto slip = [&](double change) {
      Summed summed(layer);
      for (int l = 0; l < kLanes; ++l) summed.set(l, layer.stress[l] * (1.0 + change));
      summed.sum();
      return summed.flow;
    };
    constexpr double kStep = 1e-6;
    const LayerFlow at = slip(0.0), more = slip(kStep), less = slip(-kStep);
    for (int l = 0; l < kLanes; ++l) {
      const double right = (more.slip[l] - at.slip[l]) / kStep, left = (at.slip[l] - less.slip[l]) / kStep;
      const bool smooth = std::abs(right - left) <= 1e-2 * right;  // no vertex begins to flow or changes its branch
      if (!(at.slip[l] > 0.0) || !smooth) continue;
      ++compared;
      EXPECT_NEAR(at.slope[l], 0.5 * (left + right), std::abs(right - left) + 1e-4 * right) << n << ", lane " << l;
    }
  }
  EXPECT_GT(compared, 500);
}

// The flow nearby is the flow where its power of the stress goes through two sums.
TEST(PhysicsSearchedFlow, TellsTheFlowNearby) {
  Draw draw(8);
  int told = 0, near = 0;
  for (int n = 0; n < 100; ++n) {
    SearchedLayer layer(draw);
    Summed summed(layer);
    NearbyFlow nearby[kLanes];
    for (const double change : {0.0, 1e-4}) {
      for (int l = 0; l < kLanes; ++l) summed.set(l, layer.stress[l] * (1.0 + change));
      summed.sum();
      for (int l = 0; l < kLanes; ++l) nearby[l] = summed.flow.nearby(l);
    }
    for (int l = 0; l < kLanes; ++l) summed.set(l, layer.stress[l] * (1.0 + 1.2e-4));
    summed.sum();
    for (int l = 0; l < kLanes; ++l) {
      if (!(nearby[l].base > 0.0)) continue;
      ++told;
      const double slip = nearby[l].at(layer.stress[l] * (1.0 + 1.2e-4), 0.0).value;
      near += std::abs(slip - summed.flow.slip[l]) <= 1e-6 * summed.flow.slip[l] ? 1 : 0;
    }
  }
  EXPECT_GT(told, 300);
  EXPECT_GT(near, told * 9 / 10);
}

}  // namespace
}  // namespace shearbus::testing
