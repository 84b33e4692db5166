// The flow of laws that search for the strain increment of each vertex, against the laws as their papers print them,
// which the reference inverts by bisection.
#include "server/physics/solver/flow/layer_flow.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <vector>

#include "server/physics/reference/parts.hpp"
#include "tests/support/random_physics.hpp"

namespace shearbus::testing {
namespace {

// A layer whose lanes are heated and hardened at random, and loaded around their yield stress at z = 0.
struct RandomLayer {
  explicit RandomLayer(Draw& draw)
      : grid(GridOptions{1e-5, draw.integer(1, 50), draw.uniform(1.0, 1.2), FarBoundary::kInsulated}),
        n(static_cast<std::size_t>(grid.num_vertices())),
        response(n),
        T_ad(n * kLanes),
        strain(n * kLanes),
        strain_new(n * kLanes) {
    if (draw.chance(0.5)) {
      soft = make_material("copper_ofhc_jc", {}).material;
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
        T_ad[i * kLanes + static_cast<std::size_t>(l)] = 300.0 + T_rise * at;
        strain[i * kLanes + static_cast<std::size_t>(l)] = most * at;
      }
      pressure[l] = draw.uniform(0.0, 2e10);
      const double yield =
          flow_stress(soft, strain[static_cast<std::size_t>(l)], pressure[l], T_ad[static_cast<std::size_t>(l)]);
      stress[l] = draw.chance(0.1) ? 0.0 : yield / kSqrt3 * draw.uniform(0.9, 2.0);
      heating[l] = draw.chance(0.2) ? 0.0 : draw.log_uniform(1.0, 100.0);
    }
  }
  FlowProblem problem() const { return {&soft, &grid, response.data(), T_ad.data(), strain.data(), dt}; }

  Material soft = make_material("aluminium_dlp", {}).material;
  Grid grid;
  std::size_t n;
  double dt;
  double pressure[kLanes], stress[kLanes], heating[kLanes];
  std::vector<double> response, T_ad, strain, strain_new;
};

class Summed {
 public:
  explicit Summed(RandomLayer& layer)
      : rows_(LayerFlow::size_of_rows(layer.grid)), flow(layer.problem(), rows_.data()), layer_(layer) {}
  void set(int l, double a) { flow.load(l, layer_.soft, layer_.pressure[l], a, layer_.heating[l]); }
  void sum(std::uint32_t lanes = kAllLanes) { flow.sum(lanes, layer_.strain_new.data()); }

 private:
  std::vector<double> rows_;

 public:
  LayerFlow flow;

 private:
  RandomLayer& layer_;
};

// Compares the strain of a lane, vertex by vertex, within what 5e-14 of stress and temperature make of it: the error
// functions of both differ by 1e-15.
// Returns the number of vertices that flow.
int compare(const RandomLayer& layer, const Summed& summed, int lane) {
  const double a = summed.flow.stress[lane];
  int flowing = 0;
  for (std::size_t i = 0; i < layer.n; ++i) {
    const std::size_t at = i * kLanes + static_cast<std::size_t>(lane);
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
    RandomLayer layer(draw);
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
    RandomLayer layer(draw);
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

// The bits of a lane do not depend on the loads of the others, nor on how often these are summed.
TEST(PhysicsSearchedFlow, ALaneDoesNotSeeTheOthers) {
  Draw draw(7);
  for (int n = 0; n < 60; ++n) {
    RandomLayer layer(draw);
    RandomLayer alone = layer;
    const int lane = n % kLanes;
    Summed one(alone), all(layer);
    for (int l = 0; l < kLanes; ++l) {
      one.set(l, l == lane ? layer.stress[l] : 0.0);
      all.set(l, layer.stress[l]);
    }
    for (int move = 0; move < 12; ++move) {
      const bool stays = draw.chance(0.4);
      for (int l = 0; l < kLanes; ++l) {
        const double change = draw.sign() * draw.log_uniform(1e-10, 0.03);
        if (move > 0 && (l != lane || !stays)) all.set(l, layer.stress[l] * (1.0 + change));
        if (move > 0 && l == lane && !stays) one.set(l, layer.stress[l] * (1.0 + change));
      }
      all.sum();
      if (move == 0 || !stays) one.sum(1u << lane);
      ASSERT_EQ(one.flow.slip[lane], all.flow.slip[lane]) << n;
      ASSERT_EQ(one.flow.slope[lane], all.flow.slope[lane]) << n;
      for (std::size_t i = 0; i < layer.n; ++i) {
        const std::size_t at = i * kLanes + static_cast<std::size_t>(lane);
        ASSERT_EQ(alone.strain_new[at], layer.strain_new[at]) << n;
      }
    }
  }
}

// The flow nearby is the flow where its power of the stress goes through two sums.
TEST(PhysicsSearchedFlow, TellsTheFlowNearby) {
  Draw draw(8);
  int told = 0, near = 0;
  for (int n = 0; n < 100; ++n) {
    RandomLayer layer(draw);
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
