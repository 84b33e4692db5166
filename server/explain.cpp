#include "server/explain.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <functional>
#include <limits>
#include <optional>
#include <span>
#include <utility>

#include "proto/program/program.hpp"
#include "proto/program/progress.hpp"
#include "proto/wire/columns.hpp"
#include "proto/wire/status.hpp"
#include "server/host.hpp"
#include "server/physics/material/material.hpp"
#include "server/physics/solver/parts.hpp"
#include "server/service/columns.hpp"
#include "server/service/scene_model.hpp"
#include "server/shard/shard.hpp"

namespace shearbus::server {
namespace {

using Clock = std::chrono::steady_clock;
using physics::kLanes;

constexpr double kStep = 1e-9;       // length of the measured steps  [s]
constexpr double kJump = 100.0;      // velocity jump across the interface  [m/s]
constexpr double kPressure = 5e9;    // contact pressure  [Pa]
constexpr double kHalfZone = 10e-6;  // half a zone of the host's mesh  [m]
constexpr int kSteps = 60;           // largest number of steps of one run
constexpr int kRepeats = 5;          // largest number of runs of one measurement, of which the fastest counts
constexpr std::chrono::milliseconds kLongest{40};  // longest duration of one measurement
constexpr int kRounds = 15;                        // largest number of rounds of a comparison
constexpr int kLeastRounds = 7;                    // smallest number
constexpr double kRound = 2e-3;                    // processor time of one of the two runs of a round, about  [s]
constexpr std::chrono::milliseconds kLongestComparison{200};

using physics::Property;

// Parts that add no physics, because they replace other parts or save work.
constexpr std::array kAddNothing = {Property::kInterfaceSlip, Property::kCoulombLimit, Property::kSecondOrder,
                                    Property::kModes,         Property::kSleep,        Property::kTolerance,
                                    Property::kIsothermalEnd, Property::kSimonMelting};

// What the answer of a step has only where a request names its columns.
enum class OnRequest { kNothing, kLedger, kLinearised };
constexpr const char* kLedger = "energy ledger";
constexpr const char* kFrictionEnergy = "friction_energy";
constexpr std::array kLinearisedColumns = {wire::Field::kStressPerJump, wire::Field::kStressPerPressure,
                                           wire::Field::kTimeToMelting};

// Measures the time of a model's steps: steps one tile (8 nodes that are stepped together) with inputs like a host's.
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

  // Seconds per node-step, the smallest of several runs, because other processes use the machine too.
  double slipping(OnRequest asked) {
    return best([&] { begin(); }, [&] { step(kPressure, asked); });
  }
  double resting() {
    begin();
    for (int n = 0; n < kSteps; ++n) step(kPressure, OnRequest::kNothing);
    for (int n = 0; n < 2 * kSteps + static_cast<int>(model_.layout().num_vertices); ++n)
      step(-1.0, OnRequest::kNothing);
    return best([] {}, [&] { step(-1.0, OnRequest::kNothing); });
  }
  // Seconds per node-step of a run of `steps` steps from the initial state.
  double run(int steps, OnRequest asked) {
    begin();
    const double start = cpu_s();
    for (int n = 0; n < steps; ++n) step(kPressure, asked);
    return (cpu_s() - start) / (steps * kLanes);
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
  // Processor time of this thread, which does not count other users of the machine  [s].
  static double cpu_s() { return 1e-9 * static_cast<double>(thread_cpu_ns()); }

  void begin() {
    double temperature[kLanes];
    std::fill_n(temperature, kLanes, model_.options().initial_temperature);
    model_.initialise(states_[0].data(), temperature);
  }
  void step(double pressure, OnRequest asked) {
    for (int l = 0; l < kLanes; ++l) {
      inputs_.velocity_jump[l] = kJump + l;  // lanes differ a little, as nodes of one interface do
      inputs_.pressure[l] = pressure;
    }
    model_.advance(*operators_, inputs_, states_[0].data(), states_[1].data(), outputs_);
    if (asked == OnRequest::kLedger) {
      physics::TileLedger energy;
      model_.record_energy(*operators_, inputs_, outputs_, states_[0].data(), states_[1].data(), energy);
    } else if (asked == OnRequest::kLinearised) {
      model_.linearise(*operators_, inputs_, states_[0].data(), states_[1].data(), outputs_);
      model_.predict_melting(*operators_, inputs_, states_[0].data(), outputs_);
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

// What the nodes of a scene keep or answer beside their model: the columns of the ledger in the last reply, the sums of
// the friction energy.
struct Beside {
  bool ledger = false;
  bool friction_energy = false;
};

std::uint64_t bytes_per_node(const physics::ModelOptions& options, Beside beside) {
  std::uint64_t bytes = shard::Shard::bytes_per_node({physics::Model(options), false, beside.friction_energy});
  for (const wire::Field field : wire::columns_of(service::strategy_of(options)).reply)
    bytes += wire::size_of(wire::element_of(field));
  if (beside.ledger) bytes += wire::kLedgerColumns.size() * sizeof(double);
  return bytes;
}

SceneCost cost_of(const physics::ModelOptions& options, Beside beside) {
  Bench bench(options);
  const bool ledger = beside.ledger || beside.friction_energy;
  return {.bytes_per_node = bytes_per_node(options, beside),
          .slipping_s = bench.slipping(ledger ? OnRequest::kLedger : OnRequest::kNothing),
          .resting_s = bench.resting(),
          .step_length_s = bench.step_length()};
}

// A model, and what its steps answer on request.
struct Variant {
  Bench& bench;
  OnRequest asked = OnRequest::kNothing;
};

// Returns how much longer a node-step of `other` takes than one of `base`. The two run in turns, so that what else the
// machine does meets both alike, and which of them begins alternates.
TimeDifference compare(Variant base, Variant other, double base_s) {
  const int steps = std::clamp(static_cast<int>(kRound / (base_s * kLanes)), 2, kSteps);
  const auto run = [&](Variant& variant) { return variant.bench.run(steps, variant.asked); };
  std::vector<double> differences;
  const Clock::time_point begun = Clock::now();
  for (int round = 0; round < kRounds && (round < kLeastRounds || Clock::now() - begun < kLongestComparison); ++round) {
    const bool base_first = round % 2 == 0;
    const double first = run(base_first ? base : other), second = run(base_first ? other : base);
    differences.push_back(base_first ? second - first : first - second);
  }
  return difference_of(std::move(differences));
}

// The reason why no model can be made with these options; empty if a model can be made.
std::string refusal_of(const physics::ModelOptions& options) {
  const auto refusals = physics::refusals(options);
  return refusals.empty() ? std::string() : refusals.front().text;
}

// The given options without heat modes and sleep, but with all compatible physics, and the keys of the added parts. The
// parts are tried in the order of physics::parts(); a part is added if it is compatible with the options so far.
struct FullModel {
  physics::ModelOptions options;
  std::vector<std::string> parts;
};
FullModel with_everything(const physics::ModelOptions& options) {
  FullModel full{.options = options};
  for (const Property property : {Property::kModes, Property::kSleep})
    full.options = physics::switched(full.options, physics::part_of(property), false);
  for (const physics::Part& part : physics::parts()) {
    if (part.set == nullptr || std::ranges::find(kAddNothing, part.property) != kAddNothing.end()) continue;
    const physics::ModelOptions more = physics::switched(full.options, part, true);
    if (!refusal_of(more).empty()) continue;
    full.options = more;
    full.parts.push_back(unique_key(part));
  }
  return full;
}

std::string microseconds(double seconds) {
  return fmt::format("{:.2f} µs", 1e6 * seconds);
}

// Returns the number of characters of a text in UTF-8.
std::size_t width_of(std::string_view text) {
  return static_cast<std::size_t>(std::ranges::count_if(text, [](char c) { return (c & 0xc0) != 0x80; }));
}

// Returns an indented label and its text. Where the text would pass column 100, it goes on in a new line below its
// beginning.
std::string labelled(const std::string& label, std::string_view text) {
  constexpr std::size_t kColumns = 100;
  std::string out = "  " + label;
  const std::size_t begin = width_of(out);
  std::size_t column = begin;
  while (!text.empty()) {
    const std::string_view word = text.substr(0, text.find(' '));
    text.remove_prefix(std::min(text.size(), word.size() + 1));
    if (column > begin) {
      const bool fits = column + 1 + width_of(word) <= kColumns;
      out += fits ? " " : '\n' + std::string(begin, ' ');
      column = fits ? column + 1 : begin;
    }
    out += word;
    column += width_of(word);
  }
  return out + '\n';
}

}  // namespace

// The median of many samples lies between the (k+1)th smallest and the (k+1)th largest of n samples with the probability
// 1 - 2 sum_(i<=k) C(n,i)/2^n, whatever their distribution. k is the largest number for which this is 96 % or more.
TimeDifference difference_of(std::vector<double> samples_s) {
  std::ranges::sort(samples_s);
  const std::size_t n = samples_s.size();
  double term = std::pow(0.5, static_cast<double>(n));  // C(n,k)/2^n
  double outside = term;
  std::size_t k = 0;
  while (k + 1 < n / 2) {
    term *= static_cast<double>(n - k) / static_cast<double>(k + 1);
    if (2.0 * (outside + term) > 0.04) break;
    outside += term;
    ++k;
  }
  const double median = n % 2 == 1 ? samples_s[n / 2] : 0.5 * (samples_s[n / 2 - 1] + samples_s[n / 2]);
  return {.median_s = median, .low_s = samples_s[k], .high_s = samples_s[n - 1 - k]};
}

std::string TimeDifference::text() const {
  if (!is_measured())
    return fmt::format("a time too small to measure here (below {:.2f} µs)", 1e6 * std::max(-low_s, high_s));
  const bool saves = median_s < 0.0;
  const double a = 1e6 * std::abs(saves ? high_s : low_s), b = 1e6 * std::abs(saves ? low_s : high_s);
  return fmt::format("{:.2f} µs {} ({:.2f} to {:.2f})", 1e6 * std::abs(median_s), saves ? "less" : "more", a, b);
}

Explanation explain(std::string_view scene, const std::string& file) {
  const service::SceneModel made = service::scene_model(scene, file);
  const physics::ModelOptions& options = made.options;
  const Beside here_beside{.friction_energy = made.friction_energy};
  program::complain(fmt::format(
      "{}: measuring what each part of the model takes on this machine, about half a minute of processor time", file));
  const std::size_t num_parts = physics::parts().size();
  program::Progress progress("measuring", true);
  const auto measured = [&](std::size_t parts) {
    progress.show([&](double elapsed_s) {
      return program::Extent{.fraction = static_cast<double>(parts) / static_cast<double>(num_parts),
                             .text = fmt::format("{}/{} parts", parts, num_parts),
                             .left_s = elapsed_s * static_cast<double>(num_parts - parts) /
                                       static_cast<double>(std::max<std::size_t>(parts, 1))};
    });
  };
  Explanation explanation{.scene = made.name, .cost = cost_of(options, here_beside)};
  for (const service::PairModel& pair : made.pairs) explanation.pairs.push_back(pair.name);

  Bench here_bench(options);

  // 1. Find the memory and time of each part: switch this part alone on if it is off, or off if it is on.
  for (std::size_t n = 0; n < num_parts; ++n) {
    const physics::Part& part = physics::parts()[n];
    measured(n);
    if (part.set == nullptr) continue;
    ScenePart found{.name = unique_key(part), .on = part.is_on(options), .meaning = std::string(part.adds)};
    const physics::ModelOptions other = physics::switched(options, part, !found.on);
    found.excluded = refusal_of(other);
    if (found.excluded.empty()) {
      const auto here = static_cast<std::int64_t>(explanation.cost.bytes_per_node);
      const auto there = static_cast<std::int64_t>(bytes_per_node(other, here_beside));
      found.bytes_per_node = found.on ? here - there : there - here;
      Bench there_bench(other);
      const Variant with{found.on ? here_bench : there_bench}, without{found.on ? there_bench : here_bench};
      found.slipping = compare(without, with, explanation.cost.slipping_s);
    }
    explanation.parts.push_back(std::move(found));
  }
  const auto add_on_request = [&](const char* name, const char* meaning, std::span<const wire::Field> columns,
                                  OnRequest asked) {
    explanation.parts.push_back({.name = name,
                                 .meaning = meaning,
                                 .bytes_per_node = static_cast<std::int64_t>(columns.size() * sizeof(double)),
                                 .slipping = compare({here_bench}, {here_bench, asked}, explanation.cost.slipping_s)});
  };
  add_on_request(kLedger, "where the energy of each node's step went, for requests that name its columns",
                 wire::kLedgerColumns, OnRequest::kLedger);
  ScenePart sums{.name = kFrictionEnergy,
                 .on = made.friction_energy,
                 .meaning = "the friction heat that either body has got since the node began"};
  if (service::has_ledger(options)) {
    sums.bytes_per_node =
        static_cast<std::int64_t>(bytes_per_node(options, {.friction_energy = true}) - bytes_per_node(options, {}));
    sums.slipping = compare({here_bench}, {here_bench, OnRequest::kLedger}, explanation.cost.slipping_s);
  } else {
    sums.excluded = "it sums the energy ledger, which a layer with inertia or with an isothermal face does not have";
  }
  explanation.parts.push_back(std::move(sums));
  if (physics::Model::can_linearise(options))
    add_on_request("linearised answer",
                   "derivatives of the stress by jump and pressure, and the time to melting, for requests that name "
                   "their columns",
                   kLinearisedColumns, OnRequest::kLinearised);

  // 2. Find the memory and time of the scene with all parts on that are compatible with it.
  auto [all, names] = with_everything(options);
  explanation.together = std::move(names);
  explanation.together.emplace_back(kLedger);
  const bool sums_all = service::has_ledger(all);
  if (sums_all) explanation.together.emplace_back(kFrictionEnergy);
  explanation.everything = cost_of(all, {.ledger = true, .friction_energy = sums_all});
  progress.clear();
  return explanation;
}

std::string Explanation::text(std::size_t nodes) const {
  std::string out = fmt::format("{}: what it pays for\n", scene);
  for (const bool on : {true, false}) {
    for (const ScenePart& part : parts) {
      if (part.on != on) continue;
      const std::string label = fmt::format("{:<4}{:<40}", on ? "on" : "off", part.name);
      if (!part.excluded.empty()) {
        out += labelled(label, on ? part.meaning : fmt::format("not in this scene: {}", part.excluded));
        continue;
      }
      out += labelled(label, fmt::format("{} {:+} B per node, {} per slipping node-step:", on ? "takes" : "would take",
                                         part.bytes_per_node, part.slipping.text()));
      out += labelled(std::string(label.size(), ' '), part.meaning);
    }
  }
  const auto line = [&](const char* label, const std::string& text) {
    out += labelled(fmt::format("{:<20}", label), text);
  };
  line("memory", fmt::format("{} B per node; with everything on {} B", cost.bytes_per_node, everything.bytes_per_node));
  line("time per node-step", fmt::format("{} slipping, {} open with heat in the layer; with everything on {} and {}",
                                         microseconds(cost.slipping_s), microseconds(cost.resting_s),
                                         microseconds(everything.slipping_s), microseconds(everything.resting_s)));
  if (!pairs.empty())
    line("pairs",
         fmt::format("of the tables outside [pair]; the nodes of {} are solved alike, each pair with operators "
                     "of its own for a new step length",
                     fmt::join(pairs, ", ")));
  line("a new step length", microseconds(cost.step_length_s));
  if (nodes > 0)
    out += labelled(fmt::format("a step of {} nodes  ", nodes),
                    fmt::format("{} if all slip, {} if all rest; {:.1f} kB",
                                microseconds(static_cast<double>(nodes) * cost.slipping_s + cost.step_length_s),
                                microseconds(static_cast<double>(nodes) * cost.resting_s + cost.step_length_s),
                                1e-3 * static_cast<double>(nodes * cost.bytes_per_node)));
  line("everything on", fmt::format("{}", fmt::join(together, ", ")));
  return out;
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

void check_scene(std::string_view scene, const std::string& file) {
  static_cast<void>(service::scene_model(scene, file));
}

OmittedCost omitted_cost(const std::string& effective_scene, const wire::SessionClosed& totals) {
  const service::SceneModel made = service::scene_model(effective_scene, "the effective scene");
  const physics::ModelOptions& options = made.options;
  const FullModel full = with_everything(options);
  const Beside everything{.ledger = true, .friction_energy = service::has_ledger(full.options)};
  OmittedCost omitted{.bytes_per_node = bytes_per_node(options, {.friction_energy = made.friction_energy}),
                      .bytes_per_node_with_everything = bytes_per_node(full.options, everything)};
  for (const physics::Part& part : physics::parts())
    if (!part.is_on(options) && std::ranges::find(full.parts, unique_key(part)) != full.parts.end())
      omitted.parts.push_back(unique_key(part));
  if (everything.friction_energy && !made.friction_energy) omitted.parts.emplace_back(kFrictionEnergy);
  if (physics::nodes_sleep(options) && totals.node_steps > 0)
    omitted.share_asleep = static_cast<double>(totals.asleep_node_steps) / static_cast<double>(totals.node_steps);
  return omitted;
}

}  // namespace shearbus::server
