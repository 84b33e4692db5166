// Steps of one tile under the paper's conditions, for tests/bench/instructions.py:
//   shearbus-bench-steps CASE STEPS
// Velocity-driven cases: layer_shear, interface_slip, inertia, and the flow laws johnson_cook and
// preston_tonks_wallace. All other cases are force-driven: profile, modes, sdirk2, sdirk2_modes, plastic_layer, which
// flows, plastic_layer_pulled, which flows on because far stresses pull thick zones, the same with a tolerance of 1e-3,
// plastic_layer_pulled_1e-3, junctions, and the friction laws "weakening" and "softening" with the options that follow in the name;
// "yields": under the paper's pressure.
// "velocity_driven: KEY" and "force_driven: KEY" are the steps of a model with one option of
// server/physics/solver/parts_table.hpp, force-driven under a jump that melts a film, and "velocity_driven without: KEY" the
// same without it; "options" lists these keys, one a line.
// Ends with 77 on a machine without registers of four doubles, for which the counts are not meant.
#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <optional>
#include <string_view>

#include "server/physics/layer/registers.hpp"
#include "tests/support/combinations.hpp"
#include "tests/support/physics_rig.hpp"

namespace shearbus::testing {
namespace {

// Jump under which the interface of a force-driven model melts within a microsecond, if the model has a melt film  [m/s].
constexpr double kMeltingJump = 300.0;
// Pressure under which the friction of the laws below is less than the yield strength of the interface  [Pa].
constexpr double kRubbing = 2e8;

struct Case {
  ModelOptions options;
  double pressure = 11.2e9;
  double jump = 100.0;
  double half_zone = 2.5e-6;  // half the width of the zones of the host  [m]
  double pull = 0.0;  // far stress of both zones; not 0: each step begins with the jump of the step before  [Pa]
};

void set_modes(ModelOptions& options) {
  options.grid.far_boundary = FarBoundary::kHalfSpace;
  options.modes = {.accuracy = 1e-3, .shortest_step = 1e-9, .longest_time = 1e-6};
}

Case case_of(std::string_view name) {
  const bool velocity_driven = name == "layer_shear" || name == "interface_slip" || name == "inertia" ||
                               name == "johnson_cook" || name == "preston_tonks_wallace";
  Case own{graded(paper_options(velocity_driven ? Strategy::kVelocityDriven : Strategy::kForceDriven))};
  ModelOptions& options = own.options;
  if (name == "interface_slip") options.drive = Drive::kInterfaceSlip;
  if (name == "johnson_cook") options.soft = make_material("copper_ofhc_jc", {}).material;
  if (name == "preston_tonks_wallace") options.soft = make_material("copper_ofhc_ptw", {}).material;
  options.inertia = name == "inertia";
  if (name.starts_with("plastic_layer")) {
    options.plastic_layer = true;
    options.interface.yield_strength = 400e6;
  }
  if (name.starts_with("plastic_layer_pulled")) {
    own.half_zone = 2.5e-4;
    own.pull = 3e8;
  }
  if (name == "plastic_layer_pulled_1e-3") options = discretised(options, 1e-3);
  if (name == "modes" || name == "sdirk2_modes") set_modes(options);
  if (name == "sdirk2" || name == "sdirk2_modes" || name == "softening_sdirk2")
    options.time_integrator = TimeIntegrator::kSdirk2;
  if (name == "junctions" || name == "junctions_softening") options.junctions = {0.5, 1e-7, options.soft};
  if (name == "weakening" || name == "weakening_yields") {
    options.interface.friction_law = FrictionLaws::place<VelocityWeakening>();
    options.interface.friction_coefficient_fast = 0.02;
    options.interface.velocity_decay = 0.01;
    if (name == "weakening") own.pressure = kRubbing;
  }
  if (name.find("softening") != std::string_view::npos) {
    options.interface.friction_law = FrictionLaws::place<ThermalSoftening>();
    options.interface.friction_reference_temperature = 300.0;
    options.interface.friction_softening_exponent = 2.0;
    if (name != "softening_yields") own.pressure = kRubbing;
  }
  return own;
}

// Options of a case of the kind "force_driven without: KEY"; nothing for other names, or where the strategy excludes the
// option.
std::optional<ModelOptions> options_of(std::string_view name) {
  const std::size_t colon = name.find(": ");
  if (colon == std::string_view::npos) return {};
  const bool forced = name.starts_with("force_driven");
  const bool without = name.substr(0, colon).ends_with(" without");
  const ModelOptions base = graded(paper_options(forced ? Strategy::kForceDriven : Strategy::kVelocityDriven));
  const std::vector<Item> all = items();
  for (const Item& item : all) {
    if (item.name != name.substr(colon + 2)) continue;
    const std::optional<WithItem> found = with_item(base, item, all);
    if (found) return without ? found->without : found->with;
  }
  return {};
}

}  // namespace
}  // namespace shearbus::testing

int main(int argc, char** argv) {
  using namespace shearbus::testing;
  if (argc == 2 && std::string_view(argv[1]) == "options") {
    for (const Part& part : parts())
      if (part.set != nullptr) std::puts(unique_key(part).c_str());
    return 0;
  }
  if (argc != 3) return 2;
  if (!machine_has_registers_of_four()) return 77;
  const std::string_view name = argv[1];
  const std::optional<ModelOptions> with_option = options_of(name);
  if (!with_option && name.find(": ") != std::string_view::npos) return 3;  // the strategy excludes the option
  Case own = with_option ? Case{.options = *with_option} : case_of(name);
  if (with_option && own.options.strategy == Strategy::kForceDriven) own.jump = kMeltingJump;
  Rig rig(own.options);
  rig.set_all(own.jump, own.pressure);
  for (int l = 0; l < kLanes; ++l) {
    rig.inputs.mass_soft[l] = 2703 * own.half_zone;
    rig.inputs.mass_hard[l] = 7900 * own.half_zone;
    rig.inputs.stress_soft[l] = rig.inputs.stress_hard[l] = own.pull;
    rig.inputs.velocity_jump[l] += l;
  }
  for (int n = std::atoi(argv[2]); n > 0; --n) {
    rig.step(1e-9);
    if (own.pull != 0.0) std::ranges::copy(rig.outputs.velocity_jump_new, rig.inputs.velocity_jump);
  }
  return 0;
}
