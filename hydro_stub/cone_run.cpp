#include "hydro_stub/cone_run.hpp"

#include <fmt/format.h>
#include <omp.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <chrono>
#include <cmath>
#include <cstdlib>
#include <fstream>
#include <numbers>
#include <string>
#include <system_error>
#include <utility>
#include <vector>

#include "hydro_stub/history.hpp"
#include "hydro_stub/lagrange/strength.hpp"
#include "hydro_stub/law_name.hpp"
#include "proto/wire/fields.hpp"
#include "proto/wire/progress.hpp"
#include "proto/wire/recording.hpp"
#include "proto/wire/scene_file.hpp"

namespace shearbus::hydro {
namespace {

using Clock = std::chrono::steady_clock;
using lagrange::Cycle;
using lagrange::Ledger;
using lagrange::Vec2;

double seconds(Clock::duration d) {
  return std::chrono::duration<double>(d).count();
}

// Histories of the interface nodes, and what the summary says of them.
class Interface {
 public:
  Interface(const std::filesystem::path& file, std::size_t nodes, const std::map<std::string, std::string>& meta)
      : writer_(file, node_ids(nodes), quantities(), meta), slip_(nodes, 0.0), radius_(nodes), height_(nodes) {}

  void observe(const Cycle& cycle) {
    const InterfaceInputs& in = cycle.contact().inputs();
    const InterfaceAnswer& answer = cycle.contact().answer();
    for (std::size_t i = 0; i < slip_.size(); ++i) {
      const auto regime = static_cast<std::size_t>(answer.regime[i]);
      ++regimes_[std::min(regime, regimes_.size() - 1)];
      hottest_ = std::max(hottest_, answer.interface_temperature[i]);
      highest_pressure_ = std::max(highest_pressure_, in.pressure[i]);
      if (in.pressure[i] > 0.0) slip_[i] += std::abs(answer.sliding_velocity[i]) * in.dt;
    }
  }

  void record(const Cycle& cycle) {
    const InterfaceInputs& in = cycle.contact().inputs();
    const InterfaceAnswer& answer = cycle.contact().answer();
    for (std::size_t i = 0; i < slip_.size(); ++i) {
      const Vec2 x = cycle.state().position[cycle.contact().weights().node(static_cast<int>(i))];
      radius_[i] = x.x;
      height_[i] = x.y;
    }
    writer_.begin_row(in.time);
    std::size_t q = 0;
    for (const std::vector<double>* values : std::initializer_list<const std::vector<double>*>{
             &answer.shear_stress, &answer.sliding_velocity, &answer.interface_temperature, &answer.velocity_jump_new,
             &in.pressure, &in.velocity_jump, &in.stress_minus, &in.stress_plus, &in.zone_temperature, &slip_, &radius_,
             &height_}) {
      writer_.set(q++, *values);
    }
    writer_.set(q, answer.regime);
    writer_.end_row();
  }

  void close() { writer_.close(); }
  double share(wire::Regime regime) const {
    double all = 0.0;
    for (const double n : regimes_) all += n;
    return all > 0.0 ? regimes_[static_cast<std::size_t>(regime)] / all : 0.0;
  }
  double hottest() const { return hottest_; }
  double highest_pressure() const { return highest_pressure_; }
  double longest_slip() const { return *std::ranges::max_element(slip_); }
  double mean_slip() const {
    double sum = 0.0;
    for (const double s : slip_) sum += s;
    return sum / static_cast<double>(slip_.size());
  }

 private:
  static std::vector<wire::Quantity> quantities() {
    return {{.name = "shear_stress", .units = "Pa", .long_name = "shear stress at the interface, during the step"},
            {.name = "sliding_velocity", .units = "m s-1", .long_name = "sliding velocity, mean of the step"},
            {.name = "interface_temperature", .units = "K", .long_name = "temperature of the interface"},
            {.name = "velocity_jump_new", .units = "m s-1", .long_name = "V_soft - V_hard as the law expects it"},
            {.name = "pressure", .units = "Pa", .long_name = "sent: pressure on the interface"},
            {.name = "velocity_jump", .units = "m s-1", .long_name = "sent: V_soft - V_hard at the start of the step"},
            {.name = "stress_minus", .units = "Pa", .long_name = "sent: shear stress of the soft body's zones"},
            {.name = "stress_plus", .units = "Pa", .long_name = "sent: shear stress of the hard body's zones"},
            {.name = "zone_temperature", .units = "K", .long_name = "of the soft zones at the interface"},
            {.name = "slip_distance", .units = "m", .long_name = "integral of |sliding velocity| while closed"},
            {.name = "radius", .units = "m", .long_name = "r of the node"},
            {.name = "height", .units = "m", .long_name = "z of the node"},
            {.name = "regime", .units = "1", .long_name = "what held the shear stress", .is_regime = true}};
  }

  wire::HistoryWriter writer_;
  std::vector<double> slip_, radius_, height_;
  std::array<double, 5> regimes_{};
  double hottest_ = 0.0;
  double highest_pressure_ = 0.0;
};

// The cone's back, from the axis outward.
class FreeSurface {
 public:
  FreeSurface(const std::filesystem::path& file, std::vector<int> nodes, const std::map<std::string, std::string>& meta)
      : nodes_(std::move(nodes)),
        writer_(file, node_ids(nodes_.size()),
                {{.name = "axial_velocity", .units = "m s-1", .long_name = "along the axis"},
                 {.name = "radius", .units = "m", .long_name = "r of the node"},
                 {.name = "height", .units = "m", .long_name = "z of the node"}},
                meta) {}

  void record(const Cycle& cycle) {
    std::vector<double> speed, radius, height;
    for (const int n : nodes_) {
      speed.push_back(cycle.state().velocity[n].y);
      radius.push_back(cycle.state().position[n].x);
      height.push_back(cycle.state().position[n].y);
    }
    writer_.begin_row(cycle.state().time);
    writer_.set(0, speed);
    writer_.set(1, radius);
    writer_.set(2, height);
    writer_.end_row();
  }
  void close() { writer_.close(); }

 private:
  std::vector<int> nodes_;
  wire::HistoryWriter writer_;
};

wire::FieldWriter field_writer(const std::filesystem::path& file, const lagrange::Mesh& mesh,
                               const std::string& scene) {
  std::vector<std::int32_t> quads;
  for (int z = 0; z < mesh.num_zones(); ++z) quads.insert(quads.end(), mesh.zone_nodes(z), mesh.zone_nodes(z) + 4);
  return {file,
          quads,
          static_cast<std::size_t>(mesh.num_nodes()),
          {{.name = "temperature", .units = "K", .long_name = "of the zone"},
           {.name = "pressure", .units = "Pa", .long_name = "compression positive"},
           {.name = "density", .units = "kg m-3", .long_name = "of the zone"},
           {.name = "plastic_strain", .units = "1", .long_name = "equivalent"},
           {.name = "equivalent_stress", .units = "Pa", .long_name = "von Mises"},
           {.name = "body", .units = "1", .long_name = "0 cone, 1 confinement, 2 flyer"}},
          scene};
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
  double total, solver, bus, output;
};

void finish(const std::filesystem::path& out, const wire::Scene& scene, const Cycle& cycle, const Ledger& start,
            const Interface& interface, const Times& times) {
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

}  // namespace

void run_cone_target(const wire::Scene& scene, const ConeTarget& problem, lagrange::Bodies bodies, InterfaceLaw& law,
                     const std::filesystem::path& out, bool progress) {
  // OpenMP's threads wait by spinning, which on a shared machine costs more than they bring: only those asked for.
  if (std::getenv("OMP_NUM_THREADS") == nullptr) omp_set_num_threads(1);
  std::filesystem::create_directories(out);
  wire::Scene effective = scene;
  effective.soft.given = physics::constants_of(problem.soft);
  effective.hard.given = physics::constants_of(problem.hard);
  const std::string text = wire::scene_to_toml(effective);
  const std::map<std::string, std::string> meta = {{"producer", "shearbus-hydro"},
                                                   {"scene", text},
                                                   {"scene_name", scene.name},
                                                   {"interface_law", name(scene.hydro->interface_law)}};
  const std::size_t nodes = interface_nodes(bodies);
  Cycle cycle(std::move(bodies), &law);
  const Ledger start = cycle.ledger();
  Interface interface(out / "interface.h5", nodes, meta);
  FreeSurface surface(out / "free_surface.h5", cycle.mesh().blocks()[ConeTarget::kCone].side(lagrange::Side::kTop),
                      meta);
  wire::FieldWriter fields = field_writer(out / "fields.h5", cycle.mesh(), text);

  constexpr std::size_t kBarParts = 10'000;  // steps are not known before; time is
  wire::Progress bar(scene.name, kBarParts, progress);
  const Clock::time_point begun = Clock::now();
  Clock::duration output{0};
  double next_row = 0.0;
  write_fields(fields, cycle);
  for (std::uint32_t frame = 1; frame <= problem.scene.frames; ++frame) {
    const double until =
        frame == problem.scene.frames ? problem.end_time : problem.end_time * frame / problem.scene.frames;
    while (cycle.state().time < until) {
      cycle.advance(until);
      const Clock::time_point stepped = Clock::now();
      interface.observe(cycle);
      if (cycle.state().time >= next_row) {
        interface.record(cycle);
        surface.record(cycle);
        next_row += problem.scene.history_interval_s;
      }
      output += Clock::now() - stepped;
      bar.at(static_cast<std::size_t>(static_cast<double>(kBarParts) * cycle.state().time / problem.end_time));
    }
    const Clock::time_point stepped = Clock::now();
    write_fields(fields, cycle);
    output += Clock::now() - stepped;
  }
  bar.clear();
  interface.close();
  surface.close();
  fields.close();
  const LawTime spent = law.time_spent();
  finish(out, scene, cycle, start, interface,
         {.total = seconds(Clock::now() - begun),
          .solver = seconds(spent.solver),
          .bus = seconds(spent.bus),
          .output = seconds(output)});
}

}  // namespace shearbus::hydro
