#include "tests/campaign/random_pairs.hpp"

#include <bit>
#include <iterator>
#include <memory>
#include <numeric>
#include <optional>
#include <span>
#include <utility>
#include <vector>

#include "server/shard/shard.hpp"
#include "tests/campaign/random_scenes.hpp"
#include "tests/support/invariants/linearised.hpp"
#include "tests/support/random_history.hpp"

namespace shearbus::study::stability {

using namespace shearbus::testing;  // NOLINT(google-build-using-namespace): rigs, draws of tests/support

namespace {

using Inputs = double (TileInputs::*)[kLanes];
using Outputs = double (TileOutputs::*)[kLanes];

constexpr Inputs kInputs[] = {&TileInputs::velocity_jump,
                              &TileInputs::pressure,
                              &TileInputs::soft_shear_rate,
                              &TileInputs::stress_soft,
                              &TileInputs::stress_hard,
                              &TileInputs::mass_soft,
                              &TileInputs::mass_hard,
                              &TileInputs::soft_plastic_strain_rate,
                              &TileInputs::second_velocity_jump,
                              &TileInputs::second_stress_soft,
                              &TileInputs::second_stress_hard,
                              &TileInputs::second_soft_plastic_strain_rate};
constexpr Outputs kOutputs[] = {&TileOutputs::shear_stress,          &TileOutputs::sliding_velocity,
                                &TileOutputs::interface_temperature, &TileOutputs::velocity_jump_new,
                                &TileOutputs::friction_heat,         &TileOutputs::time_to_melting};
constexpr Outputs kTangents[] = {&TileOutputs::stress_per_jump, &TileOutputs::stress_per_pressure};

// The nodes of a shard, and the same nodes in tiles of one pair each.
class Twins {
 public:
  Twins(Draw& draw, const ModelOptions& first) {
    options_ = {first};
    for (int more = draw.integer(1, 3); more > 0; --more) options_.push_back(another_pair(draw, first));
    std::vector<std::uint32_t> of_node(static_cast<std::size_t>(draw.integer(4, 20)));
    std::vector<double> temperature;
    for (std::uint32_t& pair : of_node) {
      pair = static_cast<std::uint32_t>(draw.integer(0, static_cast<int>(options_.size()) - 1));
      place(pair);
      temperature.push_back(options_[pair].initial_temperature);
    }
    std::vector<std::uint64_t> ids(of_node.size());
    std::iota(ids.begin(), ids.end(), 1);
    std::vector<shard::Pair> pairs;
    for (std::size_t p = 0; p < options_.size(); ++p)
      pairs.push_back({std::make_shared<const Model>(options_[p]), {static_cast<double>(p)}});
    const shard::PairsOfNodes of_nodes{.pairs = pairs, .of_node = of_node};
    together_.emplace(shard::PairTable({{"pair", "1"}}, std::move(pairs)), pool_);
    together_->apply(together_->adding(ids, temperature, nullptr, &of_nodes));
  }

  void step(Draw& draw, bool extreme, int step, RandomOutcome& outcome) {
    const double dt = std::max(random_dt(draw, extreme), shortest_step(options_.front()));
    for (Tile& tile : tiles_) {
      random_step(draw, *tile.rig, extreme, step, tile.phase);
      SearchEffort effort;
      tile.rig->inputs.effort = &effort;
      tile.rig->step(dt);
      tile.rig->inputs.effort = nullptr;
      if (tile.awake) tile.awake->repeat(*tile.rig, dt, outcome.slept);
      require_effort(effort, *tile.rig);
      take_most(outcome.most, effort);
      tile.tangents = linearised(*tile.rig);
      for (int lane = 0; lane < tile.nodes; ++lane) {
        require_linearised(*tile.rig, tile.tangents, lane);
        require_invariants(*tile.rig, lane, dt, outcome.figures);
      }
    }
    compare(dt);
  }

 private:
  // Nodes of one pair, in one tile.
  struct Tile {
    std::uint32_t pair;
    int nodes = 0;
    std::unique_ptr<Rig> rig;
    std::unique_ptr<AwakeTwin> awake;  // null: the scene has no sleep
    Phase phase{};
    TileOutputs tangents{};
  };
  struct Place {
    std::size_t tile;
    int lane;
  };

  void place(std::uint32_t pair) {
    std::size_t t = 0;
    while (t < tiles_.size() && (tiles_[t].pair != pair || tiles_[t].nodes == kLanes)) ++t;
    if (t == tiles_.size()) {
      tiles_.push_back({.pair = pair, .rig = std::make_unique<Rig>(options_[pair], 0)});
      if (options_[pair].sleep && options_[pair].time_integrator == TimeIntegrator::kBackwardEuler &&
          !options_[pair].tolerance)
        tiles_[t].awake = std::make_unique<AwakeTwin>(options_[pair]);
    }
    Tile& tile = tiles_[t];
    places_.push_back({t, tile.nodes++});
    tile.rig->inputs.active = (1U << tile.nodes) - 1;
  }

  template <class Member, class Values>
  std::vector<double> gathered(Member member, const Values& values_of) const {
    std::vector<double> all;
    for (const Place& at : places_) all.push_back((values_of(tiles_[at.tile]).*member)[at.lane]);
    return all;
  }

  void compare(double dt) {
    shard::StepColumns columns;
    std::vector<std::vector<double>> sent, found;
    for (const Inputs member : kInputs)
      sent.push_back(gathered(
          member, [](const Tile& tile) -> auto& { return tile.rig->inputs; }));
    for (std::size_t i = 0; i < sent.size(); ++i) columns.inputs.push_back({kInputs[i], sent[i]});
    std::vector<Outputs> wanted(std::begin(kOutputs), std::end(kOutputs));
    columns.wants_time_to_melting = true;
    columns.wants_tangent = Model::can_linearise(options_.front());
    if (columns.wants_tangent) wanted.insert(wanted.end(), std::begin(kTangents), std::end(kTangents));
    found.assign(wanted.size(), std::vector<double>(places_.size()));
    for (std::size_t i = 0; i < wanted.size(); ++i)
      columns.outputs.emplace_back(shard::AnswerColumn{wanted[i], std::span(found[i])});
    shard::Rows rows;
    rows.all = true;
    together_->step(rows, *together_->operators(dt), columns);
    together_->commit();
    for (std::size_t i = 0; i < wanted.size(); ++i) {
      const auto alone = gathered(
          wanted[i], [](const Tile& tile) -> auto& { return tile.tangents; });
      for (std::size_t node = 0; node < alone.size(); ++node)
        require(std::bit_cast<std::uint64_t>(alone[node]) == std::bit_cast<std::uint64_t>(found[i][node]),
                "node {} of pair {}, output {}: {:.17g} among other pairs, {:.17g} alone", node,
                tiles_[places_[node].tile].pair, i, found[i][node], alone[node]);
    }
  }

  std::vector<ModelOptions> options_;
  std::vector<Tile> tiles_;
  std::vector<Place> places_;  // of each node
  shard::TaskPool pool_{1};
  std::optional<shard::Shard> together_;
};

}  // namespace

void run_pairs(Draw& draw, const ModelOptions& first, bool extreme, int steps, RandomOutcome& outcome) {
  Twins twins(draw, first);
  for (int step = 0; step < steps; ++step) {
    try {
      twins.step(draw, extreme, step, outcome);
    } catch (const Broken& broken) {
      throw Broken(fmt::format("step {}: {}", step, broken.what()));
    }
  }
}

}  // namespace shearbus::study::stability
