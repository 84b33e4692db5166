// The loops of a step over zones and nodes. Each zone and each node is computed by the same operations in the same order
// for any number of threads.
#include <omp.h>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <exception>
#include <limits>
#include <vector>

#include "hydro_stub/lagrange/cycle.hpp"
#include "hydro_stub/lagrange/hourglass.hpp"
#include "hydro_stub/lagrange/independent.hpp"

namespace shearbus::lagrange {
namespace {

constexpr double kHourglass = 0.1;  // coefficient of the hourglass forces
constexpr int kNoZone = std::numeric_limits<int>::max();

// Pointers to one quantity of the zones of a run each.
struct Prediction {
  const double* mass;
  const double* volume;
  const double* energy;
  const double* pressure;
  const double* heating;
  const double* xx;
  const double* yy;
  const double* xy;
  double* density_to;
  double* energy_to;
};

// Predicts density and energy after `half` a step; the old stresses and the heating of the last step do the work.
SHEARBUS_WIDE void predict_wide(int count, double half, const Prediction& p, int first, const Gradients& gradient) {
  const double* mass = p.mass;
  const double* volume = p.volume;
  const double* energy = p.energy;
  const double* pressure = p.pressure;
  const double* heating = p.heating;
  const double* s_xx = p.xx;
  const double* s_yy = p.yy;
  const double* s_xy = p.xy;
  const double* xx = gradient.xx.data() + first;
  const double* xy = gradient.xy.data() + first;
  const double* yx = gradient.yx.data() + first;
  const double* yy = gradient.yy.data() + first;
  const double* tt = gradient.tt.data() + first;
  double* __restrict density_to = p.density_to;
  double* __restrict energy_to = p.energy_to;
  SHEARBUS_INDEPENDENT
  for (int i = 0; i < count; ++i) {
    const double shear_power = s_xx[i] * (xx[i] - tt[i]) + s_yy[i] * (yy[i] - tt[i]) + s_xy[i] * (xy[i] + yx[i]);
    const double power = volume[i] * (shear_power - pressure[i] * (xx[i] + yy[i] + tt[i])) + heating[i];
    density_to[i] = mass[i] / volume[i];
    energy_to[i] = energy[i] + half * power / mass[i];
  }
}

struct Stress {
  const double* pressure;
  const double* xx;
  const double* yy;
  const double* xy;
};

// Stores the power of the corner forces so far, which heats the zone, and adds the forces of the stress.
SHEARBUS_WIDE void add_stress_wide(const Run& run, const Stress& stress, const RunNodes& velocity,
                                   const Geometry& geometry, CornerVectors& force, double* __restrict heating) {
  const double* pressure = stress.pressure + run.first;
  const double* s_xx = stress.xx + run.first;
  const double* s_yy = stress.yy + run.first;
  const double* s_xy = stress.xy + run.first;
  double power[Run::kMostZones] = {};
  for (int k = 0; k < 4; ++k) {
    const double* b_x = geometry.weights.x[k] + run.first;
    const double* b_y = geometry.weights.y[k] + run.first;
    const double* hoop = geometry.hoop[k] + run.first;
    double* __restrict f_x = force.x[k] + run.first;
    double* __restrict f_y = force.y[k] + run.first;
    const double* v_x = velocity.x[k / 2] + (k == 1 || k == 2 ? 1 : 0);
    const double* v_y = velocity.y[k / 2] + (k == 1 || k == 2 ? 1 : 0);
    SHEARBUS_INDEPENDENT
    for (int i = 0; i < run.count; ++i) {
      power[i] -= f_x[i] * v_x[i] + f_y[i] * v_y[i];
      const double xx = s_xx[i] - pressure[i];
      const double yy = s_yy[i] - pressure[i];
      const double tt = -(s_xx[i] + s_yy[i]) - pressure[i];
      f_x[i] -= xx * b_x[i] + s_xy[i] * b_y[i] + tt * hoop[i];
      f_y[i] -= s_xy[i] * b_x[i] + yy * b_y[i];
    }
  }
  std::copy_n(power, run.count, heating + run.first);
}

// The energy of the zones of a run after the work of their forces.
SHEARBUS_WIDE void do_work_wide(const Run& run, double dt, const RunNodes& velocity, const CornerVectors& force,
                                const double* mass, const double* energy, double* __restrict energy_to) {
  double power[Run::kMostZones] = {};
  for (int k = 0; k < 4; ++k) {
    const double* f_x = force.x[k] + run.first;
    const double* f_y = force.y[k] + run.first;
    const double* v_x = velocity.x[k / 2] + (k == 1 || k == 2 ? 1 : 0);
    const double* v_y = velocity.y[k / 2] + (k == 1 || k == 2 ? 1 : 0);
    SHEARBUS_INDEPENDENT
    for (int i = 0; i < run.count; ++i) power[i] -= f_x[i] * v_x[i] + f_y[i] * v_y[i];
  }
  SHEARBUS_INDEPENDENT
  for (int i = 0; i < run.count; ++i)
    energy_to[run.first + i] = energy[run.first + i] + dt * power[i] / mass[run.first + i];
}

// How many zones of a run have a volume that is not positive, or that changed by more than `most` of the old one.
SHEARBUS_WIDE long count_inverted(int count, const double* volume, const double* old, double most) {
  long inverted = 0;
  for (int i = 0; i < count; ++i) {
    const double change = std::abs(volume[i] - old[i]);
    const long positive = volume[i] > 0.0 ? 0 : 1;
    const long small = change <= most * old[i] ? 0 : 1;
    inverted += positive | small;
  }
  return inverted;
}

// The first of these zones.
int first_inverted(const Run& run, const std::vector<double>& volume, const std::vector<double>& old, double most) {
  if (count_inverted(run.count, &volume[run.first], &old[run.first], most) == 0) return kNoZone;
  int zone = run.first;
  while (count_inverted(1, &volume[zone], &old[zone], most) == 0) ++zone;
  return zone;
}

SHEARBUS_WIDE void accelerate_row(int count, double dt, const double* force_x, const double* force_y,
                                  const double* mass, const Vec2* velocity, Vec2* __restrict force,
                                  Vec2* __restrict velocity_new, Vec2* __restrict velocity_mean) {
  SHEARBUS_INDEPENDENT
  for (int i = 0; i < count; ++i) {
    const double scale = dt / mass[i];
    const double x = velocity[i].x + scale * force_x[i];
    const double y = velocity[i].y + scale * force_y[i];
    force[i].x = force_x[i];
    force[i].y = force_y[i];
    velocity_new[i].x = x;
    velocity_new[i].y = y;
    velocity_mean[i].x = 0.5 * (velocity[i].x + x);
    velocity_mean[i].y = 0.5 * (velocity[i].y + y);
  }
}

SHEARBUS_WIDE void find_sound_speeds(const Run& run, double four_thirds_g, const double* squared, const double* density,
                                     double* __restrict sound_speed) {
  SHEARBUS_INDEPENDENT
  for (int z = run.first; z < run.first + run.count; ++z)
    sound_speed[z] = std::sqrt(squared[z] + four_thirds_g / density[z]);
}

SHEARBUS_WIDE void divide(const Run& run, const double* mass, const double* volume, double* __restrict density) {
  SHEARBUS_INDEPENDENT
  for (int z = run.first; z < run.first + run.count; ++z) density[z] = mass[z] / volume[z];
}

SHEARBUS_WIDE void add_up(const Run& run, const Gradients& d, double* __restrict dilatation) {
  const double* xx = d.xx.data();
  const double* yy = d.yy.data();
  const double* tt = d.tt.data();
  SHEARBUS_INDEPENDENT
  for (int z = run.first; z < run.first + run.count; ++z) dilatation[z] = xx[z] + yy[z] + tt[z];
}

// Advances the stress deviators of the zones of a run with strength from those of `before` by dt.
void advance_run(const physics::Material& metal, const StrengthState& before, const Run& run, double dt,
                 std::vector<double>& xx, std::vector<double>& yy, std::vector<double>& xy, Strip& strip) {
  load(before, run, strip);
  advance_deviators(metal, dt, strip);
  std::copy_n(strip.xx, run.count, &xx[run.first]);
  std::copy_n(strip.yy, run.count, &yy[run.first]);
  std::copy_n(strip.xy, run.count, &xy[run.first]);
}

StrengthState strength_state(const State& state, const Gradients& gradient, const std::vector<double>& pressure) {
  return {gradient,
          state.plastic_strain.data(),
          pressure.data(),
          state.temperature.data(),
          state.deviator_xx.data(),
          state.deviator_yy.data(),
          state.deviator_xy.data()};
}

}  // namespace

// Returns false, with the first such zone in inverted_, if a zone is turned inside out.
bool Cycle::predict_middle(double dt) {
  const Mesh& mesh = bodies_.mesh;
  const int nodes = mesh.num_nodes();
  const std::vector<Run>& runs = mesh.runs();
  int inverted = kNoZone;
  shares_.hand_out(runs.size());
#pragma omp parallel if (mesh.num_zones() >= kFewestForThreads) reduction(min : inverted)
  {
#pragma omp for schedule(static)
    for (int n = 0; n < nodes; ++n) middle_position_[n] = state_.position[n] + (0.5 * dt) * state_.velocity[n];
    RunNodes at;
    shares_.work([&](std::size_t r) {
      mesh.load(middle_position_, runs[r], at);
      measure(mesh.symmetry(), runs[r], at, middle_);
      constexpr double kAnyChange = std::numeric_limits<double>::infinity();
      inverted = std::min(inverted, first_inverted(runs[r], middle_.volume, middle_.volume, kAnyChange));
      mesh.load(state_.velocity, runs[r], at);
      find_gradients(runs[r], middle_, at, gradient_);
      predict_run(runs[r], dt);
    });
  }
  if (inverted == kNoZone) return true;
  inverted_ = inverted;
  return false;
}

void Cycle::predict_run(const Run& run, double dt) {
  const double half = 0.5 * dt;
  const int z = run.first;
  predict_wide(run.count, half,
               {.mass = &state_.mass[z],
                .volume = &middle_.volume[z],
                .energy = &state_.energy[z],
                .pressure = &state_.pressure[z],
                .heating = &heating_[z],
                .xx = &state_.deviator_xx[z],
                .yy = &state_.deviator_yy[z],
                .xy = &state_.deviator_xy[z],
                .density_to = &middle_density_[z],
                .energy_to = &middle_energy_[z]},
               z, gradient_);
  if (material(run).strength) {
    Strip strip;
    advance_run(*material(run).strength, strength_state(state_, gradient_, state_.pressure), run, half, middle_xx_,
                middle_yy_, middle_xy_, strip);
    for (int i = 0; i < run.count; ++i) plastic_rate_[z + i] = strip.increment[i] / half;
  }
  material(run).eos.evaluate(run.count, &middle_density_[z], &middle_energy_[z], &middle_pressure_[z],
                             &sound_squared_[z]);
}

void Cycle::find_forces() {
  const Mesh& mesh = bodies_.mesh;
  const std::vector<Run>& runs = mesh.runs();
  const ViscousState viscous = {middle_, gradient_, middle_density_, state_.sound_speed, plastic_rate_};
  shares_.hand_out(runs.size());
#pragma omp parallel if (mesh.num_zones() >= kFewestForThreads)
  {
    RunNodes position, velocity;
// One thread prepares the contact, which has no parallel loops, before it begins with its zones.
#pragma omp master
    contact_.prepare(state_, middle_position_, guides_);
    shares_.work([&](std::size_t r) {
      mesh.load(middle_position_, runs[r], position);
      mesh.load(state_.velocity, runs[r], velocity);
      set_viscosity(mesh, material(runs[r]).eos.half_shock_slope(), runs[r], position, viscous, corner_force_,
                    viscous_rate_);
      add_hourglass(kHourglass, runs[r], position, velocity, middle_, middle_density_, state_.sound_speed,
                    corner_force_);
      add_stress_wide(runs[r],
                      {.pressure = middle_pressure_.data(),
                       .xx = middle_xx_.data(),
                       .yy = middle_yy_.data(),
                       .xy = middle_xy_.data()},
                      velocity, middle_, corner_force_, heating_new_.data());
    });
  }
}

void Cycle::accelerate(double dt) {
  const Mesh& mesh = bodies_.mesh;
  const std::vector<Mesh::NodeRow>& rows = mesh.node_rows();
#pragma omp parallel if (mesh.num_zones() >= kFewestForThreads)
  {
    std::vector<double> x(mesh.longest_row()), y(mesh.longest_row());
#pragma omp for schedule(static)
    for (std::size_t r = 0; r < rows.size(); ++r) {
      const int n = rows[r].first;
      mesh.gather(corner_force_, rows[r], x.data(), y.data());
      accelerate_row(rows[r].count, dt, x.data(), y.data(), &state_.node_mass[n], &state_.velocity[n], &node_force_[n],
                     &velocity_new_[n], &velocity_mean_[n]);
    }
  }
  const auto set = [&](int n, Vec2 velocity) {
    velocity_new_[n] = velocity;
    velocity_mean_[n] = 0.5 * (state_.velocity[n] + velocity);
  };
  for (std::size_t l = 0; l < bodies_.loads.size(); ++l) {
    load_force_[l] = pressure_forces(mesh, bodies_.loads[l], middle_position_);
    const std::vector<int>& loaded = bodies_.loads[l].nodes;
    for (std::size_t i = 0; i < loaded.size(); ++i)
      set(loaded[i], velocity_new_[loaded[i]] + (dt / state_.node_mass[loaded[i]]) * load_force_[l][i]);
  }
  for (const Wall& wall : bodies_.walls) {
    for (const int n : wall.nodes)
      set(n, velocity_new_[n] + (wall.speed - dot(velocity_new_[n], wall.normal)) * wall.normal);
  }
}

// Returns false, with the first such zone in inverted_, if the volume of a zone changes too much.
bool Cycle::go_to_end(double dt) {
  const Mesh& mesh = bodies_.mesh;
  const int nodes = mesh.num_nodes();
  const std::vector<Run>& runs = mesh.runs();
  const double most = 2.0 * bodies_.time_step.volume_change;
  int inverted = kNoZone;
  shares_.hand_out(runs.size());
#pragma omp parallel if (mesh.num_zones() >= kFewestForThreads) reduction(min : inverted)
  {
#pragma omp for schedule(static)
    for (int n = 0; n < nodes; ++n) {  // the slide lines have changed some velocities
      velocity_mean_[n] = 0.5 * (state_.velocity[n] + velocity_new_[n]);
      position_new_[n] = state_.position[n] + dt * velocity_mean_[n];
    }
    RunNodes at;
    shares_.work([&](std::size_t r) {
      mesh.load(position_new_, runs[r], at);
      measure_volumes(mesh.symmetry(), runs[r], at, volume_new_);
      inverted = std::min(inverted, first_inverted(runs[r], volume_new_, state_.volume, most));
      mesh.load(velocity_mean_, runs[r], at);
      do_work_wide(runs[r], dt, at, corner_force_, state_.mass.data(), state_.energy.data(), energy_new_.data());
    });
  }
  if (inverted == kNoZone) return true;
  inverted_ = inverted;
  return false;
}

// One thread does the contact, which has no parallel loops, while the others advance the deviators of zones that it
// does not move; between question and answer of the interface law it helps them.
void Cycle::slide(double dt) {
  const std::vector<Run>& runs = runs_[kInner];
  std::exception_ptr fault;
  const auto contact = [&](const auto& work) {
    try {
      if (!fault) work();
    } catch (...) {
      fault = std::current_exception();
    }
  };
  const auto advance = [&](std::size_t r) { advance_stress(dt, runs[r]); };
  shares_.hand_out(runs.size());
#pragma omp parallel if (bodies_.mesh.num_zones() >= kFewestForThreads)
  {
#pragma omp master
    {
      contact([&] { contact_.ask(state_, guides_, dt, steps_ + 1, law_, velocity_new_); });
      // Half of its zones are left for the other threads while this one works with the answer.
      const auto threads = static_cast<std::size_t>(omp_get_num_threads());
      if (threads > 1)
        shares_.work_own(runs.size() / (2 * threads), advance);
      else
        shares_.work(advance);
      contact([&] { contact_.answered(state_, guides_, dt, law_, velocity_new_); });
    }
    shares_.work(advance);
  }
  if (fault) std::rethrow_exception(fault);
}

// Ends a step whose zones have their new volumes. One thread adds the heat of the slide lines and the work of the
// ledger, which depend on no deviator.
void Cycle::finish_step(double dt) {
  const std::vector<Run>& rim = runs_[kRim];
  const std::vector<Run>& runs = bodies_.mesh.runs();
  shares_.hand_out(runs.size());
#pragma omp parallel if (bodies_.mesh.num_zones() >= kFewestForThreads)
  {
#pragma omp single nowait
    {
      contact_.deposit_heat(velocity_mean_, dt, state_.mass, state_.energy);
      book_boundaries(dt);
    }
#pragma omp for schedule(static)
    for (std::size_t r = 0; r < rim.size(); ++r) advance_stress(dt, rim[r]);
    shares_.work([&](std::size_t r) { update_run(runs[r]); });
  }
}

void Cycle::advance_stress(double dt, const Run& run) {
  RunNodes velocity;
  bodies_.mesh.load(velocity_mean_, run, velocity);
  find_gradients(run, middle_, velocity, gradient_);
  add_up(run, gradient_, dilatation_.data());
  if (!material(run).strength) return;
  Strip strip;
  advance_run(*material(run).strength, strength_state(state_, gradient_, middle_pressure_), run, dt, xx_new_, yy_new_,
              xy_new_, strip);
  const int z = run.first;
  for (int i = 0; i < run.count; ++i) plastic_strain_new_[z + i] = state_.plastic_strain[z + i] + strip.increment[i];
}

void Cycle::update_state() {
  for (const Run& run : bodies_.mesh.runs()) update_run(run);
}

// Finds density, pressure, sound speed and temperature from volume and energy.
void Cycle::update_run(const Run& run) {
  const BodyMaterial& body = material(run);
  const int z = run.first;
  divide(run, state_.mass.data(), state_.volume.data(), state_.density.data());
  body.eos.evaluate(run.count, &state_.density[z], &state_.energy[z], &state_.pressure[z], &sound_squared_[z]);
  const double shear_modulus = body.strength ? body.strength->shear_modulus : 0.0;
  find_sound_speeds(run, 4.0 / 3.0 * shear_modulus, sound_squared_.data(), state_.density.data(),
                    state_.sound_speed.data());
  body.eos.find_temperatures(run.count, &state_.density[z], &state_.energy[z], &state_.temperature[z]);
}

}  // namespace shearbus::lagrange
