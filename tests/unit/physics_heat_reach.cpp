// `conduct` skips the vertices that heat has not reached. Its results must have the same bits as sweeps over the whole
// grid.
#include <gtest/gtest.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstdio>
#include <limits>
#include <random>
#include <thread>
#include <vector>

#include "tests/support/physics_rig.hpp"

namespace shearbus::testing {
namespace {

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();

std::vector<double> lane_of(const std::vector<double>& tile, int lane) {
  std::vector<double> values;
  for (std::size_t i = static_cast<std::size_t>(lane); i < tile.size(); i += kLanes) values.push_back(tile[i]);
  return values;
}

std::vector<std::uint64_t> bits(const std::vector<double>& values) {
  std::vector<std::uint64_t> all;
  for (const double value : values) all.push_back(std::bit_cast<std::uint64_t>(value));
  return all;
}

// Conducts one lane for one step by sweeps over the whole grid, with the elimination and substitution factors of the
// heat operator.
std::vector<double> swept_from_end_to_end(const HeatOperator& heat, const std::vector<double>& old) {
  const std::size_t n = old.size();
  const auto m = static_cast<std::size_t>(heat.interface);
  const double far = std::min(old.front(), old.back());
  std::vector<double> T(n);
  double soft = 0.0, hard = 0.0;
  for (std::size_t i = n - 1; i > m; --i) T[i] = soft = (old[i] - far) * heat.inverse_pivot[i] + heat.inward[i] * soft;
  for (std::size_t i = 0; i < m; ++i) T[i] = hard = (old[i] - far) * heat.inverse_pivot[i] + heat.inward[i] * hard;
  const double interface = (old[m] - far) * heat.inverse_pivot[m] + heat.inward[m] * soft + heat.inward_hard * hard;
  T[m] = far + interface;
  double t = interface;
  for (std::size_t i = m + 1; i < n; ++i) {
    t = T[i] + heat.outward[i] * t;
    T[i] = far + t;
  }
  t = interface;
  for (std::size_t i = m; i-- > 0;) {
    t = T[i] + heat.outward[i] * t;
    T[i] = far + t;
  }
  return T;
}

class Draw {
 public:
  double between(double low, double high) { return std::uniform_real_distribution(low, high)(random_); }
  double decades(double low, double high) { return std::pow(10.0, between(low, high)); }
  int below(int end) { return std::uniform_int_distribution(0, end - 1)(random_); }

  HeatGrid grid() {
    const auto one = [&] {
      return GridOptions{decades(-7, -3), 1 + below(70), 1.0 + (below(3) == 0 ? 0.0 : between(0.0, 0.5)),
                         below(2) == 0 ? FarBoundary::kInsulated : FarBoundary::kHalfSpace};
    };
    const GridOptions soft = one(), hard = one();
    return below(2) == 0 ? HeatGrid(Grid(soft), soft.far_boundary)
                         : HeatGrid(Grid(soft), soft.far_boundary, Grid(hard), hard.far_boundary);
  }

  // A random temperature profile of one lane, of one of eight kinds. Some kinds are unlikely in a real run.
  std::vector<double> profile(const HeatOperator& heat) {
    const int n = static_cast<int>(heat.outward.size());
    const double far = between(1.0, 1500.0);
    std::vector<double> T(static_cast<std::size_t>(n), far);
    const int soft = heat.interface + below(n - heat.interface), hard = below(heat.interface + 1);
    switch (below(8)) {
      case 0:  // the temperature is uniform
        break;
      case 1:  // flux at z = 0 heats a uniform profile over some steps, as friction does
        for (int steps = below(12), step = 0; step < steps; ++step) {
          T = swept_from_end_to_end(heat, T);
          const double flux = decades(-20.0, 3.0) / heat.response[heat.interface];
          for (int i = 0; i < n; ++i) T[i] += flux * heat.response[i];
        }
        break;
      case 2:  // random heat in some vertices around z = 0, a uniform temperature elsewhere
        for (int i = hard; i <= soft; ++i) T[i] += decades(-18.0, 3.0);
        break;
      case 3:  // one vertex is hotter than the others by one ulp
        T[below(n)] = std::nextafter(far, 2.0 * far);
        break;
      case 4:  // random heat in every vertex
        for (double& t : T) t += decades(-18.0, 3.0);
        break;
      case 5:  // a random temperature at each vertex of the hard body, a uniform one in the soft body
        for (int i = 0; i <= heat.interface; ++i) T[i] = between(1.0, 1500.0);
        break;
      case 6:  // the vertices around z = 0 are colder than the others
        for (int i = hard; i <= soft; ++i) T[i] *= between(0.6, 1.0);
        break;
      default:  // the vertex at z = 0 is colder than the others
        T[heat.interface] *= 0.9;
    }
    return T;
  }

 private:
  std::mt19937_64 random_{20};
};

TEST(PhysicsHeatReach, TheBitsAreThoseOfSweepsFromEndToEnd) {
  const ModelOptions o = paper_options();
  Draw draw;
  int cases = 0, tails = 0;
  for (int operators = 0; operators < 1500; ++operators) {
    const HeatOperator heat(draw.grid(), o.soft, o.hard, draw.decades(-14.0, -2.0));
    const int n = static_cast<int>(heat.outward.size());
    for (int tiles = 0; tiles < 20; ++tiles) {
      std::vector<double> old(static_cast<std::size_t>(n) * kLanes);
      for (int l = 0; l < kLanes; ++l) {
        const std::vector<double> lane = draw.profile(heat);
        for (int i = 0; i < n; ++i) old[i * kLanes + l] = lane[i];
      }
      std::vector<double> tile(old.size(), kNan), in_place = old, lane_by_lane = old;
      conduct(heat, n, old.data(), tile.data());
      conduct(heat, n, in_place.data(), in_place.data());
      for (int l = 0; l < kLanes; ++l, ++cases) {
        conduct_lane(heat, n, l, lane_by_lane.data());
        const std::vector<double> expected = swept_from_end_to_end(heat, lane_of(old, l));
        ASSERT_EQ(bits(lane_of(tile, l)), bits(expected)) << "operator " << operators << ", lane " << l;
        tails += expected.back() == old[l + (n - 1) * kLanes] && expected[heat.interface] != expected.back();
      }
      ASSERT_EQ(bits(in_place), bits(tile));
      ASSERT_EQ(bits(lane_by_lane), bits(tile));
    }
  }
  std::printf("%d lanes, of which %d are heated and keep their far temperature to the last bit\n", cases, tails);
  EXPECT_GT(tails, cases / 10);
}

// The outermost vertex of each body that heat has reached: in at least one lane its temperature differs from that at
// the far end of the body.
struct Reach {
  int hard, soft;
};

Reach reach_of(const std::vector<double>& tile, int interface) {
  const int n = static_cast<int>(tile.size()) / kLanes;
  const auto differs = [&](int i, int end) {
    return !std::equal(&tile[i * kLanes], &tile[i * kLanes] + kLanes, &tile[end * kLanes]);
  };
  Reach reach{0, n - 1};
  while (reach.hard < interface && !differs(reach.hard, 0)) ++reach.hard;
  while (reach.soft > interface && !differs(reach.soft, n - 1)) --reach.soft;
  return reach;
}

// Sets to NaN the factors of an operator that `conduct` must not read. It may read elimination factors only of vertices
// that heat had reached before the step (`heated`). It may read substitution factors only of vertices that heat reaches
// in the step (`felt`) and of one more on each side. The `spare_` arguments are the numbers of further vertices of the
// soft body whose factors also become NaN, to show that `conduct` does read these.
void forget(HeatOperator& heat, const Reach& heated, const Reach& felt, int spare_eliminated, int spare_substituted) {
  const int n = static_cast<int>(heat.outward.size());
  for (int i = 0; i < n; ++i) {
    if (i > heated.soft - spare_eliminated || i < heated.hard) heat.inverse_pivot[i] = heat.inward[i] = kNan;
    if (i > felt.soft + 1 - spare_substituted || i < felt.hard - 1) heat.outward[i] = kNan;
  }
}

TEST(PhysicsHeatReach, WhereNoHeatHasArrivedNothingIsComputed) {
  ModelOptions uniform = paper_options();
  uniform.grid.far_boundary = FarBoundary::kHalfSpace;
  const ModelOptions both = two_sided(graded(uniform));
  std::printf("vertices swept, 1 ns a step, after steps:\n");
  for (const ModelOptions& options : {uniform, graded(uniform), both}) {
    Rig rig(options);
    const HeatGrid& grid = rig.heat_grid();
    const int n = grid.num_vertices();
    const HeatOperator heat(grid, options.soft, options.hard, 1e-9);
    std::vector<double> T(static_cast<std::size_t>(n) * kLanes);
    for (std::size_t i = 0; i < T.size(); ++i) T[i] = 290.0 + 1.7 * static_cast<double>(i % kLanes);
    double flux[kLanes];
    for (int l = 0; l < kLanes; ++l) flux[l] = l == 3 ? 0.0 : 1e10 + 1e8 * l;
    for (int step = 0; step <= 1000; ++step) {
      std::vector<double> after(T.size());
      conduct(heat, n, T.data(), after.data());
      const Reach heated = reach_of(T, heat.interface), felt = reach_of(after, heat.interface);
      if (step == 0 || step == 1 || step == 10 || step == 100 || step == 1000) {
        std::printf("  %4d: %3d and %3d of %3d\n", step, heated.soft - heated.hard, felt.soft - felt.hard, n);
        ASSERT_LT(felt.soft, n - 1);
        std::vector<double> again(T.size());
        HeatOperator least(grid, options.soft, options.hard, 1e-9);
        forget(least, heated, felt, 0, 0);
        conduct(least, n, T.data(), again.data());
        ASSERT_EQ(bits(again), bits(after)) << "step " << step;
        // If the factors of one more vertex are missing, in the elimination or in the substitution, the result of
        // `conduct` changes.
        for (int spared = 0; spared < 2 && step > 0; ++spared) {
          HeatOperator too_little(grid, options.soft, options.hard, 1e-9);
          forget(too_little, heated, felt, spared, 1 - spared);
          conduct(too_little, n, T.data(), again.data());
          ASSERT_NE(bits(again), bits(after)) << "step " << step;
        }
      }
      T = after;
      add_flux(heat, n, flux, T.data());
    }
  }
}

// The model creates heat operators of shorter steps on first use, here by two threads at once. They must equal
// operators that were made directly for the shorter dt.
TEST(PhysicsHeatReach, OperatorsOfShorterStepsAreThoseOfTheirLength) {
  ModelOptions profile = graded(paper_options(Strategy::kForceDriven)), modes = profile;
  modes.modes = {.accuracy = 1e-4, .shortest_step = 1e-9, .longest_time = 1e-6};
  const Model with_profile(profile), with_modes(modes);
  const auto of_profile = with_profile.operators(1e-9), of_modes = with_modes.operators(1e-9);
  ASSERT_EQ(of_profile->max_halvings(), 6);
  ASSERT_EQ(of_modes->max_halvings(), 6);
  const auto ask = [&] {
    for (int k = 1; k <= 6; ++k) {
      const double dt = std::ldexp(1e-9, -k);
      const HeatOperator heat(Rig(profile).heat_grid(), profile.soft, dt);
      EXPECT_TRUE(std::ranges::equal(of_profile->heat(k).outward, heat.outward)) << k;
      EXPECT_TRUE(std::ranges::equal(of_profile->heat(k).response, heat.response)) << k;
      const ModeOperator own(HeatModes(HeatKernel(modes.soft, modes.grid), *modes.modes), dt);
      EXPECT_EQ(of_modes->modes(k).decay, own.decay) << k;
      EXPECT_EQ(of_modes->modes(k).gain, own.gain) << k;
      EXPECT_EQ(of_modes->modes(k).response, own.response) << k;
    }
  };
  std::thread other(ask);
  ask();
  other.join();
}

}  // namespace
}  // namespace shearbus::testing
