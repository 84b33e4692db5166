/* A host of shearbus in C: two elastic half-spaces slide on each other at ten interface nodes, with a different
 * pressure at each node. Velocities live at grid points and at half steps, stresses in zones and at full steps. dt
 * is the time that a shear wave takes across a zone, for which this scheme is exact. The host therefore finds the
 * exact velocity jump [V] = V0 - mu P (1/Z_soft + 1/Z_hard), with the initial jump V0, the friction coefficient mu,
 * the pressure P and the impedances Z = sqrt(density * modulus): 92.184 m/s at 500 MPa.
 *
 *   host SCENE.toml [ENDPOINT]      without an endpoint the server runs in this process */
#include <math.h>
#include <shearbus/shearbus.h>
#include <stdio.h>
#include <stdlib.h>

enum { NODES = 10, ZONES = 80, STEPS = 60 };

typedef struct body { /* the half-space of one node; index 0 is at the interface */
  double velocity[ZONES + 1];
  double stress[ZONES];
} body;

static const double kDt = 1e-9, kJump = 100.0, kFriction = 0.1;
static const double kDensity[2] = {2703.0, 7900.0}, kModulus[2] = {27.6e9, 77e9}; /* soft, hard */

static double impedance(int side) {
  return sqrt(kDensity[side] * kModulus[side]);
}

/* Moves the velocities inside a body by dt. sign: +1 for the soft body, at z > 0; -1 for the hard one, at z < 0. */
static void accelerate(body* b, int side, double sign, double dt) {
  const double dz = kDt * impedance(side) / kDensity[side];
  for (int i = 1; i < ZONES; ++i)
    b->velocity[i] += sign * dt / (kDensity[side] * dz) * (b->stress[i] - b->stress[i - 1]);
}
static void strain(body* b, int side, double sign) {
  const double dz = kDt * impedance(side) / kDensity[side];
  for (int i = 0; i < ZONES; ++i)
    b->stress[i] += sign * kDt * kModulus[side] / dz * (b->velocity[i + 1] - b->velocity[i]);
}

static void check(int code, const shearbus_status* status) {
  if (code == SHEARBUS_OK) return;
  fprintf(stderr, "%s: %s\n%s\n", shearbus_code_name(code), status->text, status->remedy);
  exit(1);
}

int main(int argc, char** argv) {
  static body soft[NODES], hard[NODES];
  uint64_t ids[NODES];
  double jump[NODES], pressure[NODES], mass_soft[NODES], mass_hard[NODES], stress[NODES], temperature[NODES];
  for (int n = 0; n < NODES; ++n) {
    ids[n] = 1 + n;
    pressure[n] = 100e6 * (1 + n);
    mass_soft[n] = 0.5 * kDt * impedance(0); /* mass of half a zone per area: density * dz / 2  [kg/m2] */
    mass_hard[n] = 0.5 * kDt * impedance(1);
    for (int i = 0; i <= ZONES; ++i) soft[n].velocity[i] = kJump;
  }

  shearbus_session* bus = NULL;
  shearbus_status status = SHEARBUS_STATUS_INIT;
  shearbus_options options = SHEARBUS_OPTIONS_INIT;
  options.scene_file = argc > 1 ? argv[1] : "constant_friction.toml";
  options.endpoint = argc > 2 ? argv[2] : NULL;
  check(shearbus_open(&bus, &options, NODES, ids, NULL, &status), &status);

  const shearbus_input inputs[] = {{SHEARBUS_VELOCITY_JUMP, 0, jump, 0},
                                   {SHEARBUS_PRESSURE, 0, pressure, 0},
                                   /* stress of zone 0 of each node, read where it lies */
                                   {SHEARBUS_STRESS_SOFT, 0, soft[0].stress, sizeof(body)},
                                   {SHEARBUS_STRESS_HARD, 0, hard[0].stress, sizeof(body)},
                                   {SHEARBUS_MASS_SOFT, 0, mass_soft, 0},
                                   {SHEARBUS_MASS_HARD, 0, mass_hard, 0}};
  const shearbus_output outputs[] = {{SHEARBUS_SHEAR_STRESS, 0, stress, 0},
                                     {SHEARBUS_INTERFACE_TEMPERATURE, 0, temperature, 0}};
  shearbus_request step = SHEARBUS_REQUEST_INIT;
  step.n = NODES;
  step.inputs = inputs;
  step.n_inputs = 6;
  step.outputs = outputs;
  step.n_outputs = 2;

  for (int t = 0; t < STEPS; ++t) {
    step.dt_s = t == 0 ? 0.5 * kDt : kDt; /* velocities live at half steps: the first step is half as long */
    step.time_s += step.dt_s;
    step.step = (uint64_t)t + 1;
    for (int n = 0; n < NODES; ++n) jump[n] = soft[n].velocity[0] - hard[n].velocity[0];
    check(shearbus_step(bus, &step, NULL, &status), &status);
    for (int n = 0; n < NODES; ++n) {
      soft[n].velocity[0] += step.dt_s / mass_soft[n] * (soft[n].stress[0] - stress[n]);
      hard[n].velocity[0] += step.dt_s / mass_hard[n] * (stress[n] - hard[n].stress[0]);
      accelerate(&soft[n], 0, 1.0, step.dt_s);
      accelerate(&hard[n], 1, -1.0, step.dt_s);
      strain(&soft[n], 0, 1.0);
      strain(&hard[n], 1, -1.0);
    }
  }

  double worst = 0.0;
  for (int n = 0; n < NODES; ++n) {
    const double found = soft[n].velocity[0] - hard[n].velocity[0];
    const double exact = kJump - kFriction * pressure[n] * (1.0 / impedance(0) + 1.0 / impedance(1));
    worst = fmax(worst, fabs(found - exact));
    printf("node %2d  P %5.0f MPa  [V] %.6f m/s  exact %.6f  T0 %.2f K\n", n + 1, pressure[n] / 1e6, found, exact,
           temperature[n]);
  }
  check(shearbus_close(&bus, &status), &status);
  return worst < 1e-6 ? 0 : 1;
}
