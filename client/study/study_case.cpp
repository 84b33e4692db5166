#include "client/study/study_case.hpp"

#include <algorithm>
#include <cmath>

#include "tests/support/two_half_spaces.hpp"

namespace shearbus::study {
namespace {

using physics::kLanes;

v1::Scene paper_scene(v1::Strategy strategy) {
  v1::Scene scene;
  scene.set_name("study");
  scene.set_strategy(strategy);
  scene.mutable_soft()->set_material("aluminium_dlp");
  scene.mutable_hard()->set_material("steel_dlp");
  if (strategy == v1::STRATEGY_FORCE_DRIVEN) {
    scene.mutable_interface()->set_friction_coefficient(0.3);
    scene.mutable_interface()->set_yield_strength_pa(200e6);
  }
  scene::fill_defaults(scene);
  return scene;
}

void set_all(double (&lanes)[kLanes], double value) {
  std::fill_n(lanes, kLanes, value);
}

// A host that imposes a constant velocity jump. In a force-driven scene its bodies are so heavy that friction does not
// change the jump.
class ImposedJump : public Host {
 public:
  explicit ImposedJump(const StudyCase& study_case) : case_(study_case) {}
  void load(double, double, physics::TileInputs& inputs) override {
    set_all(inputs.velocity_jump, case_.velocity_jump);
    set_all(inputs.pressure, case_.pressure);
    set_all(inputs.mass_soft, 1e9);
    set_all(inputs.mass_hard, 1e9);
  }
  void take(const physics::TileOutputs&) override {}

 private:
  const StudyCase& case_;
};

test::HalfSpaces volterra_of(const StudyCase& study_case) {
  return {.initial_jump = study_case.velocity_jump,
          .pressure = study_case.pressure,
          .friction_coefficient = study_case.scene.interface().friction_coefficient(),
          .yield_strength = study_case.scene.interface().yield_strength_pa()};
}

// Host of two elastic half-spaces with shear impedances Z. It computes the bodies by a leapfrog scheme at Courant
// number 1, at which the scheme is exact. Half a zone has the mass Z dt/2, and its far stress is that of the waves that
// the interface has emitted so far. The mean velocity jump of a step is then V0 - s (1/Z_soft + 1/Z_hard). The first
// step starts from the jump at the instant after the first contact.
class HalfSpaces : public Host {
 public:
  explicit HalfSpaces(const StudyCase& study_case) : pair_(volterra_of(study_case)) {
    jump_ = pair_.jump(pair_.limit(pair_.initial_temperature));
  }
  void load(double, double dt, physics::TileInputs& inputs) override {
    const double Z_soft = std::sqrt(pair_.density_soft * pair_.modulus_soft);
    const double Z_hard = std::sqrt(pair_.density_hard * pair_.modulus_hard);
    const double taken = (pair_.initial_jump - jump_) / (1.0 / Z_soft + 1.0 / Z_hard);
    set_all(inputs.velocity_jump, jump_);
    set_all(inputs.pressure, pair_.pressure);
    set_all(inputs.mass_soft, 0.5 * dt * Z_soft);
    set_all(inputs.mass_hard, 0.5 * dt * Z_hard);
    set_all(inputs.stress_soft, taken);
    set_all(inputs.stress_hard, taken);
  }
  void take(const physics::TileOutputs& outputs) override { jump_ = outputs.velocity_jump_new[0]; }

 private:
  test::HalfSpaces pair_;
  double jump_;
};

// Host of two plates under an alternating force, which makes them slide, stop, stick and slide in the other direction.
class Shaken : public Host {
 public:
  explicit Shaken(const StudyCase& study_case) : case_(study_case) {}
  void load(double time, double dt, physics::TileInputs& inputs) override {
    set_all(inputs.velocity_jump, jump_);
    set_all(inputs.pressure, case_.pressure);
    set_all(inputs.mass_soft, case_.mass);
    set_all(inputs.mass_hard, case_.mass);
    // The alternating stress is averaged over the step, so that runs with different step lengths receive the same
    // impulse.
    const double omega = 2.0 * std::acos(-1.0) * 2.5 / case_.end;
    const double mean = kPull * (std::cos(omega * time) - std::cos(omega * (time + dt))) / (omega * dt);
    set_all(inputs.stress_soft, mean);
    set_all(inputs.stress_hard, mean);
  }
  void take(const physics::TileOutputs& outputs) override { jump_ = outputs.velocity_jump_new[0]; }

 private:
  static constexpr double kPull = 500e6;  // amplitude of the far stresses of the two plates  [Pa]
  const StudyCase& case_;
  double jump_ = 0.0;
};

Reference constant_flux_reference(const StudyCase& study_case) {
  const double s = study_case.scene.interface().friction_coefficient() * study_case.pressure;
  const test::HalfSpaces pair = volterra_of(study_case);
  const double q = pair.heat_partition() * s * study_case.velocity_jump;
  return {.temperature =
              [=](double t) {
                return 300.0 +
                       2.0 * q / pair.conductivity_soft * std::sqrt(pair.diffusivity_soft * t / std::acos(-1.0));
              },
          .impulse = s * study_case.end,
          .work = s * study_case.velocity_jump * study_case.end,
          .uncertainty = 1e-15,
          .method = "exact: 2 q sqrt(alpha t / pi) / k"};
}

// Limit of a computed value as the grid spacing h goes to 0, extrapolated from three grids by eliminating first the
// error proportional to h^2, then that proportional to h^3. `change`: size of the second correction.
struct Limit {
  double value, change;
};
Limit limit_of(double coarse, double middle, double fine) {
  const double first = middle + (middle - coarse) / 3.0, second = fine + (fine - middle) / 3.0;
  return {second + (second - first) / 7.0, std::abs(second - first) / 7.0};
}

struct Integrals {
  double impulse = 0.0, work = 0.0;
};
Integrals integrals_of(const std::vector<test::HalfSpaceState>& states) {
  Integrals sum;
  for (std::size_t i = 1; i < states.size(); ++i) {
    const double dt = states[i].time - states[i - 1].time;
    sum.impulse += 0.5 * dt * (states[i].stress + states[i - 1].stress);
    sum.work += 0.5 * dt * (states[i].stress * states[i].jump + states[i - 1].stress * states[i - 1].jump);
  }
  return sum;
}

// Returns a reference solution from the Volterra equation, which `solve` solves by product integration. The solutions
// on three grids are extrapolated at the times of the coarsest grid. Between these times the temperature is
// interpolated with cubics in sqrt(t).
template <class Solve>
Reference from_volterra(const StudyCase& study_case, const Solve& solve) {
  constexpr int kCoarse = 400;
  const auto coarse = solve(kCoarse), middle = solve(2 * kCoarse), fine = solve(4 * kCoarse);
  Reference reference{.temperature = {}, .method = "Volterra equation, product integration, extrapolated"};
  std::vector<double> T;
  T.reserve(kCoarse + 1);
  for (std::size_t i = 0; i <= kCoarse; ++i) {
    const Limit limit = limit_of(coarse[i].temperature, middle[2 * i].temperature, fine[4 * i].temperature);
    T.push_back(limit.value);
    if (i >= kCoarse / 4) reference.time_error = std::max(reference.time_error, limit.change / 920.0);
  }
  reference.uncertainty = reference.time_error;
  reference.temperature = [T, end = study_case.end](double t) {
    const double x = std::sqrt(t / end) * kCoarse;
    const int first = std::clamp(static_cast<int>(x) - 1, 0, kCoarse - 3);
    double sum = 0.0;
    for (int i = 0; i < 4; ++i) {
      double weight = 1.0;
      for (int j = 0; j < 4; ++j)
        if (j != i) weight *= (x - (first + j)) / (i - j);
      sum += weight * T[static_cast<std::size_t>(first) + static_cast<std::size_t>(i)];
    }
    return sum;
  };
  const Integrals a = integrals_of(coarse), b = integrals_of(middle), c = integrals_of(fine);
  reference.impulse = limit_of(a.impulse, b.impulse, c.impulse).value;
  reference.work = limit_of(a.work, b.work, c.work).value;
  return reference;
}

Reference fixed_slip_reference(const StudyCase& study_case) {
  const test::HalfSpaces pair = volterra_of(study_case);
  return from_volterra(study_case, [&](int n) { return test::solve_braked_plates(pair, 0.0, study_case.end, n); });
}
Reference half_spaces_reference(const StudyCase& study_case) {
  const test::HalfSpaces pair = volterra_of(study_case);
  return from_volterra(study_case, [&](int n) { return test::solve_two_half_spaces(pair, study_case.end, n); });
}

template <class H>
std::unique_ptr<Host> make(const StudyCase& study_case) {
  return std::make_unique<H>(study_case);
}

}  // namespace

std::vector<StudyCase> fixed_cases() {
  std::vector<StudyCase> cases;
  v1::Scene scene = paper_scene(v1::STRATEGY_FORCE_DRIVEN);
  scene.mutable_layer()->set_far_boundary(v1::FAR_BOUNDARY_HALF_SPACE);

  StudyCase flux{.name = "constant_flux",
                 .title = "constant flux (exact)",
                 .scene = scene,
                 .end = 1e-6,
                 .host = make<ImposedJump>,
                 .exact = constant_flux_reference};
  flux.scene.clear_interface();
  flux.scene.mutable_interface()->set_friction_coefficient(0.05);
  flux.scene.mutable_interface()->set_yield_strength_pa(1e11);

  flux.velocity_jump = 200.0;
  flux.pressure = 1e9;
  cases.push_back(flux);
  cases.push_back({.name = "fixed_slip",
                   .title = "fixed slip, softening",
                   .scene = scene,
                   .end = 1e-6,
                   .host = make<ImposedJump>,
                   .exact = fixed_slip_reference});
  cases.push_back({.name = "two_half_spaces",
                   .title = "two half-spaces (coupled, stiff)",
                   .scene = scene,
                   .end = 300e-9,
                   .host = make<HalfSpaces>,
                   .exact = half_spaces_reference,
                   .coupled = true});
  cases.push_back({.name = "paper_velocity_driven",
                   .title = "paper's case, velocity-driven",
                   .scene = paper_scene(v1::STRATEGY_VELOCITY_DRIVEN),
                   .end = 1e-6,
                   .host = make<ImposedJump>});
  StudyCase shaken{
      .name = "stick_slip", .title = "stick-slip with reversals", .scene = scene, .end = 1e-6, .host = make<Shaken>};
  shaken.mass = 1.0;
  shaken.coupled = true;
  cases.push_back(shaken);
  return cases;
}

StudyCase case_of(const v1::Scene& scene, double velocity_jump, double pressure, double mass, double end) {
  StudyCase study_case{
      .name = scene.name(), .title = scene.name(), .scene = scene, .end = end, .host = make<ImposedJump>};
  study_case.velocity_jump = velocity_jump;
  study_case.pressure = pressure;
  study_case.mass = mass;
  return study_case;
}

}  // namespace shearbus::study
