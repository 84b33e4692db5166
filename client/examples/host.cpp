// The example host of host.c in C++: two elastic half-spaces slide on each other at ten interface nodes, with a
// different pressure at each node. The velocity jump has an exact solution, with which run() compares it.
//
//   host SCENE.toml [ENDPOINT]      without an endpoint the server runs in this process
#include <array>
#include <cmath>
#include <cstdio>
#include <exception>
#include <iostream>
#include <shearbus/client.hpp>
#include <vector>

namespace {

constexpr std::size_t kNodes = 10, kZones = 80;
constexpr int kSteps = 60;
constexpr double kDt = 1e-9, kJump = 100.0, kFriction = 0.1;

// The half-space of one node: velocities at grid points and at half steps, stresses in zones and at full steps; index 0
// is at the interface. The time step kDt is the time that a shear wave takes across a zone.
struct HalfSpace {
  double density, modulus, sign;  // sign: +1 for the soft body, at z > 0; -1 for the hard body, at z < 0
  std::array<double, kZones + 1> velocity{};
  std::array<double, kZones> stress{};

  double impedance() const { return std::sqrt(density * modulus); }
  double zone() const { return kDt * impedance() / density; }
  double half_mass() const { return 0.5 * density * zone(); }
  void accelerate(double dt, double interface_stress) {
    velocity[0] += sign * dt / half_mass() * (stress[0] - interface_stress);
    for (std::size_t i = 1; i < kZones; ++i)
      velocity[i] += sign * dt / (density * zone()) * (stress[i] - stress[i - 1]);
  }
  void strain() {
    for (std::size_t i = 0; i < kZones; ++i)
      stress[i] += sign * kDt * modulus / zone() * (velocity[i + 1] - velocity[i]);
  }
};

double run(const shearbus::Options& options) {
  std::vector<HalfSpace> soft(kNodes, {2703.0, 27.6e9, 1.0}), hard(kNodes, {7900.0, 77e9, -1.0});
  std::vector<double> jump(kNodes), pressure(kNodes), stress(kNodes), temperature(kNodes);
  const std::vector<double> mass_soft(kNodes, soft[0].half_mass()), mass_hard(kNodes, hard[0].half_mass());
  shearbus::Ids ids(kNodes);
  for (std::size_t n = 0; n < kNodes; ++n) {
    ids[n] = 1 + n;
    pressure[n] = 100e6 * static_cast<double>(1 + n);
    soft[n].velocity.fill(kJump);
  }

  shearbus::Session bus(options, ids);
  shearbus::Step step(kNodes);
  step.in(SHEARBUS_VELOCITY_JUMP, jump)
      .in(SHEARBUS_PRESSURE, pressure)
      // the stress of zone 0, which the client reads directly from each HalfSpace
      .in_strided(SHEARBUS_STRESS_SOFT, soft[0].stress.data(), sizeof(HalfSpace))
      .in_strided(SHEARBUS_STRESS_HARD, hard[0].stress.data(), sizeof(HalfSpace))
      .in(SHEARBUS_MASS_SOFT, mass_soft)
      .in(SHEARBUS_MASS_HARD, mass_hard)
      .out(SHEARBUS_SHEAR_STRESS, stress)
      .out(SHEARBUS_INTERFACE_TEMPERATURE, temperature);

  for (int t = 0; t < kSteps; ++t) {
    const double dt = t == 0 ? 0.5 * kDt : kDt;  // velocities live at half steps: the first step is half as long
    for (std::size_t n = 0; n < kNodes; ++n) jump[n] = soft[n].velocity[0] - hard[n].velocity[0];
    bus.step(step.dt(dt));
    for (std::size_t n = 0; n < kNodes; ++n) {
      soft[n].accelerate(dt, stress[n]);
      hard[n].accelerate(dt, stress[n]);
      soft[n].strain();
      hard[n].strain();
    }
  }
  bus.close();

  double worst = 0.0;
  for (std::size_t n = 0; n < kNodes; ++n) {
    const double found = soft[n].velocity[0] - hard[n].velocity[0];
    const double exact = kJump - kFriction * pressure[n] * (1.0 / soft[n].impedance() + 1.0 / hard[n].impedance());
    worst = std::fmax(worst, std::fabs(found - exact));
    std::printf("node %2zu  P %5.0f MPa  [V] %.6f m/s  exact %.6f  T0 %.2f K\n", n + 1, pressure[n] / 1e6, found, exact,
                temperature[n]);
  }
  return worst;
}

}  // namespace

int main(int argc, char** argv) try {
  shearbus::Options options;
  options.scene_file = argc > 1 ? argv[1] : "constant_friction.toml";
  options.endpoint = argc > 2 ? argv[2] : "";
  return run(options) < 1e-6 ? 0 : 1;
} catch (const std::exception& fault) {
  std::cerr << fault.what() << '\n';
  return 1;
}
