// Steps of one tile under the paper's conditions, for tests/bench/instructions.py:
//   shearbus-bench-steps CASE STEPS
// Force-driven cases: profile, modes, and plastic_layer, which flows. Velocity-driven cases: layer_shear,
// interface_slip, inertia, and the flow laws johnson_cook and preston_tonks_wallace.
// Ends with 77 on a machine without registers of four doubles, for which the counts are not meant.
#include <cstdlib>
#include <string_view>

#include "server/physics/layer/registers.hpp"
#include "tests/support/physics_rig.hpp"

int main(int argc, char** argv) {
  using namespace shearbus::testing;
  if (argc != 3) return 2;
  if (!machine_has_registers_of_four()) return 77;
  const std::string_view name = argv[1];
  const bool forced = name == "profile" || name == "modes" || name == "plastic_layer";
  ModelOptions options = graded(paper_options(forced ? Strategy::kForceDriven : Strategy::kVelocityDriven));
  if (name == "interface_slip") options.drive = Drive::kInterfaceSlip;
  options.inertia = name == "inertia";
  if (name == "modes") {
    options.grid.far_boundary = FarBoundary::kHalfSpace;
    options.modes = {.accuracy = 1e-3, .shortest_step = 1e-9, .longest_time = 1e-6};
  }
  if (name == "plastic_layer") {
    options.plastic_layer = true;
    options.interface.yield_strength = 400e6;
  }
  if (name == "johnson_cook") options.soft = make_material("copper_ofhc_jc", {}).material;
  if (name == "preston_tonks_wallace") options.soft = make_material("copper_ofhc_ptw", {}).material;
  Rig rig(options);
  rig.set_all(100.0, 11.2e9);
  for (int l = 0; l < kLanes; ++l) {
    rig.inputs.mass_soft[l] = 2703 * 2.5e-6;
    rig.inputs.mass_hard[l] = 7900 * 2.5e-6;
    rig.inputs.velocity_jump[l] += l;
  }
  for (int n = std::atoi(argv[2]); n > 0; --n) rig.step(1e-9);
  return 0;
}
