#include "hydro_stub/run2d.hpp"

#include <fmt/format.h>
#include <omp.h>

#include <array>
#include <cerrno>
#include <chrono>
#include <cstdlib>
#include <fstream>
#include <map>
#include <numbers>
#include <system_error>
#include <utility>
#include <vector>

#include "hydro_stub/interface_history.hpp"
#include "hydro_stub/lagrange/strength.hpp"
#include "hydro_stub/law_name.hpp"
#include "proto/wire/fields.hpp"
#include "proto/wire/interrupt.hpp"
#include "proto/wire/progress.hpp"
#include "proto/wire/scene_file.hpp"
#include "proto/wire/status.hpp"

namespace shearbus::hydro {
namespace {

using Clock = std::chrono::steady_clock;
using lagrange::Cycle;
using lagrange::Ledger;
using lagrange::Vec2;

wire::FieldWriter field_writer(const std::filesystem::path& sidecar, const Problem2d& problem, const std::string& scene,
                               std::vector<double> times) {
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

void write_fields(wire::FieldWriter& writer, const Cycle& cycle) {
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

struct Times {
  double total, solver, bus, output;  // [s]
};

void summarize(const std::filesystem::path& out, const wire::Scene& scene, const Cycle& cycle, const Ledger& start,
               const InterfaceHistory& interface, const Times& times) {
  const Ledger end = cycle.ledger();
  constexpr double kTurn = 2.0 * std::numbers::pi;  // the mesh holds one radian
  const double energy_residual = (end.total_energy() - end.work_given) / start.total_energy() - 1.0;
  const double momentum_residual = (end.momentum.y - end.impulse_given.y) / start.momentum.y - 1.0;
  const double service = (times.solver + times.bus) / times.total;
  const std::string law = name(scene.hydro->interface_law);
  fmt::print(
      "{}, interface law {}\n"
      "  zones, steps            {}, {} (taken back: {})\n"
      "  regime shares           open {:.1f} %, stick {:.1f} %, Coulomb {:.1f} %, Tresca {:.1f} %, melting {:.1f} %\n"
      "  slip distance           mean {:.4f} mm, longest {:.4f} mm\n"
      "  hottest interface       {:.1f} K; highest pressure {:.3f} GPa\n"
      "  friction heat           {:.4f} J of {:.1f} J kinetic at the start; closing the gaps {:.4f} J\n"
      "  ledger residuals        energy {:.1e}, axial momentum {:.1e}\n"
      "  run time                {:.2f} s: law's solver {:.2f}, bus {:.2f} ({:.1f} % together), output {:.2f}\n",
      scene.name, law, cycle.mesh().num_zones(), cycle.steps(), cycle.rejected_steps(),
      100.0 * interface.share(wire::Regime::kOpen), 100.0 * interface.share(wire::Regime::kStick),
      100.0 * interface.share(wire::Regime::kCoulomb), 100.0 * interface.share(wire::Regime::kTresca),
      100.0 * interface.share(wire::Regime::kMelting), 1e3 * interface.mean_slip(), 1e3 * interface.longest_slip(),
      interface.hottest(), 1e-9 * interface.highest_pressure(), kTurn * end.friction_heat, kTurn * start.kinetic,
      kTurn * end.closing_heat, energy_residual, momentum_residual, times.total, times.solver, times.bus,
      100.0 * service, times.output);
  std::ofstream json(out / "summary.json", std::ios::binary);
  json << fmt::format(
      "{{\n  \"interface_law\": \"{}\",\n  \"zones\": {},\n  \"steps\": {},\n  \"steps_taken_back\": {},\n"
      "  \"share_open\": {:.17g},\n  \"share_stick\": {:.17g},\n  \"share_coulomb\": {:.17g},\n  \"share_tresca\": "
      "{:.17g},\n"
      "  \"share_melting\": {:.17g},\n  \"mean_slip_m\": {:.17g},\n  \"longest_slip_m\": {:.17g},\n"
      "  \"peak_interface_temperature_k\": {:.17g},\n  \"peak_pressure_pa\": {:.17g},\n  \"friction_heat_j\": "
      "{:.17g},\n"
      "  \"energy_residual\": {:.3e},\n  \"momentum_residual\": {:.3e},\n  \"run_time_s\": {:.6g},\n"
      "  \"service_share\": {:.6g}\n}}\n",
      law, cycle.mesh().num_zones(), cycle.steps(), cycle.rejected_steps(), interface.share(wire::Regime::kOpen),
      interface.share(wire::Regime::kStick), interface.share(wire::Regime::kCoulomb),
      interface.share(wire::Regime::kTresca), interface.share(wire::Regime::kMelting), interface.mean_slip(),
      interface.longest_slip(), interface.hottest(), interface.highest_pressure(), kTurn * end.friction_heat,
      energy_residual, momentum_residual, times.total, service);
  json.close();
  if (!json) throw std::system_error(errno, std::generic_category(), "cannot write " + (out / "summary.json").string());
}

class Run {
 public:
  Run(const wire::Scene& scene, const wire::Scene& effective, Problem2d problem, InterfaceLaw& law,
      const RunOptions& options, const wire::DumpReader* from)
      : scene_(scene),
        effective_text_(wire::scene_to_toml(effective)),
        law_(law),
        options_(options),
        end_time_(problem.end_time),
        history_interval_(problem.history_interval),
        frames_(problem.frames),
        dumps_(options.out, options.dumps),
        interface_(interface_nodes(problem.bodies)),
        surface_(problem.free_surface),
        fields_(field_writer(options.out / "fields.xmf", problem, effective_text_,
                             from != nullptr ? from->numbers("frame_times") : std::vector<double>())),
        cycle_(std::move(problem.bodies), &law),
        start_(cycle_.ledger()) {
    if (from != nullptr) load(*from);
  }

  void to_the_end() {
    constexpr double kBarParts = 10'000;  // steps are not known before; time is
    const double begun_at = cycle_.state().time;
    const auto part = [&](double time) { return static_cast<std::size_t>(kBarParts * (time - begun_at) / end_time_); };
    wire::Progress bar(scene_.name, part(end_time_), options_.progress);
    if (fields_.times_s().empty()) timed([&] { write_fields(fields_, cycle_); });
    while (cycle_.state().time < end_time_) {
      step();
      bar.at(part(cycle_.state().time));
      if (cycle_.state().time >= end_time_) break;
      if (wire::interrupted()) stop();
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
      if (cycle_.state().time >= until) write_fields(fields_, cycle_);
    });
  }

  void dump() {
    dumps_.write(cycle_.steps(), [&](const std::string& name, wire::DumpWriter& to) {
      to.text("kept", law_.keep(name));
      to.text("scene", wire::scene_to_toml(scene_));
      to.text("server", options_.server);
      const lagrange::Memory memory = cycle_.memory();
      for (const auto& [what, values] : memory.numbers) to.numbers(std::string("cycle/") + what, values);
      for (const auto& [what, values] : memory.counts) to.counts(std::string("cycle/") + what, values);
      interface_.save(to);
      surface_.save(to);
      to.numbers("frame_times", fields_.times_s());
      to.numbers("next_row", std::span(&next_row_, 1));
    });
  }

  void load(const wire::DumpReader& from) {
    const lagrange::Memory memory = cycle_.memory();
    for (const auto& [what, values] : memory.numbers) from.fill(std::string("cycle/") + what, values);
    for (const auto& [what, values] : memory.counts) from.fill(std::string("cycle/") + what, values);
    interface_.load(from);
    surface_.load(from);
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
    const std::map<std::string, std::string> meta = {{"producer", "shearbus-hydro"},
                                                     {"scene", effective_text_},
                                                     {"scene_name", scene_.name},
                                                     {"interface_law", name(scene_.hydro->interface_law)}};
    timed([&] {
      if (interface_.nodes() > 0) interface_.write(options_.out / "interface.h5", meta);
      if (!surface_.empty()) surface_.write(options_.out / "free_surface.h5", meta);
    });
    const LawTime spent = law_.time_spent();
    summarize(options_.out, scene_, cycle_, start_, interface_,
              {.total = seconds(Clock::now() - begun_),
               .solver = seconds(spent.solver),
               .bus = seconds(spent.bus),
               .output = seconds(output_)});
    law_.close();
    dumps_.remove();
  }

  const wire::Scene& scene_;
  std::string effective_text_;
  InterfaceLaw& law_;
  RunOptions options_;
  double end_time_;
  double history_interval_;
  std::uint32_t frames_;
  RestartDumps dumps_;
  InterfaceHistory interface_;
  SurfaceHistory surface_;
  wire::FieldWriter fields_;
  Cycle cycle_;
  Ledger start_;
  double next_row_ = 0.0;  // [s]
  Clock::time_point begun_ = Clock::now();
  Clock::duration output_{0};
};

}  // namespace

std::size_t interface_nodes(const lagrange::Bodies& bodies) {
  return static_cast<std::size_t>(lagrange::InterfaceWeights(bodies.mesh.symmetry(), bodies.slide_lines).rubbing());
}

void run_problem2d(const wire::Scene& scene, const wire::Scene& effective, Problem2d problem, InterfaceLaw& law,
                   const RunOptions& options, const wire::DumpReader* from) {
  // OpenMP's threads wait by spinning, which on a shared machine costs more than they bring: only those asked for.
  if (std::getenv("OMP_NUM_THREADS") == nullptr) omp_set_num_threads(1);
  std::filesystem::create_directories(options.out);
  wire::stop_at_next_step();
  Run(scene, effective, std::move(problem), law, options, from).to_the_end();
}

}  // namespace shearbus::hydro
