// The flow of a layer whose law has an explicit strain increment, against the law as its paper prints it, which the
// reference evaluates vertex by vertex.
#include "server/physics/solver/flow/layer_flow.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <vector>

#include "server/physics/reference/parts.hpp"
#include "tests/support/random_physics.hpp"

namespace shearbus::testing {
namespace {

// A layer whose lanes are heated and hardened at random: most of them hottest and hardest at z = 0, some anywhere.
struct RandomLayer {
  explicit RandomLayer(Draw& draw)
      : grid(GridOptions{1e-5, draw.integer(1, 70), draw.uniform(1.0, 1.2), FarBoundary::kInsulated}),
        n(static_cast<std::size_t>(grid.num_vertices())),
        response(n),
        T_ad(n * kLanes),
        strain(n * kLanes),
        spread(n * kLanes),
        strain_new(n * kLanes) {
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
        T_ad[i * kLanes + static_cast<std::size_t>(l)] = 300.0 + T_rise * at;
        strain[i * kLanes + static_cast<std::size_t>(l)] = most * (strained_anywhere ? draw.uniform(0.0, 1.0) : at);
        spread[i * kLanes + static_cast<std::size_t>(l)] = 1e-9 * draw.uniform(0.0, 1.0);
      }
      pressure[l] = draw.uniform(0.0, 2e10);
      stress[l] = draw.chance(0.1) ? 0.0 : soft.yield_strength * draw.log_uniform(0.05, 20.0);
      heating[l] = draw.chance(0.2) ? 0.0 : draw.log_uniform(1.0, 1000.0);
    }
  }
  FlowProblem problem() const {
    const double* spread_response = spreads ? spread.data() : nullptr;
    return {&soft, &grid, response.data(), T_ad.data(), strain.data(), 1e-9, spread_response};
  }
  // The slip of a lane under the stress a, vertex by vertex.
  double slip(int lane, double a) const {
    double sum = 0.0;
    for (std::size_t i = 0; i < n; ++i) {
      const std::size_t at = i * kLanes + static_cast<std::size_t>(lane);
      const double T = T_ad[at] + heating[lane] * a * (spreads ? spread[at] : response[i]);
      sum += grid.weight[i] * reference::strain_increment(soft, a, pressure[lane], T, strain[at], 1e-9);
    }
    return sum;
  }

  Material soft = make_material("aluminium_dlp", {}).material;
  Grid grid;
  std::size_t n;
  bool spreads = false;
  double pressure[kLanes], stress[kLanes], heating[kLanes];
  std::vector<double> response, T_ad, strain, spread, strain_new;
};

// Sums of the layer under the stresses and, expanded about these, under others.
class Summed {
 public:
  explicit Summed(RandomLayer& layer)
      : rows_(LayerFlow::size_of_rows(layer.grid)), flow(layer.problem(), rows_.data()), layer_(layer) {
    for (int l = 0; l < kLanes; ++l) flow.load(l, layer.soft, layer.pressure[l], layer.stress[l], layer.heating[l]);
    sum();
  }
  void sum(std::uint32_t lanes = kAllLanes) { flow.sum(lanes, layer_.strain_new.data()); }

 private:
  std::vector<double> rows_;

 public:
  LayerFlow flow;

 private:
  RandomLayer& layer_;
};

// The error that a slip may have: rounding of the temperatures, the stress and the exponentials in `hot`, of which the
// strain is a small difference.
double grain(const RandomLayer& layer, int lane, double a) {
  const double change = layer.slip(lane, a * (1.0 + 4e-15)) - layer.slip(lane, a * (1.0 - 4e-15));
  double strained = 0.0;
  for (std::size_t i = 0; i < layer.n; ++i) {
    strained += layer.grid.weight[i] *
                (1.0 / layer.soft.hardening_coefficient + layer.strain[i * kLanes + static_cast<std::size_t>(lane)]);
  }
  return change + 1e-12 * strained + 5e-12 * layer.slip(lane, a);
}

// Compares the sum of a lane, and the strain that it wrote, with the flow vertex by vertex. Returns this flow; negative
// where the layer is molten, where nothing is compared.
double compare(const RandomLayer& layer, const Summed& summed, int lane) {
  const double a = summed.flow.stress[lane];
  const double expected = layer.slip(lane, a);
  if (!(expected < 1e-2)) return -1.0;
  EXPECT_NEAR(summed.flow.slip[lane], expected, grain(layer, lane, a));
  double written = 0.0;
  for (std::size_t i = 0; i < layer.n; ++i) {
    const std::size_t at = i * kLanes + static_cast<std::size_t>(lane);
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
    RandomLayer layer(draw);
    Summed summed(layer);
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
    RandomLayer layer(draw);
    const std::vector<double> heating(layer.heating, layer.heating + kLanes);
    Summed summed(layer);
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
  RandomLayer layer(draw);
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
      layer.T_ad[i * kLanes + static_cast<std::size_t>(l)] =
          300.0 + (l == 0 ? 800.0 * std::exp(-0.1 * static_cast<double>(i)) : 0.0);
  }
  const double yield = flow_stress(layer.soft, 0.0, 0.0, 300.0) / kSqrt3;
  std::fill_n(layer.pressure, kLanes, 0.0);
  std::fill_n(layer.heating, kLanes, 0.0);
  std::fill_n(layer.stress, kLanes, yield * std::pow(0.93, layer.soft.hardening_exponent));
  layer.stress[0] = 1.2 * yield;
  Summed summed(layer);
  for (const double share : {0.6, 0.6 * (1.0 + 1e-6), 0.6 * (1.0 + 2e-6)}) {
    summed.flow.stress[0] = share * yield;
    summed.sum();
    EXPECT_GT(compare(layer, summed, 0), 0.0) << share;
    for (int l = 1; l < kLanes; ++l) EXPECT_EQ(compare(layer, summed, l), 0.0) << l;
  }
}

// The bits of a lane are those of a lane that is summed by itself.
TEST(PhysicsExpandedFlow, ALaneDoesNotSeeTheOthers) {
  Draw draw(7);
  for (int n = 0; n < 100; ++n) {
    RandomLayer layer(draw);
    RandomLayer alone = layer;
    const int lane = n % kLanes;
    for (int l = 0; l < kLanes; ++l) alone.stress[l] = l == lane ? layer.stress[l] : 0.0;
    Summed one(alone), all(layer);
    for (int move = 0; move < 20; ++move) {
      for (int l = 0; l < kLanes; ++l) {
        const double change = draw.chance(0.5) ? draw.log_uniform(1e-6, 0.03) : -draw.log_uniform(1e-6, 0.03);
        all.flow.stress[l] = layer.stress[l] * (1.0 + (l == lane && draw.chance(0.3) ? 0.0 : change));
      }
      one.flow.stress[lane] = all.flow.stress[lane];
      one.sum(1u << lane);
      all.sum();
      ASSERT_EQ(one.flow.slip[lane], all.flow.slip[lane]) << n;
      ASSERT_EQ(one.flow.slope[lane], all.flow.slope[lane]) << n;
      for (std::size_t i = 0; i < layer.n; ++i) {
        const std::size_t at = i * kLanes + static_cast<std::size_t>(lane);
        ASSERT_EQ(alone.strain_new[at], layer.strain_new[at]) << n;
      }
    }
  }
}

// The root by the expansion balances, where the expansion reaches it and the same vertices yield.
TEST(PhysicsExpandedFlow, TheRootOfTheExpansionBalances) {
  Draw draw(9);
  int compared = 0, exact = 0;
  for (int n = 0; n < 400; ++n) {
    RandomLayer layer(draw);
    Summed summed(layer);
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

}  // namespace
}  // namespace shearbus::testing
