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

std::vector<files::Quantity> surface_quantities() {
  return {{.name = "axial_velocity", .units = "m s-1", .long_name = "along the second axis"},
          {.name = "radius", .units = "m", .long_name = "first coordinate of the node"},
          {.name = "height", .units = "m", .long_name = "second coordinate of the node"}};
}

class Run {
 public:
  Run(const SceneFile& file, const guest::HydroScene& effective, Problem2d problem, InterfaceLaw& law,
      const RunOptions& options, const files::DumpReader* from)
      : file_(file),
        meta_(meta_of(effective, options.provenance)),
        law_(law),
        options_(options),
        problem_(std::move(problem)),
        dumps_(options.out, options.dumps),
        half_zone_(half_wall_zones(problem_.bodies)),
        warns_of_melting_(file.scene.hydro().interface_law() == guest::INTERFACE_LAW_COULOMB_TRESCA),
        interface_(problem_),
        surface_("free_surface", surface_quantities(), problem_.free_surface.size()),
        profiles_(profile_record(file.scene, interface_.nodes(), law)),
        fields_(field_writer(options.out / "fields.xmf", problem_, meta_.at("scene"),
                             from != nullptr ? from->numbers("frame_times") : std::vector<double>())),
        cycle_(std::move(problem_.bodies), &law),
        start_(cycle_.ledger()) {
    if (from != nullptr) load(*from);
    if (interface_.has_melted()) warns_of_melting_ = false;
  }

  void to_the_end() {
    const double begun_s = cycle_.state().time;
    const std::size_t begun_step = cycle_.steps();
    program::Progress bar(file_.scene.scene().name(), options_.progress);
    if (fields_.times_s().empty()) timed([&] { write_fields(fields_, cycle_); });
    while (cycle_.state().time < problem_.end_time) {
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
      if (warns_of_cold_ && fields_.times_s().back() == cycle_.state().time) {
        const std::vector<double>& temperature = cycle_.state().temperature;
        const auto coldest = std::ranges::min_element(temperature);
        if (*coldest < 0.0) {
          bar.clear();
          fmt::print(stderr,
                     "shearbus-hydro: warning: zone {} has {:.0f} K at {:g} s, which is below absolute zero: what "
                     "follows is unphysical. Lower the speeds, or make the zones finer.\n",
                     coldest - temperature.begin(), *coldest, cycle_.state().time);
          warns_of_cold_ = false;
        }
      }
      bar.show([&](double elapsed_s) {
        return program::extent_of_time({.begun_s = begun_s,
                                        .now_s = cycle_.state().time,
                                        .end_s = problem_.end_time,
                                        .begun_step = begun_step,
                                        .step = cycle_.steps()},
                                       elapsed_s);
      });
      if (cycle_.state().time >= problem_.end_time) break;
      if (problem_.over && problem_.over(cycle_)) {
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
  template <typename Work>
  void timed(const Work& work) {
    const Clock::time_point start = Clock::now();
    work();
    output_ += Clock::now() - start;
  }

  void step() {
    const std::size_t frame = fields_.times_s().size();
    const double until =
        frame >= problem_.frames ? problem_.end_time : problem_.end_time * static_cast<double>(frame) / problem_.frames;
    cycle_.advance(until);
    timed([&] {
      interface_.observe(cycle_);
      if (cycle_.state().time >= next_row_) {
        interface_.record(cycle_);
        record_surface();
        next_row_ += problem_.history_interval;
      }
      record_profiles(profiles_, cycle_.state().time, cycle_.contact().inputs().pressure, law_);
      if (cycle_.state().time >= until) write_fields(fields_, cycle_);
    });
  }

  void record_surface() {
    const lagrange::State& state = cycle_.state();
    std::vector<double> speed, radius, height;
    for (const int n : problem_.free_surface) {
      speed.push_back(state.velocity[n].y);
      radius.push_back(state.position[n].x);
      height.push_back(state.position[n].y);
    }
    surface_.begin_row(state.time);
    surface_.set(0, speed);
    surface_.set(1, radius);
    surface_.set(2, height);
  }

  // The scene of a restart: it names the interface law that the command line chose. A thickness that follows from the
  // zones is left out: a scene with plastic layers may not give another one.
  guest::HydroScene kept_scene() const {
    guest::HydroScene kept = file_.scene;
    if (!problem_.layer_thickness.empty()) kept.mutable_scene()->mutable_layer()->clear_thickness_m();
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
      if (!problem_.start_temperature.empty()) to.numbers("start_temperature", problem_.start_temperature);
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
    const std::string where = fmt::format("interrupted at step {}, {:.4g} of {:.4g} s", cycle_.steps(),
                                          cycle_.state().time, problem_.end_time);
    if (const std::string why = law_.cannot_keep(); !why.empty())
      throw std::runtime_error(fmt::format("{}; no restart dump: {}", where, why));
    dump();
    throw Interrupted(
        fmt::format("{}; go on with: shearbus-hydro --restart {}", where, server::quoted(options_.out.string())));
  }

  void finish() {
    timed([&] {
      if (interface_.nodes() > 0)
        interface_.write(options_.out / "interface.h5", meta_, profiles_, problem_.start_temperature);
      if (!problem_.free_surface.empty()) surface_.write(options_.out / "free_surface.h5", meta_);
    });
    Summary2d summary{.scene = meta_.at("scene_name"),
                      .interface_law = meta_.at("interface_law"),
                      .provenance = options_.provenance,
                      .problem = problem_,
                      .cycle = cycle_,
                      .start = start_,
                      .interface = interface_,
                      .comparisons = problem_.compare ? problem_.compare(cycle_) : std::vector<Comparison>(),
                      .time = {.total = Clock::now() - begun_,
                               .output = output_,
                               .cpu_s = static_cast<double>(std::clock()) / CLOCKS_PER_SEC,
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
  std::map<std::string, std::string> meta_;  // of the histories
  InterfaceLaw& law_;
  RunOptions options_;
  Problem2d problem_;  // without its bodies, which are the cycle's
  RestartDumps dumps_;
  std::vector<double> half_zone_;  // half the thickness of the soft zones at each interface node  [m]
  bool warns_of_melting_;          // the interface law is law (5), and no zone has been near melting yet
  bool warns_of_cold_ = true;      // no frame has had a zone below 0 K yet
  InterfaceHistory interface_;
  HistoryRows surface_;
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
  if (from == nullptr) remove_results(options.out);
  program::stop_at_next_step(2);
  Run(file, effective, std::move(problem), law, options, from).to_the_end();
}

}  // namespace shearbus::hydro
