#include "tests/campaign/report.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cstdio>
#include <limits>
#include <nlohmann/json.hpp>
#include <optional>
#include <stdexcept>
#include <utility>
#include <vector>

#include "tests/campaign/campaign.hpp"
#include "tests/campaign/controls.hpp"
#include "tests/campaign/random.hpp"

namespace shearbus::study {

using namespace stability;  // NOLINT(google-build-using-namespace): the results reported here

namespace {

struct Campaign {
  std::optional<UserScene> scene;  // scene of the user; if given, no other physics runs
  bool cut_short = false;          // the option --steps limits the length of every load history
  std::vector<Physics> physics;
  std::vector<Row> rows;
  std::vector<std::vector<Outcome>> outcomes;  // outcome of each load history (row) with each physics: [row][physics]
  std::vector<Control> controls;
  std::vector<RandomOutcome> random;
};

const char* name_of(Verdict verdict) {
  switch (verdict) {
    case Verdict::kHeld:
      return "held";
    case Verdict::kNotMet:
      return "not met";
    case Verdict::kBroken:
      return "broken";
    case Verdict::kNotAsked:
      break;
  }
  return "not asked";
}

// Combines several outcomes into one: the worst verdict, the largest residuals and efforts, the sums of counts and
// times.
Outcome worst_of(const std::vector<const Outcome*>& outcomes) {
  Outcome worst;
  for (const Outcome* one : outcomes) {
    if (one->verdict == Verdict::kNotAsked) continue;
    if (worst.verdict == Verdict::kNotAsked || one->verdict > worst.verdict) worst.verdict = one->verdict;
    worst.figures.add(one->figures);
    take_most(worst.most, one->most);
    worst.bound_share = std::max(worst.bound_share, one->bound_share);
    worst.seconds += one->seconds;
  }
  return worst;
}

void print_heading(const char* first) {
  fmt::print("\n{:<36} {:>9} {:>10} {:>9} {:>9} {:>9} {:>6} {:>7} {:>7} {:>7}\n", first, "verdict", "node-steps",
             "heat bal.", "over lim.", "to melt", "bound", "sums", "limits", "waves");
}
void print_line(const std::string& name, const Outcome& o) {
  if (o.verdict == Verdict::kNotAsked) return fmt::print("{:<36} {:>9}\n", name, name_of(o.verdict));
  fmt::print("{:<36} {:>9} {:>10} {:>9.1e} {:>9.1e} {:>9.1e} {:>6.4f} {:>7} {:>7} {:>7}\n", name, name_of(o.verdict),
             o.figures.node_steps, o.figures.heat_residual, o.figures.over_limit, o.figures.nearest_melting,
             o.bound_share, o.most.layer_sums, o.most.limit_values, o.most.wave_evaluations);
}

void print_row(const Row& row, const std::vector<Outcome>& outcomes) {
  std::vector<const Outcome*> all;
  all.reserve(outcomes.size());
  for (const Outcome& one : outcomes) all.push_back(&one);
  print_line(row.name, worst_of(all));
  static_cast<void>(std::fflush(stdout));
}

void print_physics(const Campaign& c) {
  if (!c.scene) {
    print_heading("physics");
    for (std::size_t p = 0; p < c.physics.size(); ++p) {
      std::vector<const Outcome*> all;
      all.reserve(c.outcomes.size());
      for (const auto& row : c.outcomes) all.push_back(&row[p]);
      print_line(c.physics[p].name, worst_of(all));
    }
  }
  fmt::print(
      "heat bal.: of the heat there is; over lim.: of a stress over what its law allows; to melt: K left; bound: of "
      "the heat a molten interface would take;\nsums over the layer, values of the limit, evaluations of waves: "
      "most in one step of eight nodes\n");
  for (std::size_t r = 0; r < c.rows.size(); ++r)
    for (std::size_t p = 0; p < c.physics.size(); ++p)
      if (const Outcome& one = c.outcomes[r][p]; !one.reason.empty())
        fmt::print("{} {}, {}: {}\n", one.verdict == Verdict::kBroken ? "BROKEN" : name_of(one.verdict), c.rows[r].name,
                   c.physics[p].name, one.reason);
}

void print_controls(const Campaign& c) {
  fmt::print("\nwrong solvers, which must be seen to fail\n");
  for (const Control& one : c.controls) {
    const ControlOutcome& wrong = one.wrong;
    fmt::print("  {:<16} {}: {} of {} steps break an invariant{}, hottest {:.1f} K{}\n", wrong.name,
               one.seen() ? "seen" : "NOT SEEN", wrong.broken, wrong.steps,
               wrong.rings ? fmt::format(", rings with factor {:.3f}", wrong.factor) : std::string(), wrong.hottest,
               wrong.first.empty() ? std::string() : "; first: " + wrong.first);
  }
}

void print_random(const Campaign& c) {
  if (c.random.empty()) return;
  fmt::print("\nrandom states and inputs\n");
  for (const RandomOutcome& one : c.random) {
    const Figures& f = one.figures;
    fmt::print(
        "  {:<32} {} scenes, {} node-steps, {} broken; heat balance {:.1e}, over a limit {:.1e}; divided {}, several "
        "answers {}; sums {}, limits {}, waves {}\n",
        one.name, one.scenes, f.node_steps, one.faults.size(), f.heat_residual, f.over_limit, f.divided, f.several,
        one.most.layer_sums, one.most.limit_values, one.most.wave_evaluations);
    if (one.slept.asleep > 0)
      fmt::print("    {} asleep, {} of them stuck under stress, woke {} times; T0 at most {:.1e} K from that awake\n",
                 one.slept.asleep, one.slept.stuck, one.slept.woken, one.slept.apart);
    for (std::size_t i = 0; i < std::min<std::size_t>(one.faults.size(), 10); ++i)
      fmt::print("    BROKEN seed {}: {}\n", one.faults[i].seed, one.faults[i].text);
  }
}

// ---- The results as JSON ----

void add_figures(nlohmann::ordered_json& to, const Figures& f, const SearchEffort& most) {
  to.update({{"node_steps", f.node_steps},
             {"divided", f.divided},
             {"several_answers", f.several},
             {"heat_residual", f.heat_residual},
             {"over_limit", f.over_limit},
             {"nearest_melting_k", f.nearest_melting},
             {"layer_sums", most.layer_sums},
             {"limit_values", most.limit_values},
             {"wave_evaluations", most.wave_evaluations}});
}

nlohmann::ordered_json cells_json(const Campaign& c) {
  auto cells = nlohmann::ordered_json::array();
  for (std::size_t r = 0; r < c.rows.size(); ++r)
    for (std::size_t p = 0; p < c.physics.size(); ++p) {
      const Outcome& o = c.outcomes[r][p];
      nlohmann::ordered_json& cell = cells.emplace_back();
      cell = {{"row", c.rows[r].name},
              {"physics", c.physics[p].name},
              {"verdict", name_of(o.verdict)},
              {"reason", o.reason},
              {"bound_share", o.bound_share}};
      add_figures(cell, o.figures, o.most);
      cell["seconds"] = o.seconds;
    }
  return cells;
}

nlohmann::ordered_json scene_json(const Campaign& c, const StabilityOptions& options) {
  if (!c.scene) return nullptr;
  const auto& [physics, text, host] = *c.scene;
  return {{"file", options.scene.string()},
          {"name", physics.name},
          {"physics", text},
          {"host", host},
          {"pressure_pa", physics.host.pressure},
          {"soft_zone_width_m", 2.0 * physics.host.half_zone_soft},
          {"hard_zone_width_m", 2.0 * physics.host.half_zone_hard},
          {"dt_s", physics.host.dt}};
}

nlohmann::ordered_json random_json(const RandomOutcome& one) {
  nlohmann::ordered_json out = {{"name", one.name}, {"scenes", one.scenes}};
  add_figures(out, one.figures, one.most);
  out["faults"] = nlohmann::ordered_json::array();
  for (const RandomOutcome::Fault& fault : one.faults)
    out["faults"].push_back({{"seed", fault.seed}, {"text", fault.text}});
  return out;
}

nlohmann::ordered_json json(const Campaign& c, const StabilityOptions& options) {
  nlohmann::ordered_json out = {{"seed", options.seed}, {"steps", nullptr}, {"scene", scene_json(c, options)}};
  if (options.steps) out["steps"] = *options.steps;
  for (const char* list : {"rows", "physics", "cells", "controls", "random"})
    out[list] = nlohmann::ordered_json::array();
  for (const Row& row : c.rows) out["rows"].push_back({{"name", row.name}, {"what", row.what}});
  for (const Physics& one : c.physics) out["physics"].push_back(one.name);
  out["cells"] = cells_json(c);
  for (const Control& one : c.controls)
    out["controls"].push_back({{"name", one.wrong.name},
                               {"what", one.wrong.what},
                               {"seen", one.seen()},
                               {"steps", one.wrong.steps},
                               {"broken", one.wrong.broken},
                               {"rings", one.wrong.rings},
                               {"factor", one.wrong.factor},
                               {"hottest_k", one.wrong.hottest},
                               {"first", one.wrong.first}});
  for (const RandomOutcome& one : c.random) out["random"].push_back(random_json(one));
  return out;
}

bool sound(const Campaign& c) {
  const bool must_meet = !c.scene && !c.cut_short;
  for (const auto& row : c.outcomes)
    for (const Outcome& one : row)
      if (one.verdict == Verdict::kBroken || (must_meet && one.verdict == Verdict::kNotMet)) return false;
  return std::all_of(c.controls.begin(), c.controls.end(), [](const Control& one) { return one.seen(); }) &&
         std::all_of(c.random.begin(), c.random.end(), [](const RandomOutcome& one) { return one.faults.empty(); });
}

std::vector<Row> rows_of(const std::string& name) {
  std::vector<Row> rows = all_rows();
  if (name.empty()) return rows;
  std::vector<std::string> names;
  for (Row& row : rows) {
    if (row.name == name) return {std::move(row)};
    names.push_back(row.name);
  }
  throw std::runtime_error(fmt::format("there is no row {}; there are {}", name, fmt::join(names, ", ")));
}

void take_scene(const StabilityOptions& options, Campaign& campaign) {
  if (options.scene.empty()) {
    if (options.host.pressure || options.host.zone_width || options.host.dt)
      throw std::runtime_error(
          "--pressure, --zone-width and --dt are of a scene's host: name the scene, or leave them out");
    campaign.physics = all_physics();
    return;
  }
  campaign.scene = user_scene(load_scene_with_layer(options.scene), options.host);
  campaign.physics = {campaign.scene->physics};
  fmt::print("{}: {}\nhost: {}\n", campaign.scene->physics.name, campaign.scene->text, campaign.scene->host);
}

std::vector<RandomOutcome> random_of(const Campaign& c, const StabilityOptions& options) {
  if (options.random_steps == 0) return {};
  if (!c.scene) return run_random(options.random_steps, options.seed);
  return {run_random(c.scene->physics, options.random_steps, options.seed)};
}

}  // namespace

CLI::App* add_stability(CLI::App& program, StabilityOptions& options) {
  CLI::App* command = add_command(
      program, "stability", "Everything at its extreme: each row on each physics, every step held to what always holds",
      "a scene whose physics takes the place of the list", options);
  command->add_option("--row", options.row, "run only this row");
  command->add_option("--steps", options.steps, "of each row at most; absent: all of them")->check(CLI::PositiveNumber);
  command->add_option("--random", options.random_steps, "node-steps from random states with random inputs")
      ->check(CLI::NonNegativeNumber)
      ->capture_default_str();
  command->add_option("--seed", options.seed, "first seed of the random scenes; a broken one is told by its seed")
      ->capture_default_str();
  command->add_flag("--only-random", options.only_random, "nothing but these, and no picture");
  const auto of_host = [&](const char* name, std::optional<double>& value, const char* what) {
    command->add_option(name, value, fmt::format("{}; absent: as SCENE's [hydro] says, or the paper's", what))
        ->check(CLI::PositiveNumber);
  };
  of_host("--pressure", options.host.pressure, "on SCENE's interface, Pa");
  of_host("--zone-width", options.host.zone_width, "of SCENE's host, m");
  of_host("--dt", options.host.dt, "step of SCENE's host, s");
  return command;
}

int run_stability(const StabilityOptions& options) {
  Campaign campaign{.scene = {}, .cut_short = options.steps.has_value()};
  take_scene(options, campaign);
  prepare_study(options, "stability");
  if (options.only_random) {
    campaign.random = random_of(campaign, options);
    print_random(campaign);
    CommandOptions plain = options;
    plain.plot = false;
    write_study(plain, "stability", json(campaign, options));
    return sound(campaign) ? 0 : 1;
  }
  campaign.rows = rows_of(options.row);
  print_heading("row");
  for (const Row& row : campaign.rows) {
    auto& outcomes = campaign.outcomes.emplace_back();
    outcomes.reserve(campaign.physics.size());
    for (const Physics& physics : campaign.physics)
      outcomes.push_back(run(row, physics, options.steps.value_or(std::numeric_limits<int>::max())));
    print_row(row, outcomes);
  }
  print_physics(campaign);
  if (options.row.empty()) {
    if (!campaign.scene) {
      campaign.controls = run_controls();
      print_controls(campaign);
    }
    static_cast<void>(std::fflush(stdout));
    campaign.random = random_of(campaign, options);
    print_random(campaign);
  }
  if (campaign.scene) fmt::print("\nwrong solvers do not depend on a scene: shearbus-study stability shows them\n");
  write_study(options, "stability", json(campaign, options));
  return sound(campaign) ? 0 : 1;
}

}  // namespace shearbus::study
