#include "server/explain.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <ctime>
#include <functional>
#include <limits>
#include <optional>
#include <utility>

#include "proto/wire/status.hpp"
#include "proto/wire/columns.hpp"
#include "server/service/scene_model.hpp"
#include "server/shard/shard.hpp"

namespace shearbus::server {
namespace {

using Clock = std::chrono::steady_clock;
using physics::kLanes;

constexpr double kStep = 1e-9;       // [s]
constexpr double kJump = 100.0;      // [m/s]
constexpr double kPressure = 5e9;    // [Pa]
constexpr double kHalfZone = 10e-6;  // of the host's mesh  [m]
constexpr int kSteps = 60;
constexpr int kRepeats = 5;
constexpr std::chrono::milliseconds kLongest{40};  // of one measurement

// A part as a change of the scene; `set` is called with what the scene shall be.
struct Switch {
  const char* name;
  const char* meaning;
  bool (*is_on)(const wire::Scene&);
  void (*set)(wire::Scene&, bool);
};

constexpr std::array kSwitches = {
    Switch{"hard_layer", "the hard body conducts on a grid of its own, in place of a fixed share of the heat",
           [](const wire::Scene& s) { return s.hard_layer.has_value(); },
           [](wire::Scene& s, bool on) {
             if (on)
               s.hard_layer.emplace();
             else
               s.hard_layer.reset();
           }},
    Switch{"interface.plastic_layer", "the layer flows and hardens beside the slip",
           [](const wire::Scene& s) { return s.interface && s.interface->plastic_layer; },
           [](wire::Scene& s, bool on) {
             if (s.interface) s.interface->plastic_layer = on;
           }},
    Switch{"junctions", "contact on a part of the area, which hardens with the slip",
           [](const wire::Scene& s) { return s.junctions.has_value(); },
           [](wire::Scene& s, bool on) {
             s.junctions.reset();
             if (on) s.junctions = wire::Junctions{.contact_fraction = 0.5, .height_m = 1e-6};
           }},
    Switch{"velocity_driven.taylor_quinney_factor", "plastic work heats the layer where it flows",
           [](const wire::Scene& s) { return s.velocity_driven.taylor_quinney_factor.has_value(); },
           [](wire::Scene& s, bool on) {
             s.velocity_driven.taylor_quinney_factor = on ? std::optional(1.0) : std::nullopt;
           }},
    Switch{"layer.inertia", "shear waves cross the layer", [](const wire::Scene& s) { return s.layer.inertia; },
           [](wire::Scene& s, bool on) { s.layer.inertia = on; }},
    Switch{"tangential_components", "slip and stress have a second direction",
           [](const wire::Scene& s) { return s.tangential_components == 2; },
           [](wire::Scene& s, bool on) { s.tangential_components = on ? 2 : 1; }},
    Switch{"soft.melting_curve", "melting follows the pressure",
           [](const wire::Scene& s) { return s.soft.melting_curve == wire::MeltingCurve::kLindemann; },
           [](wire::Scene& s, bool on) {
             s.soft.melting_curve = on ? wire::MeltingCurve::kLindemann : wire::MeltingCurve::kConstant;
           }},
    Switch{"layer.heat = \"profile\"", "the temperature across the layer, not of the interface alone",
           [](const wire::Scene& s) { return s.layer.heat == wire::Heat::kProfile; },
           [](wire::Scene& s, bool on) {
             s.layer.heat = on ? wire::Heat::kProfile : wire::Heat::kModes;
             if (on) s.layer.modes.reset();
           }},
    Switch{"layer.sleep", "nodes at rest are not solved", [](const wire::Scene& s) { return s.layer.sleep; },
           [](wire::Scene& s, bool on) { s.layer.sleep = on; }},
};
constexpr const char* kLedger = "energy ledger";

// One tile of a model, stepped as a host would.
class Bench {
 public:
  explicit Bench(const physics::ModelOptions& options) : model_(options) {
    states_[0].resize(model_.layout().doubles);
    states_[1].resize(model_.layout().doubles);
    inputs_.active = (1U << kLanes) - 1;
    for (int l = 0; l < kLanes; ++l) {
      inputs_.mass_soft[l] = options.soft.density * kHalfZone;
      inputs_.mass_hard[l] = options.hard.density * kHalfZone;
    }
    operators_ = model_.operators(kStep);
    begin();
  }

  // Seconds per node-step, the best of some runs: others use this machine too.
  double slipping(bool ledger) {
    return best([&] { begin(); }, [&] { step(kPressure, ledger); });
  }
  double resting() {
    begin();
    for (int n = 0; n < kSteps; ++n) step(kPressure, false);
    for (int n = 0; n < 2 * kSteps + static_cast<int>(model_.layout().num_vertices); ++n) step(-1.0, false);
    return best([] {}, [&] { step(-1.0, false); });
  }
  double step_length() {
    double shortest = std::numeric_limits<double>::infinity();
    for (int n = 0; n < kRepeats; ++n) {
      const double start = cpu_s();
      const auto made = model_.operators(kStep * (1.0 + 1e-6 * n));
      shortest = std::min(shortest, cpu_s() - start);
    }
    return shortest;
  }

 private:
  // Of this thread: whoever else uses the machine does not count.
  static double cpu_s() {
    timespec now{};
    ::clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now);
    return static_cast<double>(now.tv_sec) + 1e-9 * static_cast<double>(now.tv_nsec);
  }

  void begin() {
    double temperature[kLanes];
    std::fill_n(temperature, kLanes, model_.options().initial_temperature);
    model_.initialise(states_[0].data(), temperature);
  }
  void step(double pressure, bool ledger) {
    for (int l = 0; l < kLanes; ++l) {
      inputs_.velocity_jump[l] = kJump + l;  // lanes differ a little, as nodes of one interface do
      inputs_.pressure[l] = pressure;
    }
    model_.advance(*operators_, inputs_, states_[0].data(), states_[1].data(), outputs_);
    if (ledger) {
      physics::TileLedger energy;
      model_.record_energy(*operators_, inputs_, outputs_, states_[0].data(), states_[1].data(), energy);
    }
    states_[0].swap(states_[1]);
  }
  double best(const std::function<void()>& prepare, const std::function<void()>& one_step) {
    double shortest = std::numeric_limits<double>::infinity();
    const Clock::time_point begun = Clock::now();
    for (int run = 0; run < kRepeats && (run == 0 || Clock::now() - begun < kLongest); ++run) {
      prepare();
      const double start = cpu_s();
      int n = 0;
      do {
        one_step();
        ++n;
      } while (n < kSteps && Clock::now() - begun < kLongest);
      shortest = std::min(shortest, (cpu_s() - start) / (n * kLanes));
    }
    return shortest;
  }

  physics::Model model_;
  std::shared_ptr<const physics::StepOperators> operators_;
  physics::TileInputs inputs_;
  physics::TileOutputs outputs_{};
  std::vector<double> states_[2];
};

std::uint64_t bytes_per_node(const wire::Scene& scene, const physics::ModelOptions& options, bool ledger) {
  std::uint64_t bytes = shard::Shard::bytes_per_node(physics::Model(options));
  for (const wire::Field field : wire::columns_of(scene.strategy).reply)
    bytes += wire::size_of(wire::element_of(field));
  if (ledger) bytes += wire::kLedgerColumns.size() * sizeof(double);
  return bytes;
}

SceneCost cost_of(const wire::Scene& scene, const physics::ModelOptions& options, bool ledger) {
  Bench bench(options);
  return {.bytes_per_node = bytes_per_node(scene, options, ledger),
          .slipping_s = bench.slipping(ledger),
          .resting_s = bench.resting(),
          .step_length_s = bench.step_length()};
}

// The model of a scene, or why there is none.
struct Tried {
  std::optional<physics::ModelOptions> options;
  std::string refused;
};
Tried tried(const wire::Scene& scene) {
  try {
    return {service::scene_model(scene).options, {}};
  } catch (const wire::Error& error) {
    const std::string& text = error.status().text;  // the first of its reasons
    return {std::nullopt, text.substr(0, text.find('\n'))};
  }
}

// The scene with every part that goes together with those before it, in the order of kSwitches, and their names.
// Without sleep, which adds no physics.
struct FullScene {
  wire::Scene scene;
  std::vector<std::string> parts;
};
FullScene with_everything(const wire::Scene& scene) {
  FullScene full{.scene = scene, .parts = {}};
  full.scene.layer.sleep = false;
  for (const Switch& part : kSwitches) {
    if (part.name == std::string_view("layer.sleep")) continue;
    wire::Scene more = full.scene;
    part.set(more, true);
    if (!part.is_on(more) || !tried(more).options) continue;
    full.scene = std::move(more);
    full.parts.emplace_back(part.name);
  }
  return full;
}

std::string microseconds(double seconds) {
  return fmt::format("{:.2f} µs", 1e6 * seconds);
}

}  // namespace

Explanation explain(const wire::Scene& scene) {
  const service::SceneModel made = service::scene_model(scene);
  Explanation told{
      .scene = scene.name, .cost = cost_of(scene, made.options, false), .parts = {}, .everything = {}, .together = {}};

  // 1. Each part switched the other way, alone.
  for (const Switch& part : kSwitches) {
    ScenePart found{.name = part.name, .on = part.is_on(scene), .meaning = part.meaning};
    wire::Scene other = scene;
    part.set(other, !found.on);
    if (const Tried model = tried(other); !model.options) {
      found.excluded = model.refused;
    } else {
      const double sign = found.on ? 1.0 : -1.0;
      const auto here = static_cast<std::int64_t>(told.cost.bytes_per_node);
      const auto there = static_cast<std::int64_t>(bytes_per_node(other, *model.options, false));
      found.bytes_per_node = found.on ? here - there : there - here;
      found.slipping_s = sign * (told.cost.slipping_s - Bench(*model.options).slipping(false));
    }
    told.parts.push_back(std::move(found));
  }
  told.parts.push_back({.name = kLedger,
                        .meaning = "where the energy of each node's step went, for requests that name its columns",
                        .bytes_per_node = static_cast<std::int64_t>(wire::kLedgerColumns.size() * sizeof(double)),
                        .slipping_s = Bench(made.options).slipping(true) - told.cost.slipping_s});

  // 2. Everything that goes together.
  auto [all, names] = with_everything(scene);
  told.together = std::move(names);
  told.together.emplace_back(kLedger);
  told.everything = cost_of(all, *tried(all).options, true);
  return told;
}

std::string Explanation::text(std::size_t nodes) const {
  std::string out = fmt::format("{}: what it pays for\n", scene);
  for (const bool on : {true, false}) {
    for (const ScenePart& part : parts) {
      if (part.on != on) continue;
      out += fmt::format("  {:<4}{:<40}", on ? "on" : "off", part.name);
      if (!part.excluded.empty() && !on) {
        out += fmt::format("not in this scene: {}\n", part.excluded);
        continue;
      }
      if (part.excluded.empty())
        out += fmt::format("{} {:+} B per node, {:+.2f} µs per slipping node-step: ", on ? "takes" : "would take",
                           part.bytes_per_node, 1e6 * part.slipping_s);
      out += part.meaning + "\n";
    }
  }
  out += fmt::format("  memory              {} B per node; with everything on {} B\n", cost.bytes_per_node,
                     everything.bytes_per_node);
  out +=
      fmt::format("  time per node-step  {} slipping, {} open with heat in the layer; with everything on {} and {}\n",
                  microseconds(cost.slipping_s), microseconds(cost.resting_s), microseconds(everything.slipping_s),
                  microseconds(everything.resting_s));
  out += fmt::format("  a new step length   {}\n", microseconds(cost.step_length_s));
  if (nodes > 0)
    out += fmt::format("  a step of {} nodes  {} if all slip, {} if all rest; {:.1f} kB\n", nodes,
                       microseconds(static_cast<double>(nodes) * cost.slipping_s + cost.step_length_s),
                       microseconds(static_cast<double>(nodes) * cost.resting_s + cost.step_length_s),
                       1e-3 * static_cast<double>(nodes * cost.bytes_per_node));
  return out + fmt::format("  everything on       {}\n", fmt::join(together, ", "));
}

std::vector<std::pair<std::string, std::string>> OmittedCost::lines() const {
  std::vector<std::pair<std::string, std::string>> lines = {
      {"left out",
       fmt::format("{}; {} of {} B per node", parts.empty() ? "nothing" : fmt::format("{}", fmt::join(parts, ", ")),
                   bytes_per_node, bytes_per_node_with_everything)}};
  if (share_asleep)
    lines.emplace_back("asleep", fmt::format("{:.1f} % of node-steps, not solved", 100.0 * *share_asleep));
  return lines;
}

OmittedCost omitted_cost(const wire::Scene& effective, const wire::SessionClosed& totals) {
  const FullScene full = with_everything(effective);
  OmittedCost omitted{.parts = {},
                      .bytes_per_node = bytes_per_node(effective, service::scene_model(effective).options, false),
                      .bytes_per_node_with_everything = bytes_per_node(full.scene, *tried(full.scene).options, true),
                      .share_asleep = {}};
  for (const Switch& part : kSwitches)
    if (!part.is_on(effective) && std::ranges::find(full.parts, part.name) != full.parts.end())
      omitted.parts.emplace_back(part.name);
  if (effective.layer.sleep && totals.node_steps > 0)
    omitted.share_asleep = static_cast<double>(totals.asleep_node_steps) / static_cast<double>(totals.node_steps);
  return omitted;
}

}  // namespace shearbus::server
