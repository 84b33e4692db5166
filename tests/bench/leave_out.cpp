// shearbus-bench-leave-out measures how much time is saved by leaving out options. The hydrocode problem
// cone_al_steel_hot with zones of 0.5 mm runs once, and the inputs of its layers are recorded. The model alone then
// replays them with these variants:
//
//   everything      the variant `scene` with more options, none of which changes a bit of the answer: junctions that
//                   cover the whole area and do not harden, a second direction without slip, the energy ledger
//   scene           the scene of the cone, with a temperature profile by backward Euler instead of modes
//   sleep           the same as `scene`, with the option that nodes at rest sleep
//   plastic layer   the scene with a layer that flows, without and with sleep; its inputs are from a run of its own
//
// The nodes of a cone seldom stick for long. A tile whose nodes have slid and now stick under a constant far stress is
// therefore timed separately.
//
// Each step of each tile is timed in kRuns runs. The times listed are sums of the shortest times. The time to prepare a
// new step length is listed separately, because nearly all steps of a cone have different lengths. Interface
// temperature T0 and stress s are compared with those of the first variant of each table.
#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <limits>
#include <string>
#include <utility>
#include <vector>

#include "hydro_stub/cone_target.hpp"
#include "hydro_stub/history.hpp"
#include "hydro_stub/scene.hpp"
#include "hydro_stub/subgrid_law.hpp"
#include "proto/scene/scene.hpp"
#include "server/service/scene_model.hpp"
#include "shearbus_places.hpp"

namespace {

using namespace shearbus;
using physics::kLanes;
using Clock = std::chrono::steady_clock;

constexpr int kRuns = 15;

// An interface law that passes its calls to another law and records the inputs of the host's steps.
class Recorder : public hydro::InterfaceLaw {
 public:
  explicit Recorder(hydro::InterfaceLaw& law) : law_(law) {}
  void advance(const hydro::InterfaceInputs& inputs, hydro::InterfaceAnswer& answer) override {
    asked.push_back(inputs);
    law_.advance(inputs, answer);
  }
  void take_back() override {
    asked.pop_back();
    law_.take_back();
  }
  hydro::LawTime time_spent() const override { return law_.time_spent(); }

  std::vector<hydro::InterfaceInputs> asked;

 private:
  hydro::InterfaceLaw& law_;
};

struct Replayed {
  std::size_t state_doubles = 0;  // number of doubles in the state of a node
  double layers_s = 0.0, step_lengths_s = 0.0;
  // shares of the node-steps: `asleep`: the node sleeps; `stuck`: the node sleeps and its closed contact sticks
  double asleep = 0.0, stuck = 0.0;
  std::vector<double> temperature, stress;  // interface temperature T0 [K] and stress s [Pa], one value per node-step
};

double since(Clock::time_point start) {
  return std::chrono::duration<double>(Clock::now() - start).count();
}

Replayed replay(const std::vector<hydro::InterfaceInputs>& asked, const physics::ModelOptions& options, bool ledger) {
  const physics::Model model(options);
  const std::size_t doubles = model.layout().doubles;
  const std::size_t nodes = asked.front().pressure.size();
  const std::size_t tiles = (nodes + kLanes - 1) / kLanes;
  constexpr double kNever = std::numeric_limits<double>::infinity();
  std::vector<double> step_length(asked.size(), kNever), layers(asked.size() * tiles, kNever);
  Replayed found{.state_doubles = doubles / kLanes};
  std::vector<double> before(tiles * doubles), after(tiles * doubles);
  for (int run = 0; run < kRuns; ++run) {
    double temperature[kLanes];
    std::fill_n(temperature, kLanes, options.initial_temperature);
    for (std::size_t tile = 0; tile < tiles; ++tile) model.initialise(&before[tile * doubles], temperature);
    std::size_t asleep = 0, stuck = 0;
    found.temperature.clear();
    found.stress.clear();
    for (std::size_t step = 0; step < asked.size(); ++step) {
      const hydro::InterfaceInputs& in = asked[step];
      const Clock::time_point made = Clock::now();
      const auto operators = model.operators(in.dt);
      step_length[step] = std::min(step_length[step], since(made));
      for (std::size_t tile = 0; tile < tiles; ++tile) {
        const Clock::time_point started = Clock::now();
        physics::TileInputs inputs;
        for (std::size_t l = 0; l < kLanes && tile * kLanes + l < nodes; ++l) {
          const std::size_t i = tile * kLanes + l;
          inputs.active |= 1U << l;
          inputs.velocity_jump[l] = in.velocity_jump[i];
          inputs.pressure[l] = in.pressure[i];
          inputs.stress_soft[l] = in.stress_soft[i];
          inputs.stress_hard[l] = in.stress_hard[i];
          inputs.mass_soft[l] = in.mass_soft[i];
          inputs.mass_hard[l] = in.mass_hard[i];
        }
        const double* old = &before[tile * doubles];
        double* now = &after[tile * doubles];
        physics::TileOutputs outputs;
        physics::TileLedger energy;
        model.advance(*operators, inputs, old, now, outputs);
        if (ledger) model.record_energy(*operators, inputs, outputs, old, now, energy);
        double& shortest = layers[step * tiles + tile];
        shortest = std::min(shortest, since(started));
        for (std::size_t l = 0; l < kLanes && tile * kLanes + l < nodes; ++l) {
          const bool sleeps = (outputs.outcome[l] & physics::kAsleep) != 0;
          asleep += sleeps;
          stuck += sleeps && outputs.regime[l] == physics::Regime::kStick;
          found.temperature.push_back(outputs.interface_temperature[l]);
          found.stress.push_back(outputs.shear_stress[l]);
        }
      }
      before.swap(after);
    }
    found.asleep = static_cast<double>(asleep) / static_cast<double>(found.stress.size());
    found.stuck = static_cast<double>(stuck) / static_cast<double>(found.stress.size());
  }
  for (const double t : step_length) found.step_lengths_s += t;
  for (const double t : layers) found.layers_s += t;
  return found;
}

double apart(const std::vector<double>& a, const std::vector<double>& b) {
  double most = 0.0;
  for (std::size_t i = 0; i < a.size(); ++i) most = std::max(most, std::abs(a[i] - b[i]));
  return most;
}

// Runs the cone problem of a scene and returns the inputs of its layers in all steps.
std::vector<hydro::InterfaceInputs> recorded(const guest::HydroScene& scene) {
  const hydro::ConeTarget cone = hydro::make_cone_target(scene);
  lagrange::Bodies bodies = hydro::make_bodies(cone);
  const std::size_t nodes = hydro::interface_nodes(bodies);
  hydro::SubgridLaw law({scene::to_toml(scene.scene()), "scene"}, hydro::node_ids(nodes),
                        std::vector<double>(nodes, scene.scene().layer().initial_temperature_k()));
  Recorder recorder(law);
  lagrange::Cycle cycle(std::move(bodies), &recorder);
  cycle.run_to(cone.end_time);
  law.close();
  return std::move(recorder.asked);
}

struct Variant {
  const char* name;
  v1::Scene scene;
  bool ledger;
};

// Prints a table of variants; each variant is compared with the first.
void print_table(const std::vector<hydro::InterfaceInputs>& asked, const std::vector<Variant>& variants) {
  std::printf("%zu nodes, %zu steps\n%-24s %10s %10s %12s %9s %9s %12s %12s\n", asked.front().pressure.size(),
              asked.size(), "", "B of state", "layers ms", "lengths ms", "asleep %", "stuck %", "T0 apart K",
              "s apart Pa");
  Replayed first;
  for (const Variant& variant : variants) {
    Replayed found = replay(asked, service::scene_model(variant.scene).options, variant.ledger);
    if (first.stress.empty()) first = found;
    std::printf("%-24s %10zu %10.2f %12.2f %9.1f %9.1f %12.1e %12.1e\n", variant.name, 16 * found.state_doubles,
                1e3 * found.layers_s, 1e3 * found.step_lengths_s, 100.0 * found.asleep, 100.0 * found.stuck,
                apart(found.temperature, first.temperature), apart(found.stress, first.stress));
  }
}

// Returns the time per node-step [us] of a tile whose nodes have slid and are now stuck: the shortest of kRuns runs.
double stuck_tile(const physics::ModelOptions& options) {
  constexpr int kSlides = 100, kLoads = 20, kSettles = 100, kTimed = 200;
  constexpr double kStep = 2e-9, kPull = 20e6;
  const physics::Model model(options);
  const auto operators = model.operators(kStep);
  std::vector<double> before(model.layout().doubles), after(before.size());
  double shortest = std::numeric_limits<double>::infinity();
  for (int run = 0; run < kRuns; ++run) {
    double temperature[kLanes];
    std::fill_n(temperature, kLanes, options.initial_temperature);
    model.initialise(before.data(), temperature);
    physics::TileInputs inputs;
    inputs.active = (1U << kLanes) - 1;
    physics::TileOutputs outputs;
    Clock::time_point started;
    for (int n = 0; n < kSlides + kSettles + kTimed; ++n) {
      if (n == kSlides + kSettles) started = Clock::now();
      for (int l = 0; l < kLanes; ++l) {
        inputs.velocity_jump[l] = n < kSlides ? 60.0 + l : n < kSlides + kLoads ? 1.0 : 0.0;
        // In the first step after the sliding the contact is open, which sets the interface stress to 0.
        inputs.pressure[l] = n == kSlides ? -1.0 : 5e9;
        inputs.mass_soft[l] = inputs.mass_hard[l] = 1.0;
        inputs.stress_soft[l] = inputs.stress_hard[l] = kPull;
      }
      model.advance(*operators, inputs, before.data(), after.data(), outputs);
      before.swap(after);
    }
    shortest = std::min(shortest, since(started) / (kTimed * kLanes));
  }
  return 1e6 * shortest;
}

}  // namespace

int main(int argc, char** argv) {
  guest::HydroScene file =
      hydro::load_scene(argc > 1 ? argv[1] : SHEARBUS_SOURCE_DIR "/hydro_stub/problems/cone_al_steel_hot.toml").scene;
  if (argc <= 1) file.mutable_hydro()->mutable_cone_target()->set_zone_width_m(0.5e-3);
  v1::Scene& scene = *file.mutable_scene();
  if (scene.layer().heat() == v1::HEAT_MODES) {
    v1::Layer& layer = *scene.mutable_layer();
    layer.Clear();
    layer.set_thickness_m(100e-6);
    layer.set_cells(80);
    layer.set_grading(1.06);
    layer.set_far_boundary(v1::FAR_BOUNDARY_HALF_SPACE);
    scene::fill_defaults(scene);
  }
  v1::Scene everything = scene, sleep = scene;
  everything.mutable_junctions()->set_contact_fraction(1.0);
  everything.mutable_junctions()->set_height_m(1e-6);
  everything.mutable_junctions()->set_hardening_coefficient(0.0);
  everything.set_tangential_components(2);
  sleep.mutable_layer()->set_sleep(true);
  print_table(recorded(file), {{"scene", scene, false},
                               {"everything", everything, true},
                               {"scene, with the ledger", scene, true},
                               {"sleep", sleep, false},
                               {"sleep, with the ledger", sleep, true}});
  scene.mutable_interface()->set_plastic_layer(true);
  sleep.mutable_interface()->set_plastic_layer(true);
  print_table(recorded(file), {{"plastic layer", scene, false}, {"plastic layer, sleep", sleep, false}});

  std::printf("stuck, in us per node-step        solved     asleep\n");
  physics::ModelOptions plastic = service::scene_model(scene).options, driven = plastic;
  driven.strategy = physics::Strategy::kVelocityDriven;
  driven.plastic_layer = false;
  for (const auto& [name, layer] : {std::pair{"plastic layer", plastic}, std::pair{"velocity-driven", driven}}) {
    physics::ModelOptions asleep = layer;
    asleep.sleep = true;
    std::printf("%-28s %11.2f %10.2f\n", name, stuck_tile(layer), stuck_tile(asleep));
  }
  return 0;
}
