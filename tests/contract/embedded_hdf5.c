/* A host with the server in its process: embedded_hdf5 SCENE.toml [STATE_DIR]. It prints the file names of the HDF5
 * libraries that the process has loaded, one a line, after a step, a mark and a restart from it. */
#define _POSIX_C_SOURCE 200809L
#include <shearbus/shearbus.h>
#include <stdio.h>
#include <string.h>

static int refused(const shearbus_status* status) {
  return fprintf(stderr, "%s\n", status->text), 1;
}

int main(int argc, char** argv) {
  const uint64_t ids[] = {1};
  const double values[] = {100.0, 1e9, 0.0, 0.0, 4.3e-3, 12.3e-3};
  double stress = 0.0;
  shearbus_input inputs[6];
  const uint32_t fields[] = {SHEARBUS_VELOCITY_JUMP, SHEARBUS_PRESSURE,  SHEARBUS_STRESS_SOFT,
                             SHEARBUS_STRESS_HARD,   SHEARBUS_MASS_SOFT, SHEARBUS_MASS_HARD};
  for (int i = 0; i < 6; ++i) {
    const shearbus_input input = {fields[i], 0, &values[i], 0};
    inputs[i] = input;
  }
  const shearbus_output output = {SHEARBUS_SHEAR_STRESS, 0, &stress, 0};
  shearbus_session* bus = NULL;
  shearbus_status status = SHEARBUS_STATUS_INIT;
  shearbus_options options = SHEARBUS_OPTIONS_INIT;
  options.scene_file = argc > 1 ? argv[1] : NULL;
  options.state_dir = argc > 2 ? argv[2] : NULL;
  shearbus_request step = SHEARBUS_REQUEST_INIT;
  step.dt_s = 1e-9;
  step.n = 1;
  step.inputs = inputs;
  step.n_inputs = 6;
  step.outputs = &output;
  step.n_outputs = 1;
  char ticket[SHEARBUS_TICKET_BYTES];
  if (shearbus_open(&bus, &options, 1, ids, NULL, &status) || shearbus_step(bus, &step, NULL, &status) ||
      shearbus_mark(bus, "mark", &status) || shearbus_ticket(bus, ticket, &status))
    return refused(&status);
  if (options.state_dir != NULL) { /* the server ends, which writes a checkpoint, and another one reads it */
    shearbus_leave(&bus);
    if (shearbus_resume(&bus, &options, ticket, &status) || shearbus_rollback_to(bus, "mark", &status))
      return refused(&status);
  }
  if (shearbus_close(&bus, &status)) return refused(&status);
  if (stress != 1e8) return fprintf(stderr, "the stress is %g Pa, expected 1e8\n", stress), 1;
  FILE* maps = fopen("/proc/self/maps", "r");
  char line[4096], last[4096] = "";
  while (maps != NULL && fgets(line, sizeof line, maps) != NULL) {
    const char* name = strrchr(line, '/');
    if (name != NULL && strstr(name, "hdf5") != NULL && strcmp(name, last) != 0) printf("%s", strcpy(last, name) + 1);
  }
  return maps == NULL || fclose(maps) != 0;
}
