#include "tests/study/stability_report.hpp"

#include <fmt/chrono.h>
#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cstdlib>
#include <ctime>
#include <fstream>
#include <stdexcept>
#include <vector>

#include "tests/study/report.hpp"
#include "tests/study/stability.hpp"
#include "tests/study/stability_controls.hpp"
#include "tests/study/stability_random.hpp"
#include "tests/study/stability_refusals.hpp"

namespace shearbus::study {

using namespace stability;  // NOLINT(google-build-using-namespace): what is reported

namespace {

struct Campaign {
  std::vector<Physics> physics;
  std::vector<Row> rows;
  std::vector<std::vector<Outcome>> outcomes;  // [row][physics]
  std::vector<Refusal> refusals;
  std::vector<Control> controls;
  std::vector<RandomOutcome> random;
};

const char* name_of(Verdict verdict) {
  return verdict == Verdict::kHeld ? "held" : verdict == Verdict::kBroken ? "broken" : "not asked";
}

// Of several outcomes the worst of everything.
Outcome worst_of(const std::vector<const Outcome*>& outcomes) {
  Outcome worst;
  for (const Outcome* one : outcomes) {
    if (one->verdict == Verdict::kNotAsked) continue;
    if (worst.verdict != Verdict::kBroken) worst.verdict = one->verdict;
    worst.figures.add(one->figures);
    take_most(worst.most, one->most);
    worst.bound_share = std::max(worst.bound_share, one->bound_share);
    worst.seconds += one->seconds;
  }
  return worst;
}

void print_heading(const char* first) {
  fmt::print("\n{:<36} {:>9} {:>10} {:>9} {:>9} {:>9} {:>6} {:>7} {:>7} {:>7}\n", first, "verdict", "node-steps",
             "heat bal.", "over lim.", "to melt", "bound", "sums", "limits", "Newton");
}
void print_line(const std::string& name, const Outcome& o) {
  fmt::print("{:<36} {:>9} {:>10} {:>9.1e} {:>9.1e} {:>9.1e} {:>6.4f} {:>7} {:>7} {:>7}\n", name, name_of(o.verdict),
             o.figures.node_steps, o.figures.heat_residual, o.figures.over_limit, o.figures.nearest_melting,
             o.bound_share, o.most.layer_sums, o.most.limit_values, o.most.newton_steps);
}

void print_rows(const Campaign& c) {
  print_heading("row");
  for (std::size_t r = 0; r < c.rows.size(); ++r) {
    std::vector<const Outcome*> all;
    for (const Outcome& one : c.outcomes[r]) all.push_back(&one);
    print_line(c.rows[r].name, worst_of(all));
  }
  print_heading("physics");
  for (std::size_t p = 0; p < c.physics.size(); ++p) {
    std::vector<const Outcome*> all;
    for (const auto& row : c.outcomes) all.push_back(&row[p]);
    print_line(c.physics[p].name, worst_of(all));
  }
  fmt::print(
      "heat bal.: of the heat there is; over lim.: of a stress over what its law allows; to melt: K left; bound: of "
      "the heat a molten interface would take;\nsums over the layer, values of the limit, Newton steps of waves: "
      "most in one step of eight nodes\n");
  for (std::size_t r = 0; r < c.rows.size(); ++r)
    for (std::size_t p = 0; p < c.physics.size(); ++p)
      if (c.outcomes[r][p].verdict == Verdict::kBroken)
        fmt::print("BROKEN {}, {}: {}\n", c.rows[r].name, c.physics[p].name, c.outcomes[r][p].reason);
}

void print_refusals(const Campaign& c) {
  fmt::print("\nwhat makes no sense\n");
  for (const Refusal& one : c.refusals)
    fmt::print("  {:<40} {}: {}\n", one.name, one.seen() ? "refused" : "NOT REFUSED AS IT SHOULD", one.text);
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
        "answers {}; sums {}, limits {}, Newton {}\n",
        one.name, one.scenes, f.node_steps, one.faults.size(), f.heat_residual, f.over_limit, f.divided, f.several,
        one.most.layer_sums, one.most.limit_values, one.most.newton_steps);
    for (std::size_t i = 0; i < std::min<std::size_t>(one.faults.size(), 10); ++i)
      fmt::print("    BROKEN seed {}: {}\n", one.faults[i].seed, one.faults[i].text);
  }
}

// ---- JSON ----

template <class Range, class Text>
std::string list(const Range& range, const Text& text) {
  std::string json = "[";
  for (const auto& one : range) json += (json.size() > 1 ? ",\n  " : "\n  ") + text(one);
  return json + "]";
}

std::string figures_json(const Figures& f, const SearchEffort& most) {
  return fmt::format(
      "\"node_steps\": {}, \"divided\": {}, \"several_answers\": {}, \"heat_residual\": {}, \"over_limit\": {}, "
      "\"nearest_melting_k\": {}, \"layer_sums\": {}, \"limit_values\": {}, \"newton_steps\": {}, \"guarded_steps\": "
      "{}",
      f.node_steps, f.divided, f.several, number(f.heat_residual), number(f.over_limit), number(f.nearest_melting),
      most.layer_sums, most.limit_values, most.newton_steps, most.guarded_steps);
}

std::string cells_json(const Campaign& c) {
  std::string json = "[";
  for (std::size_t r = 0; r < c.rows.size(); ++r)
    for (std::size_t p = 0; p < c.physics.size(); ++p) {
      const Outcome& o = c.outcomes[r][p];
      json += fmt::format(
          "{}\n  {{\"row\": {}, \"physics\": {}, \"verdict\": \"{}\", \"reason\": {}, \"bound_share\": {}, {}, "
          "\"seconds\": {}}}",
          r + p == 0 ? "" : ",", quoted(c.rows[r].name), quoted(c.physics[p].name), name_of(o.verdict),
          quoted(o.reason), number(o.bound_share), figures_json(o.figures, o.most), number(o.seconds));
    }
  return json + "]";
}

std::string json(const Campaign& c, const StabilityOptions& options) {
  return fmt::format("{{{}, \"seed\": {},\n", provenance("stability"), options.seed) + "\"rows\": " +
         list(c.rows,
              [](const Row& row) {
                return fmt::format("{{\"name\": {}, \"what\": {}}}", quoted(row.name), quoted(row.what));
              }) +
         ",\n\"physics\": " + list(c.physics, [](const Physics& one) { return quoted(one.name); }) +
         ",\n\"cells\": " + cells_json(c) + ",\n\"refusals\": " +
         list(c.refusals,
              [](const Refusal& one) {
                return fmt::format("{{\"name\": {}, \"refused\": {}, \"field\": {}, \"text\": {}}}", quoted(one.name),
                                   one.seen(), quoted(one.named), quoted(one.text));
              }) +
         ",\n\"controls\": " +
         list(c.controls,
              [](const Control& one) {
                return fmt::format(
                    "{{\"name\": {}, \"what\": {}, \"seen\": {}, \"steps\": {}, \"broken\": {}, \"rings\": {}, "
                    "\"factor\": "
                    "{}, \"hottest_k\": {}, \"first\": {}}}",
                    quoted(one.wrong.name), quoted(one.wrong.what), one.seen(), one.wrong.steps, one.wrong.broken,
                    one.wrong.rings, number(one.wrong.factor), number(one.wrong.hottest), quoted(one.wrong.first));
              }) +
         ",\n\"random\": " +
         list(c.random,
              [](const RandomOutcome& one) {
                return fmt::format("{{\"name\": {}, \"scenes\": {}, {}, \"faults\": {}}}", quoted(one.name), one.scenes,
                                   figures_json(one.figures, one.most),
                                   list(one.faults, [](const RandomOutcome::Fault& f) {
                                     return fmt::format("{{\"seed\": {}, \"text\": {}}}", f.seed, quoted(f.text));
                                   }));
              }) +
         "}\n";
}

bool sound(const Campaign& c) {
  for (const auto& row : c.outcomes)
    for (const Outcome& one : row)
      if (one.verdict == Verdict::kBroken) return false;
  return std::all_of(c.refusals.begin(), c.refusals.end(), [](const Refusal& one) { return one.seen(); }) &&
         std::all_of(c.controls.begin(), c.controls.end(), [](const Control& one) { return one.seen(); }) &&
         std::all_of(c.random.begin(), c.random.end(), [](const RandomOutcome& one) { return one.faults.empty(); });
}

void write(const Campaign& campaign, const StabilityOptions& options) {
  std::filesystem::create_directories(options.out);
  const auto path = options.out / "stability.json";
  std::ofstream file(path);
  file << json(campaign, options);
  file.close();
  if (!file) throw std::runtime_error("cannot write " + path.string());
  fmt::print("\nwritten: {}\n", path.string());
  std::fflush(stdout);
  if (!options.plot) return;
  const std::string command = fmt::format("\"{}\" \"{}/tests/study/plot_stability.py\" \"{}\"", SHEARBUS_PYTHON,
                                          SHEARBUS_SOURCE_DIR, path.string());
  if (std::system(command.c_str()) != 0) throw std::runtime_error("the picture was not made");
}

}  // namespace

CLI::App* add_stability(CLI::App& program, StabilityOptions& options) {
  CLI::App* command = program.add_subcommand(
      "stability", "Everything at its extreme: each row on each physics, every step held to what always holds");
  command->add_option("--out", options.out, "directory of stability.json and stability.png")->capture_default_str();
  command->add_option("--row", options.row, "run only this row");
  command->add_option("--random", options.random_steps, "node-steps from random states with random inputs")
      ->check(CLI::NonNegativeNumber)
      ->capture_default_str();
  command->add_option("--seed", options.seed, "first seed of the random scenes; a broken one is told by its seed")
      ->capture_default_str();
  command->add_flag("--only-random", options.only_random, "nothing but these, and no picture");
  command->add_flag("!--no-plot", options.plot, "write no picture");
  return command;
}

int run_stability(const StabilityOptions& options) {
  Campaign campaign;
  if (options.only_random) {
    campaign.random = run_random(options.random_steps, options.seed);
    print_random(campaign);
    StabilityOptions plain = options;
    plain.plot = false;
    write(campaign, plain);
    return sound(campaign) ? 0 : 1;
  }
  campaign.physics = all_physics();
  for (Row& row : all_rows())
    if (options.row.empty() || options.row == row.name) campaign.rows.push_back(std::move(row));
  if (campaign.rows.empty()) throw std::runtime_error("there is no row " + options.row);
  for (const Row& row : campaign.rows) {
    auto& outcomes = campaign.outcomes.emplace_back();
    for (const Physics& physics : campaign.physics) outcomes.push_back(run(row, physics));
  }
  print_rows(campaign);
  if (options.row.empty()) {
    campaign.refusals = run_refusals();
    print_refusals(campaign);
    campaign.controls = run_controls();
    print_controls(campaign);
    std::fflush(stdout);
    if (options.random_steps > 0) campaign.random = run_random(options.random_steps, options.seed);
    print_random(campaign);
  }
  write(campaign, options);
  return sound(campaign) ? 0 : 1;
}

}  // namespace shearbus::study
