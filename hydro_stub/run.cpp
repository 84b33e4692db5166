#include "hydro_stub/run.hpp"

#include <fmt/format.h>

#include <stdexcept>

#include "hydro_stub/coulomb_tresca_law.hpp"
#include "hydro_stub/history.hpp"
#include "hydro_stub/profiles.hpp"
#include "hydro_stub/restart.hpp"
#include "hydro_stub/shear_column.hpp"
#include "hydro_stub/simple_laws.hpp"
#include "hydro_stub/summary.hpp"
#include "proto/files/whole_file.hpp"
#include "proto/program/interrupt.hpp"
#include "proto/program/program.hpp"
#include "proto/program/progress.hpp"
#include "proto/program/python.hpp"
#include "proto/scene/scene.hpp"
#include "proto/wire/status.hpp"
#include "proto/wire/text.hpp"

namespace shearbus::hydro {
std::unique_ptr<InterfaceLaw> make_law(const SceneFile& file, const physics::Material& soft,
                                       const physics::Material& hard, std::span<const double> initial_temperature,
                                       std::span<const double> layer_thickness, const SubgridServer& server,
                                       const std::string& kept) {
  const guest::HydroScene& scene = file.scene;
  if (initial_temperature.empty()) return std::make_unique<FreeSlipLaw>();
  switch (scene.hydro().interface_law()) {
    case guest::INTERFACE_LAW_COULOMB_TRESCA:
      return std::make_unique<CoulombTrescaLaw>(scene.hydro().coulomb_tresca(), soft, hard, initial_temperature);
    case guest::INTERFACE_LAW_FREE_SLIP:
      return std::make_unique<FreeSlipLaw>();
    case guest::INTERFACE_LAW_STICK:
      return std::make_unique<StickLaw>();
    case guest::INTERFACE_LAW_CONSTANT:
      if (!scene.hydro().has_constant_shear_stress_pa())
        refuse("hydro.constant_shear_stress_pa", "interface_law constant needs hydro.constant_shear_stress_pa",
               "give it, in Pa");
      return std::make_unique<ConstantFrictionLaw>(scene.hydro().constant_shear_stress_pa());
    default:
      break;
  }
  if (scene.scene().strategy() != v1::STRATEGY_FORCE_DRIVEN) {
    throw wire::Error(
        {.code = wire::Code::kInvalidScene,
         .text =
             "a hydrodynamic problem with interface_law subgrid sends far-field stresses and takes the jump back: it "
             "expects strategy force_driven",
         .remedy = "set strategy = \"force_driven\" and add [interface]",
         .field = "strategy"});
  }
  if (!kept.empty()) return std::make_unique<SubgridLaw>(kept, server);
  auto law =
      std::make_unique<SubgridLaw>(SceneText{file.server_text(), file.document.file},
                                   node_ids(initial_temperature.size()), initial_temperature, server, layer_thickness);
  for (const std::string& warning : law->warnings())
    program::complain(fmt::format("shearbus-hydro: {}", wire::labelled(warning)));
  return law;
}

void run(const guest::HydroScene& scene, const ColumnProblem& problem, InterfaceLaw& law,
         const std::filesystem::path& out, const server::Entries& provenance, bool progress) {
  using Clock = std::chrono::steady_clock;
  ShearColumn column(problem);
  remove_results(out);
  History history(out / "history.h5", problem, column, meta_of(scene, provenance));
  files::ProfileRecord profiles = profile_record(scene, problem.columns, law);
  Summary summary(problem, name(scene.hydro().interface_law()), provenance);
  program::Progress bar(problem.name, progress);

  RunTime time;
  const Clock::time_point start = Clock::now();
  program::stop_at_next_step(2);
  for (std::uint64_t step = 0; step < problem.steps; ++step) {
    if (program::interrupted()) {
      throw std::runtime_error(fmt::format("interrupted at step {} of {}; no result is written", step, problem.steps));
    }
    column.advance(law);
    const Clock::time_point stepped = Clock::now();
    summary.observe(column);
    history.record(column);
    record_profiles(profiles, column.inputs().time, column.inputs().pressure, law);
    time.output += Clock::now() - stepped;
    bar.at(step + 1, problem.steps);
  }
  const Clock::time_point stepped = Clock::now();
  history.close(profiles);
  time.output += Clock::now() - stepped;
  time.total = Clock::now() - start;
  bar.clear();

  time.law = law.time_spent();
  summary.finish(column, time);
  files::write_whole(out / "summary.json", files::kSummaryFile, summary.json());
  fmt::print("{}", summary.text());
  law.close();
  const OmittedCost omitted = law.omitted_cost();
  for (const auto& [label, value] : omitted.lines) fmt::print("  {:<24}{}\n", label, value);
  summary.omitted(omitted);
  files::write_whole(out / "summary.json", files::kSummaryFile, summary.json());
}

void plot(const std::filesystem::path& out, bool cone) {
  const std::string script = program::script("report", cone ? "plot_cone.py" : "plot_histories.py");
  if (program::run_python({script, out.string(), "--out", out.string()})) return;
  throw std::runtime_error(fmt::format(
      "the plots failed; the results are whole in {} (see the lines above, or run with --no-plot)", out.string()));
}

}  // namespace shearbus::hydro
