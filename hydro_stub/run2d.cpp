#include "hydro_stub/run2d.hpp"

#include <fmt/format.h>
#include <omp.h>

#include <array>
#include <cerrno>
#include <chrono>
#include <cstdlib>
#include <ctime>
#include <functional>
#include <map>
#include <system_error>
#include <utility>
#include <vector>

#include "hydro_stub/history.hpp"
#include "hydro_stub/interface_history.hpp"
#include "hydro_stub/lagrange/strength.hpp"
#include "hydro_stub/law_name.hpp"
#include "hydro_stub/profiles.hpp"
#include "hydro_stub/summary2d.hpp"
#include "hydro_stub/wall_zones.hpp"
#include "proto/files/fields.hpp"
#include "proto/files/whole_file.hpp"
#include "proto/program/interrupt.hpp"
#include "proto/program/progress.hpp"

namespace shearbus::hydro {
namespace {

using Clock = std::chrono::steady_clock;
using lagrange::Cycle;
using lagrange::Ledger;
using lagrange::Vec2;

files::FieldWriter field_writer(const std::filesystem::path& sidecar, const Problem2d& problem,
                                const std::string& scene, std::vector<double> times) {
  const lagrange::Mesh& mesh = problem.bodies.mesh;
  std::vector<std::int32_t> quads;
  for (int z = 0; z < mesh.num_zones(); ++z) quads.insert(quads.end(), mesh.zone_nodes(z), mesh.zone_nodes(z) + 4);
  return {sidecar,
          quads,
          static_cast<std::size_t>(mesh.num_nodes()),
          {{.name = "temperature", .units = "K", .long_name = "of the zone"},
           {.name = "pressure", .units = "Pa", .long_name = "compression positive"},
           {.name = "density", .units = "kg m-3", .long_name = "of the zone"},
           {.name = "plastic_strain", .units = "1", .long_name = "equivalent"},
           {.name = "equivalent_stress", .units = "Pa", .long_name = "von Mises"},
           {.name = "body", .units = "1", .long_name = problem.body_names}},
          scene,
          std::move(times)};
}

void write_fields(files::FieldWriter& writer, const Cycle& cycle) {
  const lagrange::State& s = cycle.state();
  const auto three = [](const std::vector<Vec2>& from) {
    std::vector<double> to;
    to.reserve(3 * from.size());
    for (const Vec2 v : from) to.insert(to.end(), {v.x, v.y, 0.0});
    return to;
  };
  std::vector<double> stress(s.mass.size()), body(s.mass.size());
  for (std::size_t z = 0; z < stress.size(); ++z) {
    stress[z] = lagrange::equivalent_stress({s.deviator_xx[z], s.deviator_yy[z], s.deviator_xy[z]});
  }
  for (std::size_t b = 0; b < cycle.mesh().blocks().size(); ++b) {
    const lagrange::Block& block = cycle.mesh().blocks()[b];
    std::fill_n(body.begin() + block.first_zone, block.num_zones(), static_cast<double>(b));
  }
  const std::array<std::span<const double>, 6> zones = {s.temperature,    s.pressure, s.density,
                                                        s.plastic_strain, stress,     body};
  writer.frame(s.time, three(s.position), three(s.velocity), zones);
}

InterfaceFacts facts_of(const Problem2d& problem) {
  InterfaceFacts facts{.bound = problem.heat_bound};
  if (interface_nodes(problem.bodies) == 0) return facts;
  facts.bands.emplace(problem.bodies);
  if (problem.strength) facts.critical_jump.emplace(problem.soft, problem.hard, problem.strength->start_temperature);
  return facts;
}

class Run {
 public:
  Run(const SceneFile& file, const guest::HydroScene& effective, Problem2d problem, InterfaceLaw& law,
      const RunOptions& options, const files::DumpReader* from)
      : file_(file),
        effective_text_(scene::to_toml(effective)),
        law_(law),
        options_(options),
        end_time_(problem.end_time),
        history_interval_(problem.history_interval),
        frames_(problem.frames),
        over_(std::move(problem.over)),
        compare_(std::move(problem.compare)),
        dumps_(options.out, options.dumps),
        published_(problem.published),
        start_temperature_(std::move(problem.start_temperature)),
        layer_thickness_(std::move(problem.layer_thickness)),
        strength_(problem.strength),
        half_zone_(half_wall_zones(problem.bodies)),
        warns_of_melting_(file.scene.hydro().interface_law() == guest::INTERFACE_LAW_COULOMB_TRESCA),
        interface_(InterfaceLine(problem.bodies), facts_of(problem)),
        surface_(problem.free_surface),
        profiles_(profile_record(file.scene, interface_.nodes(), law)),
        fields_(field_writer(options.out / "fields.xmf", problem, effective_text_,
                             from != nullptr ? from->numbers("frame_times") : std::vector<double>())),
        cycle_(std::move(problem.bodies), &law),
        start_(cycle_.ledger()) {
    if (from != nullptr) load(*from);
    if (interface_.has_melted()) warns_of_melting_ = false;
  }

  void to_the_end() {
    const double begun_s = cycle_.state().time;
    const std::size_t begun_step = cycle_.steps();
    program::Progress bar(file_.scene.scene().name(), options_.progress);
    if (fields_.times_s().empty()) timed([&] { write_fields(fields_, cycle_); });
    while (cycle_.state().time < end_time_) {
      step();
      if (warns_of_melting_ && interface_.has_melted()) {
        bar.clear();
        const std::vector<std::uint8_t>& regimes = cycle_.contact().answer().regime;
        const auto node =
            std::ranges::find(regimes, static_cast<std::uint8_t>(wire::Regime::kMelting)) - regimes.begin();
        fmt::print(stderr, "shearbus-hydro: warning: {}\n",
                   melting_zone_warning(file_.scene, half_zone_[static_cast<std::size_t>(node)], cycle_.state().time));
        warns_of_melting_ = false;
      }
      bar.show([&](double elapsed_s) {
        return program::extent_of_time({.begun_s = begun_s,
                                        .now_s = cycle_.state().time,
                                        .end_s = end_time_,
                                        .begun_step = begun_step,
                                        .step = cycle_.steps()},
                                       elapsed_s);
      });
      if (cycle_.state().time >= end_time_) break;
      if (over_ && over_(cycle_)) {
        if (cycle_.state().time > fields_.times_s().back()) timed([&] { write_fields(fields_, cycle_); });
        break;
      }
      if (program::interrupted()) stop();
      if (dumps_.due(cycle_.steps())) timed([&] { dump(); });
    }
    bar.clear();
    finish();
  }

 private:
  static double seconds(Clock::duration d) { return std::chrono::duration<double>(d).count(); }

  template <typename Work>
  void timed(const Work& work) {
    const Clock::time_point start = Clock::now();
    work();
    output_ += Clock::now() - start;
  }

  void step() {
    const std::size_t frame = fields_.times_s().size();
    const double until = frame >= frames_ ? end_time_ : end_time_ * static_cast<double>(frame) / frames_;
    cycle_.advance(until);
    timed([&] {
      interface_.observe(cycle_);
      if (cycle_.state().time >= next_row_) {
        interface_.record(cycle_);
        surface_.record(cycle_);
        next_row_ += history_interval_;
      }
      record_profiles(profiles_, cycle_.state().time, cycle_.contact().inputs().pressure, law_);
      if (cycle_.state().time >= until) write_fields(fields_, cycle_);
    });
  }

  // The scene of a restart: it names the interface law that the command line chose. A thickness that follows from the
  // zones is left out: a scene with plastic layers may not give another one.
  guest::HydroScene kept_scene() const {
    guest::HydroScene kept = file_.scene;
    if (!layer_thickness_.empty()) kept.mutable_scene()->mutable_layer()->clear_thickness_m();
    return kept;
  }

  void dump() {
    dumps_.write(cycle_.steps(), [&](const std::string& name, files::DumpWriter& to) {
      to.text("kept", law_.keep(name));
      to.text("scene", scene::to_toml(kept_scene()));
      to.text("server", options_.server);
      const lagrange::Memory memory = cycle_.memory();
      for (const auto& [what, values] : memory.numbers) to.numbers(std::string("cycle/") + what, values);
      for (const auto& [what, values] : memory.counts) to.counts(std::string("cycle/") + what, values);
      interface_.save(to);
      surface_.save(to);
      profiles_.save(to);
      if (!start_temperature_.empty()) to.numbers("start_temperature", start_temperature_);
      to.numbers("frame_times", fields_.times_s());
      to.numbers("next_row", std::span(&next_row_, 1));
    });
  }

  void load(const files::DumpReader& from) {
    const lagrange::Memory memory = cycle_.memory();
    for (const auto& [what, values] : memory.numbers) from.fill(std::string("cycle/") + what, values);
    for (const auto& [what, values] : memory.counts) from.fill(std::string("cycle/") + what, values);
    interface_.load(from);
    surface_.load(from);
    profiles_.load(from);
    from.fill("next_row", std::span(&next_row_, 1));
  }

  [[noreturn]] void stop() {
    const std::string where =
        fmt::format("interrupted at step {}, {:.4g} of {:.4g} s", cycle_.steps(), cycle_.state().time, end_time_);
    if (const std::string why = law_.cannot_keep(); !why.empty())
      throw std::runtime_error(fmt::format("{}; no restart dump: {}", where, why));
    dump();
    throw Interrupted(fmt::format("{}; go on with: shearbus-hydro --restart {}", where, options_.out.string()));
  }

  void finish() {
    std::map<std::string, std::string> meta = History::origin(options_.provenance);
    meta.insert({{"scene", effective_text_},
                 {"scene_name", file_.scene.scene().name()},
                 {"interface_law", name(file_.scene.hydro().interface_law())}});
    timed([&] {
      if (interface_.nodes() > 0) interface_.write(options_.out / "interface.h5", meta, profiles_, start_temperature_);
      if (!surface_.empty()) surface_.write(options_.out / "free_surface.h5", meta);
    });
    Summary2d summary{.scene = file_.scene.scene().name(),
                      .interface_law = name(file_.scene.hydro().interface_law()),
                      .provenance = options_.provenance,
                      .cycle = cycle_,
                      .start = start_,
                      .interface = interface_,
                      .start_temperature = start_temperature_,
                      .layer_thickness = layer_thickness_,
                      .strength = strength_,
                      .published = published_,
                      .comparisons = compare_ ? compare_(cycle_) : std::vector<Comparison>(),
                      .time = {.total = seconds(Clock::now() - begun_),
                               .output = seconds(output_),
                               .cpu = static_cast<double>(std::clock()) / CLOCKS_PER_SEC,
                               .law = law_.time_spent()}};
    summary.omitted = law_.omitted_cost();
    files::write_whole(options_.out / "summary.json", files::kSummaryFile, summary.json());
    dumps_.note_end();
    fmt::print("{}", summary.text());
    law_.close();  // counts the node-steps that were asleep
    summary.omitted = law_.omitted_cost();
    for (const auto& [label, value] : summary.omitted.lines) fmt::print("  {:<24}{}\n", label, value);
    files::write_whole(options_.out / "summary.json", files::kSummaryFile, summary.json());
    dumps_.remove();
  }

  const SceneFile& file_;
  std::string effective_text_;
  InterfaceLaw& law_;
  RunOptions options_;
  double end_time_;
  double history_interval_;
  std::uint32_t frames_;
  std::function<bool(const Cycle&)> over_;
  std::function<std::vector<Comparison>(const Cycle&)> compare_;
  RestartDumps dumps_;
  std::optional<Envelope> published_;
  std::vector<double> start_temperature_;  // of each node's layer, where it is not that of the scene  [K]
  std::vector<double> layer_thickness_;    // of each node's layer, where it is not that of the scene  [m]
  std::optional<InterfaceStrength> strength_;
  std::vector<double> half_zone_;  // half the thickness of the soft zones at each interface node  [m]
  bool warns_of_melting_;          // the interface law is law (5), and no zone has been near melting yet
  InterfaceHistory interface_;
  SurfaceHistory surface_;
  files::ProfileRecord profiles_;
  files::FieldWriter fields_;
  Cycle cycle_;
  Ledger start_;
  double next_row_ = 0.0;  // time of the next history row  [s]
  Clock::time_point begun_ = Clock::now();
  Clock::duration output_{0};
};

}  // namespace

std::size_t interface_nodes(const lagrange::Bodies& bodies) {
  return static_cast<std::size_t>(lagrange::InterfaceWeights(bodies.mesh.symmetry(), bodies.slide_lines).rubbing());
}

void choose_threads() {
  if (std::getenv("OMP_NUM_THREADS") == nullptr) omp_set_num_threads(1);
}

void run_problem2d(const SceneFile& file, const guest::HydroScene& effective, Problem2d problem, InterfaceLaw& law,
                   const RunOptions& options, const files::DumpReader* from) {
  std::filesystem::create_directories(options.out);
  program::stop_at_next_step();
  Run(file, effective, std::move(problem), law, options, from).to_the_end();
}

}  // namespace shearbus::hydro
