/* The C library against a live server that this program starts, stops and kills: c_library SHEARBUS_SERVER SCENE.toml
 * Compiled as C99; every fault is printed, and the exit code is their number. */
#define _POSIX_C_SOURCE 200809L
#include <math.h>
#include <signal.h>
#include <stdlib.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

#include "host_checks.h"

enum { N = 6 };

static char directory[64] = "/tmp/shearbus-c-XXXXXX", endpoint[128];
static const char *program, *scene;

static pid_t start_server(void) {
  char state[96];
  const pid_t pid = fork();
  if (pid != 0) return pid;
  snprintf(state, sizeof state, "%s/state", directory);
  execl(program, program, "--bind", endpoint, "--state-dir", state, "--log-level", "error", (char*)NULL);
  _exit(127);
}
static int stop(pid_t pid, int signal_number) {
  int code = 0;
  kill(pid, signal_number);
  waitpid(pid, &code, 0);
  return code;
}

/* ---- a step of N nodes: the columns lie in an array of structs ---- */

static node nodes[N];
static uint64_t ids[N];
static shearbus_input inputs[6];
static shearbus_output outputs[4];

static void reset(void) {
  for (int i = 0; i < N; ++i) {
    const node fresh = {90.0 + i, 2e8 * (1 + i % 3), 1e6 * i, -1e6 * i, 4e-3, 12e-3, -1.0, -1.0, 99, 99};
    nodes[i] = fresh;
    ids[i] = 1000 + 7 * (uint64_t)i;
  }
  columns_of(nodes, inputs, outputs);
}
static shearbus_request request_of(int mode) {
  shearbus_request request = host_request(N, inputs, outputs, 4);
  request.mode = mode;
  return request;
}
static shearbus_options options_of(void) {
  return host_options(endpoint, scene, 20);
}
static shearbus_session* open_session(const char* domain, uint64_t first) {
  shearbus_session* session = NULL;
  shearbus_options options = options_of();
  options.domain = domain;
  reset();
  for (int i = 0; i < N; ++i) ids[i] += first;
  OK(shearbus_open(&session, &options, N, ids, NULL, &status));
  if (session == NULL) exit(1);
  return session;
}
static uint64_t last_sequence(const shearbus_session* session) {
  shearbus_info info = SHEARBUS_INFO_INIT;
  OK(shearbus_inspect(session, &info, &status));
  return info.last_sequence;
}
static int same_bits(const node* a, const node* b) {
  int same = 1;
  for (int i = 0; i < N; ++i)
    same = same && memcmp(&a[i].stress, &b[i].stress, 2 * sizeof(double)) == 0 && a[i].regime == b[i].regime;
  return same;
}
static void keep(node* to) {
  memcpy(to, nodes, sizeof nodes);
}

/* ---- the tests ---- */

static void names(void) {
  CHECK(strcmp(shearbus_code_name(SHEARBUS_INVALID_VALUE), "INVALID_VALUE") == 0);
  CHECK(strcmp(shearbus_code_name(SHEARBUS_NO_MEMORY), "NO_MEMORY") == 0);
  CHECK(strcmp(shearbus_code_name(12345), "?") == 0);
  CHECK(strcmp(shearbus_field_name(SHEARBUS_PRESSURE), "pressure_pa") == 0);
  CHECK(shearbus_field_name(9999) == NULL);
  CHECK(shearbus_field_number("interface_temperature_k") == SHEARBUS_INTERFACE_TEMPERATURE);
  CHECK(shearbus_field_number("no_such") == 0 && shearbus_field_number(NULL) == 0);
  CHECK(shearbus_version()[0] != '\0');
}

static void bad_openings(void) {
  shearbus_session* session = NULL;
  shearbus_options options = options_of();
  reset();
  REFUSED(shearbus_open(NULL, &options, N, ids, NULL, &status), SHEARBUS_INVALID_VALUE, "NULL");
  REFUSED(shearbus_open(&session, NULL, N, ids, NULL, &status), SHEARBUS_INVALID_VALUE, "shearbus_options is NULL");
  REFUSED(shearbus_open(&session, &options, N, NULL, NULL, &status), SHEARBUS_INVALID_VALUE, "node_ids is NULL");
  options.size = 8;
  REFUSED(shearbus_open(&session, &options, N, ids, NULL, &status), SHEARBUS_INVALID_VALUE, "shearbus_options.size");
  struct {
    shearbus_options known;
    double later;
  } grown = {SHEARBUS_OPTIONS_INIT, 0.0};
  grown.known = options_of();
  grown.known.size = sizeof grown;
  grown.later = 1.0;
  REFUSED(shearbus_open(&session, &grown.known, N, ids, NULL, &status), SHEARBUS_UNSUPPORTED, "shearbus_options has");
  options = options_of();
  options.scene_file = NULL;
  REFUSED(shearbus_open(&session, &options, N, ids, NULL, &status), SHEARBUS_INVALID_SCENE, "no scene");
  options.scene_file = "/nowhere/scene.toml";
  REFUSED(shearbus_open(&session, &options, N, ids, NULL, &status), SHEARBUS_INVALID_SCENE,
          "/nowhere/scene.toml: cannot be opened");
  options.scene_text = "strategy = 'force_driven'\n";
  REFUSED(shearbus_open(&session, &options, N, ids, NULL, &status), SHEARBUS_INVALID_SCENE, "both");
  options.scene_file = NULL;
  options.scene_text = "strategy = 'force_driven'\n[layer]\ncels = 3\n";
  REFUSED(shearbus_open(&session, &options, N, ids, NULL, &status), SHEARBUS_INVALID_SCENE, "scene_text:3:1");
  options = options_of();
  options.reply_deadline_s = -1;
  REFUSED(shearbus_open(&session, &options, N, ids, NULL, &status), SHEARBUS_INVALID_VALUE, "reply_deadline_s");
  options = options_of();
  options.state_dir = directory;
  REFUSED(shearbus_open(&session, &options, N, ids, NULL, &status), SHEARBUS_UNSUPPORTED, "state_dir");
  options = options_of();
  options.threads = 4000000000;
  options.endpoint = "embedded ";
  REFUSED(shearbus_open(&session, &options, N, ids, NULL, &status), SHEARBUS_INVALID_VALUE,
          "threads is 4000000000, expected at");
  options = options_of();
  options.check_closure = 7;
  REFUSED(shearbus_open(&session, &options, N, ids, NULL, &status), SHEARBUS_INVALID_VALUE, "check_closure is 7");
  options = options_of();
  options.endpoint = "carrier-pigeon";
  REFUSED(shearbus_open(&session, &options, N, ids, NULL, &status), SHEARBUS_UNREACHABLE, "not an endpoint");
  CHECK(strstr(status.remedy, "\"embedded\"") != NULL && strcmp(status.field, "endpoint") == 0);
  char of_file[128];
  snprintf(of_file, sizeof of_file, "ipc://%s", scene);
  options.endpoint = "file://";
  REFUSED(shearbus_open(&session, &options, N, ids, NULL, &status), SHEARBUS_UNREACHABLE, "not an endpoint");
  const char* const no_addresses[][2] = {{"tcp://*:5555", "a client cannot connect to this"},
                                         {"ipc:///tmp", "expected the socket of a server"},
                                         {of_file, "expected the socket of a server"}};
  for (int i = 0; i < 3; ++i) {
    options.endpoint = no_addresses[i][0];
    REFUSED(shearbus_open(&session, &options, N, ids, NULL, &status), SHEARBUS_UNREACHABLE, no_addresses[i][1]);
    CHECK(strstr(status.remedy, "the log of the server") != NULL && strcmp(status.field, "endpoint") == 0);
  }
  options.endpoint = "ipc:///tmp/shearbus-nobody-listens";
  options.connect_deadline_s = 0.2;
  REFUSED(shearbus_open(&session, &options, N, ids, NULL, &status), SHEARBUS_UNREACHABLE, "no server answered");
  options = options_of();
  ids[3] = ids[0];
  REFUSED(shearbus_open(&session, &options, N, ids, NULL, &status), SHEARBUS_DUPLICATE_NODE, "");
  CHECK(status.n_nodes == 1 && status.nodes[0] == ids[0]);
  CHECK(session == NULL);
  REFUSED(shearbus_commit(NULL, &status), SHEARBUS_INVALID_VALUE, "no session");
  CHECK(shearbus_open(&session, NULL, N, ids, NULL, NULL) == SHEARBUS_INVALID_VALUE); /* the status may be NULL */
  shearbus_status unset = {0};
  CHECK(shearbus_commit(NULL, &unset) == SHEARBUS_INVALID_VALUE && unset.text[0] == '\0');
  shearbus_leave(&session);
  OK(shearbus_close(&session, &status));
  CHECK(shearbus_node_count(NULL) == 0 && shearbus_node_ids(NULL) == NULL && shearbus_effective_scene(NULL)[0] == '\0');
}

static void bad_steps(void) {
  shearbus_session* session = open_session(NULL, 0);
  const uint64_t before = last_sequence(session);
  shearbus_request request = request_of(SHEARBUS_ADVANCE);
  request.n = N - 1;
  REFUSED(shearbus_step(session, &request, NULL, &status), SHEARBUS_SHAPE, "n is 5, and the session has 6 nodes");
  request = request_of(7);
  REFUSED(shearbus_step(session, &request, NULL, &status), SHEARBUS_INVALID_VALUE, "mode is 7");
  request = request_of(SHEARBUS_ADVANCE);
  request.n_inputs = 5;
  REFUSED(shearbus_step(session, &request, NULL, &status), SHEARBUS_SHAPE, "mass_hard_kg_per_m2");
  request.n_inputs = 6;
  inputs[5].field = SHEARBUS_MASS_SOFT;
  REFUSED(shearbus_step(session, &request, NULL, &status), SHEARBUS_SHAPE, "mass_soft_kg_per_m2 is given 2 times");
  inputs[5].field = SHEARBUS_SHEAR_STRESS;
  REFUSED(shearbus_step(session, &request, NULL, &status), SHEARBUS_UNSUPPORTED, "shear_stress_pa is no input");
  CHECK(strstr(status.remedy, "mass_hard_kg_per_m2") != NULL && strcmp(status.field, "shear_stress_pa") == 0);
  inputs[5].field = SHEARBUS_MASS_HARD;
  inputs[5].component = 1;
  REFUSED(shearbus_step(session, &request, NULL, &status), SHEARBUS_SHAPE, "1 component");
  reset();
  inputs[2].values = NULL;
  REFUSED(shearbus_step(session, &request, NULL, &status), SHEARBUS_INVALID_VALUE, "values is NULL");
  reset();
  outputs[1].field = 9999;
  REFUSED(shearbus_step(session, &request, NULL, &status), SHEARBUS_UNSUPPORTED, "column 9999 is no output");
  reset();
  nodes[4].pressure = NAN;
  REFUSED(shearbus_step(session, &request, NULL, &status), SHEARBUS_INVALID_VALUE, "pressure_pa");
  CHECK(status.n_nodes == 1 && status.nodes[0] == ids[4] && strcmp(status.field, "pressure_pa") == 0);
  reset();
  request.dt_s = 0.0;
  REFUSED(shearbus_step(session, &request, NULL, &status), SHEARBUS_INVALID_VALUE, "dt");
  request = request_of(SHEARBUS_ADVANCE);
  const uint64_t strangers[N] = {1, 2, 3, 4, 5, 6};
  request.node_ids = strangers;
  REFUSED(shearbus_step(session, &request, NULL, &status), SHEARBUS_UNKNOWN_NODE, "");
  REFUSED(shearbus_commit(session, &status), SHEARBUS_NOTHING_TO_COMMIT, "");
  REFUSED(shearbus_finish(session, NULL, &status), SHEARBUS_INVALID_VALUE, "a step is finished that was not started");
  REFUSED(shearbus_rollback_to(session, "never", &status), SHEARBUS_UNKNOWN_MARK, "never");
  CHECK(strstr(status.remedy, "mark first; the newest 2 are kept") != NULL);
  REFUSED(shearbus_mark(session, "", &status), SHEARBUS_INVALID_VALUE, "name");
  CHECK(last_sequence(session) == before);                                             /* nothing of it counted */
  for (int i = 0; i < N; ++i) CHECK(nodes[i].stress == -1.0 && nodes[i].regime == 99); /* nor was an output touched */
  OK(shearbus_close(&session, &status));
  CHECK(session == NULL);
}

static void steps(void) {
  node contiguous_answer[N], first[N], second[N], again[N];
  shearbus_session* session = open_session(NULL, 0);
  CHECK(shearbus_node_count(session) == N && memcmp(shearbus_node_ids(session), ids, sizeof ids) == 0);
  CHECK(strstr(shearbus_effective_scene(session), "thickness_m = ") != NULL);
  uint32_t columns[8];
  CHECK(shearbus_columns(session, SHEARBUS_REQUIRED_INPUT, 8, columns) == 6 && columns[0] == SHEARBUS_VELOCITY_JUMP);
  CHECK(shearbus_columns(session, SHEARBUS_OUTPUT_ON_REQUEST, 0, NULL) >= 9);
  OK(shearbus_mark(session, "start", &status));
  shearbus_request request = request_of(SHEARBUS_ADVANCE);
  shearbus_result result = SHEARBUS_RESULT_INIT;
  OK(shearbus_step(session, &request, &result, &status));
  CHECK(result.nodes == N && result.round_trip_ns > result.solver_ns);
  CHECK(nodes[0].stress > 0 && nodes[0].temperature > 300 && nodes[0].regime <= 4 && nodes[0].outcome != 99);
  keep(first);
  OK(shearbus_step(session, &request, NULL, &status));
  keep(second);
  CHECK(second[0].temperature > first[0].temperature);

  /* The same columns without strides, in halves: the same bits. */
  double flat[6][N], stress[N], temperature[N];
  for (int c = 0; c < 6; ++c)
    for (int i = 0; i < N; ++i) flat[c][i] = *(const double*)((const char*)inputs[c].values + (size_t)i * sizeof(node));
  shearbus_input flat_inputs[6];
  for (int c = 0; c < 6; ++c) {
    const shearbus_input input = {inputs[c].field, 0, flat[c], 0};
    flat_inputs[c] = input;
  }
  const shearbus_output flat_outputs[2] = {{SHEARBUS_SHEAR_STRESS, 0, stress, 0},
                                           {SHEARBUS_INTERFACE_TEMPERATURE, 0, temperature, 0}};
  shearbus_request flat_request = request;
  flat_request.inputs = flat_inputs;
  flat_request.outputs = flat_outputs;
  flat_request.n_outputs = 2;
  OK(shearbus_rollback_to(session, "start", &status));
  OK(shearbus_start(session, &flat_request, &status));
  REFUSED(shearbus_commit(session, &status), SHEARBUS_INVALID_VALUE, "has not been finished");
  memset(flat, 0, sizeof flat); /* the inputs were copied */
  OK(shearbus_finish(session, &result, &status));
  memcpy(contiguous_answer, first, sizeof first);
  for (int i = 0; i < N; ++i) {
    contiguous_answer[i].stress = stress[i];
    contiguous_answer[i].temperature = temperature[i];
  }
  CHECK(same_bits(contiguous_answer, first));

  /* A trial that is rolled back leaves no trace; a committed one is a step. */
  request.mode = SHEARBUS_TRIAL;
  nodes[2].jump = 1.0;
  OK(shearbus_step(session, &request, NULL, &status));
  OK(shearbus_rollback(session, &status));
  reset();
  OK(shearbus_step(session, &request, NULL, &status));
  OK(shearbus_commit(session, &status));
  keep(again);
  CHECK(same_bits(again, second));

  /* Some nodes, in another order: each row answers for its node. */
  OK(shearbus_rollback_to(session, "start", &status));
  node half[3] = {nodes[4], nodes[0], nodes[2]};
  const uint64_t half_ids[3] = {ids[4], ids[0], ids[2]};
  shearbus_input half_inputs[6];
  shearbus_output half_outputs[4];
  columns_of(half, half_inputs, half_outputs);
  shearbus_request some = request_of(SHEARBUS_ADVANCE);
  some.n = 3;
  some.node_ids = half_ids;
  some.inputs = half_inputs;
  some.outputs = half_outputs;
  OK(shearbus_step(session, &some, NULL, &status));
  CHECK(half[0].temperature == first[4].temperature && half[1].temperature == first[0].temperature &&
        half[2].temperature == first[2].temperature);

  /* The profiles of some nodes. The scene is force-driven with a rigid layer: it has no plastic strain. */
  size_t vertices = 0;
  const uint64_t two_ids[2] = {ids[4], ids[0]};
  OK(shearbus_profiles(session, 2, two_ids, NULL, NULL, 0, &vertices, &status));
  CHECK(vertices > 10 && vertices < 1000);
  double position[2000], heat[2000], strain[2000];
  const shearbus_output layers[3] = {{SHEARBUS_POSITION, 0, position, 0},
                                     {SHEARBUS_LAYER_TEMPERATURE, 0, heat, 0},
                                     {SHEARBUS_LAYER_PLASTIC_STRAIN, 0, strain, 0}};
  size_t room = vertices - 1;
  REFUSED(shearbus_profiles(session, 2, two_ids, NULL, layers, 3, &room, &status), SHEARBUS_SHAPE, "vertices");
  CHECK(room == vertices);
  OK(shearbus_profiles(session, 2, two_ids, NULL, layers, 3, &room, &status));
  CHECK(position[0] == 0.0 && position[vertices] == 0.0 && position[vertices - 1] > position[vertices - 2]);
  CHECK(heat[0] == first[4].temperature && heat[vertices] == first[0].temperature);
  CHECK(strain[0] != strain[0]);
  const shearbus_output wrong = {SHEARBUS_PRESSURE, 0, heat, 0};
  REFUSED(shearbus_profiles(session, 2, two_ids, NULL, &wrong, 1, &room, &status), SHEARBUS_SHAPE, "none of a profile");
  const uint64_t stranger = 999;
  REFUSED(shearbus_profiles(session, 1, &stranger, NULL, layers, 3, &room, &status), SHEARBUS_UNKNOWN_NODE, "");

  /* Nodes that come and go. */
  const uint64_t newcomers[2] = {5, 6};
  const double warm[2] = {310.0, 320.0};
  OK(shearbus_register(session, 2, newcomers, warm, &status));
  CHECK(shearbus_node_count(session) == N + 2 && shearbus_node_ids(session)[N + 1] == 6);
  REFUSED(shearbus_register(session, 1, newcomers, NULL, &status), SHEARBUS_DUPLICATE_NODE, "");
  OK(shearbus_retire(session, N, ids, &status));
  CHECK(shearbus_node_count(session) == 2 && shearbus_node_ids(session)[0] == 5);
  OK(shearbus_close(&session, &status));
}

static void moves_and_tickets(void) {
  node moved[N], stayed[N];
  char ticket[SHEARBUS_TICKET_BYTES];
  uint8_t transfer[SHEARBUS_TRANSFER_BYTES], offers[1][SHEARBUS_TRANSFER_BYTES];
  shearbus_request request = request_of(SHEARBUS_ADVANCE);
  shearbus_session* alone = open_session(NULL, 0);
  OK(shearbus_step(alone, &request, NULL, &status));
  OK(shearbus_step(alone, &request, NULL, &status));
  keep(stayed);
  OK(shearbus_close(&alone, &status));

  shearbus_session* giver = open_session("c_library", 0);
  shearbus_session* taker = open_session("c_library", 100000);
  reset();
  REFUSED(shearbus_register(taker, 1, ids, NULL, &status), SHEARBUS_NODE_OWNED, "");
  OK(shearbus_retire(taker, N, shearbus_node_ids(taker), &status));
  OK(shearbus_step(giver, &request, NULL, &status));
  OK(shearbus_offer(giver, N, ids, transfer, &status));
  CHECK(shearbus_node_count(giver) == 0);

  /* The giver's process ends; another one resumes the session and finds its offer. */
  OK(shearbus_ticket(giver, ticket, &status));
  CHECK(strlen(ticket) == 65);
  shearbus_leave(&giver);
  CHECK(giver == NULL);
  const shearbus_options options = options_of();
  REFUSED(shearbus_resume(&giver, &options, "abc", &status), SHEARBUS_INVALID_VALUE, "ticket");
  char forged[SHEARBUS_TICKET_BYTES];
  strcpy(forged, ticket);
  forged[64] = forged[64] == '0' ? '1' : '0';
  REFUSED(shearbus_resume(&giver, &options, forged, &status), SHEARBUS_RESUME_REFUSED, "");
  CHECK(giver == NULL);
  OK(shearbus_resume(&giver, &options, ticket, &status));
  CHECK(shearbus_offers(giver, 1, offers) == 1 && memcmp(offers[0], transfer, sizeof transfer) == 0);

  OK(shearbus_accept(taker, transfer, &status));
  CHECK(shearbus_node_count(taker) == N);
  OK(shearbus_step(taker, &request, NULL, &status));
  keep(moved);
  CHECK(same_bits(moved, stayed));
  REFUSED(shearbus_accept(taker, transfer, &status), SHEARBUS_UNKNOWN_TRANSFER, "");
  OK(shearbus_close(&giver, &status));
  OK(shearbus_close(&taker, &status));
}

/* What the user sets replaces what the host set, and the log says what was waited for. */
static int lines_told = 0;
static char last_line[256];
static void on_line(void* user, const char* line) {
  ++*(int*)user;
  snprintf(last_line, sizeof last_line, "%s", line);
}
static void environment(void) {
  char log_file[96], line[256] = "";
  snprintf(log_file, sizeof log_file, "%s/log", directory);
  shearbus_session* session = NULL;
  shearbus_options options = options_of();
  options.endpoint = "ipc:///nowhere/bus";
  options.scene_file = "/nowhere/scene.toml";
  setenv("SHEARBUS_ENDPOINT", endpoint, 1);
  setenv("SHEARBUS_SCENE", scene, 1);
  setenv("SHEARBUS_LOG", log_file, 1);
  OK(shearbus_open(&session, &options, N, ids, NULL, &status));
  OK(shearbus_close(&session, &status));
  REFUSED(shearbus_commit(session, &status), SHEARBUS_INVALID_VALUE, "or it is closed");
  setenv("SHEARBUS_SCENE", "nosuch", 1);
  REFUSED(shearbus_open(&session, &options, N, ids, NULL, &status), SHEARBUS_INVALID_SCENE, "SHEARBUS_SCENE");
  unsetenv("SHEARBUS_SCENE");
  options.scene_file = scene;
  setenv("SHEARBUS_ENDPOINT", "foo", 1);
  REFUSED(shearbus_open(&session, &options, N, ids, NULL, &status), SHEARBUS_UNREACHABLE, "SHEARBUS_ENDPOINT");
  setenv("SHEARBUS_ENDPOINT", "ipc:///tmp/shearbus-nobody-listens", 1);
  options.connect_deadline_s = 0.2;
  REFUSED(shearbus_open(&session, &options, N, ids, NULL, &status), SHEARBUS_UNREACHABLE, "SHEARBUS_ENDPOINT");
  options.connect_deadline_s = 0.0;
  setenv("SHEARBUS_ENDPOINT", endpoint, 1);
  setenv("SHEARBUS_SECRET_KEY_FILE", "nokey", 1);
  REFUSED(shearbus_open(&session, &options, N, ids, NULL, &status), SHEARBUS_AUTH, "SHEARBUS_SECRET_KEY_FILE");
  unsetenv("SHEARBUS_SECRET_KEY_FILE");
  unsetenv("SHEARBUS_ENDPOINT");
  /* A program whose command line decides. */
  options.endpoint = endpoint;
  options.scene_file = scene;
  options.ignore_environment = 1;
  setenv("SHEARBUS_ENDPOINT", "ipc:///nowhere/bus", 1);
  OK(shearbus_open(&session, &options, N, ids, NULL, &status));
  OK(shearbus_close(&session, &status));
  unsetenv("SHEARBUS_ENDPOINT");
  unsetenv("SHEARBUS_LOG");
  FILE* log = fopen(log_file, "r");
  CHECK(log != NULL && fgets(line, sizeof line, log) != NULL && strstr(line, "session of 6 nodes") != NULL);
  if (log != NULL) fclose(log);
}

/* A session with a short deadline, which counts the lines that the library says. */
static shearbus_session* open_with_lines(void) {
  shearbus_session* session = NULL;
  shearbus_options options = options_of();
  options.reply_deadline_s = 2.6; /* s; the library says after 2 s what it waits for */
  options.log = on_line;
  options.log_user = &lines_told;
  reset();
  OK(shearbus_open(&session, &options, N, ids, NULL, &status));
  return session;
}

/* A server that hangs, and one that is killed: the same call again is the same request, and the bits are those of a run
 * that nothing happened to. */
static void interruptions(pid_t* server) {
  node undisturbed[N], disturbed[N];
  shearbus_request request = request_of(SHEARBUS_ADVANCE);
  shearbus_session* calm = open_session(NULL, 0);
  for (int step = 0; step < 3; ++step) OK(shearbus_step(calm, &request, NULL, &status));
  keep(undisturbed);
  OK(shearbus_close(&calm, &status));

  shearbus_session* session = open_with_lines();
  const int told_before = lines_told;
  kill(*server, SIGSTOP);
  struct timespec before, after;
  clock_gettime(CLOCK_MONOTONIC, &before);
  const int code = shearbus_step(session, &request, NULL, &status);
  clock_gettime(CLOCK_MONOTONIC, &after);
  kill(*server, SIGCONT);
  CHECK(code == SHEARBUS_UNKNOWN_OUTCOME);
  CHECK(after.tv_sec - before.tv_sec < 10);
  CHECK(lines_told == told_before + 1 && strstr(last_line, "waiting for the answer of") != NULL &&
        strstr(last_line, "to the call step") != NULL);
  CHECK(nodes[0].stress == -1.0);
  OK(shearbus_step(session, &request, NULL, &status));
  CHECK(last_sequence(session) == 1); /* it ran once */
  OK(shearbus_step(session, &request, NULL, &status));
  char ticket[SHEARBUS_TICKET_BYTES];
  OK(shearbus_ticket(session, ticket, &status));
  shearbus_leave(&session);

  stop(*server, SIGKILL);
  *server = start_server();
  shearbus_options options = options_of();
  OK(shearbus_resume(&session, &options, ticket, &status));
  if (session == NULL) return;
  OK(shearbus_step(session, &request, NULL, &status));
  keep(disturbed);
  CHECK(same_bits(disturbed, undisturbed));
  OK(shearbus_close(&session, &status));
}

/* What a session tells of itself and of its server; the end of it by shearbus_end(). */
static void facts(void) {
  shearbus_request request = request_of(SHEARBUS_TRIAL);
  shearbus_result result = SHEARBUS_RESULT_INIT;
  shearbus_info info = SHEARBUS_INFO_INIT;
  shearbus_totals totals = SHEARBUS_TOTALS_INIT;
  shearbus_nodes told = SHEARBUS_NODES_INIT, given = SHEARBUS_NODES_INIT;
  const char* keys[] = {"interface.friction_coefficient"};
  const double friction[N] = {0.1, 0.2, 0.3, 0.1, 0.2, 0.3}, *values[] = {friction};
  shearbus_options options = options_of();
  shearbus_session* session = NULL;
  reset();
  given.n = N;
  given.node_ids = ids;
  given.n_parameters = 1;
  given.parameters = keys;
  given.values = values;
  OK(shearbus_open_nodes(&session, &options, &given, &status));
  CHECK(strcmp(shearbus_text(session, SHEARBUS_SCENE_NAME), "constant_friction") == 0);
  CHECK(strcmp(shearbus_text(session, SHEARBUS_PAIR_NAMES), "") == 0);
  CHECK(strcmp(shearbus_text(session, SHEARBUS_PARAMETER_KEYS), "interface.friction_coefficient\n") == 0);
  CHECK(strcmp(shearbus_text(session, SHEARBUS_SERVER_VERSION), shearbus_version()) == 0);
  CHECK(strstr(shearbus_text(session, SHEARBUS_CAPABILITIES), "parts_ahead\n") != NULL);
  CHECK(strcmp(shearbus_text(session, SHEARBUS_DURABILITY), "none") != 0);
  CHECK(strlen(shearbus_text(session, SHEARBUS_ACCESS)) > 0);
  CHECK(strcmp(shearbus_text(session, -1), "") == 0 && strcmp(shearbus_text(session, SHEARBUS_ACCESS + 1), "") == 0);
  CHECK(strcmp(shearbus_text(NULL, SHEARBUS_ACCESS), "") == 0);
  OK(shearbus_step(session, &request, &result, &status));
  CHECK(result.replayed == 0);
  OK(shearbus_commit(session, &status));
  OK(shearbus_mark(session, "one", &status));
  OK(shearbus_mark(session, "two", &status));
  CHECK(strcmp(shearbus_text(session, SHEARBUS_MARK_NAMES), "one\ntwo\n") == 0);
  OK(shearbus_inspect(session, &info, &status));
  CHECK(info.state_version == 1 && info.max_marks == 2 && info.max_rows_per_message >= 1000);
  OK(shearbus_resumed_nodes(session, &told, &status));
  CHECK(told.n == 0);
  char ticket[SHEARBUS_TICKET_BYTES];
  OK(shearbus_ticket(session, ticket, &status));
  shearbus_leave(&session);

  OK(shearbus_resume(&session, &options, ticket, &status));
  OK(shearbus_resumed_nodes(session, &told, &status));
  CHECK(told.n == N && memcmp(told.node_ids, ids, sizeof ids) == 0 && told.n_parameters == 1);
  CHECK(strcmp(told.parameters[0], keys[0]) == 0 && memcmp(told.values[0], friction, sizeof friction) == 0);
  OK(shearbus_inspect(session, &info, &status));
  CHECK(info.state_version == 1);
  REFUSED(shearbus_set_reply_deadline(session, -1.0, &status), SHEARBUS_INVALID_VALUE, "reply_deadline_s");
  OK(shearbus_set_reply_deadline(session, 5.0, &status));
  OK(shearbus_end(session, &totals, &status));
  CHECK(totals.node_steps == N && totals.requests >= 4);
  REFUSED(shearbus_end(session, &totals, &status), SHEARBUS_UNKNOWN_SESSION, "");
  shearbus_leave(&session);
  CHECK(session == NULL);
}

/* The answer to a question, or "". */
static const char* answer_to(shearbus_operator* of, int what, const char* named) {
  const char* answer = "";
  shearbus_question question = SHEARBUS_QUESTION_INIT;
  question.what = what;
  question.session = named;
  question.top = 1;
  question.count = 2;
  question.last_sequence = 1;
  OK(shearbus_ask(of, &question, &answer, &status));
  return answer;
}
/* What operators ask, of which this user is one; the whole text of a long fault. */
static void operators(void) {
  shearbus_operator* of = NULL;
  shearbus_session* session = NULL;
  shearbus_options options = options_of();
  shearbus_request request = request_of(SHEARBUS_ADVANCE);
  shearbus_question question = SHEARBUS_QUESTION_INIT;
  const char* answer = NULL;
  char named[33], ticket[SHEARBUS_TICKET_BYTES], count[32];
  reset();
  OK(shearbus_open(&session, &options, N, ids, NULL, &status));
  OK(shearbus_step(session, &request, NULL, &status));
  OK(shearbus_ticket(session, ticket, &status));
  snprintf(named, sizeof named, "%.32s", ticket);
  snprintf(count, sizeof count, "\"nodes\": %d", N);
  OK(shearbus_connect(&of, &options, &status));
  REFUSED(shearbus_connect(&of, &options, &status), SHEARBUS_INVALID_VALUE, "connected already");
  CHECK(strstr(answer_to(of, SHEARBUS_ASK_WELCOME, NULL), "\"access\": \"uid\"") != NULL);
  CHECK(strstr(answer_to(of, SHEARBUS_ASK_STATUS, NULL), "\"sessions\": 1,") != NULL);
  answer = answer_to(of, SHEARBUS_ASK_SESSIONS, NULL);
  CHECK(strstr(answer, named) != NULL && strstr(answer, count) != NULL);
  answer = answer_to(of, SHEARBUS_ASK_TOP, named);
  CHECK(strstr(answer, "\"matching\": 6, \"node_id\": [") != NULL && strstr(answer, "\"regime\": [") != NULL);
  question.what = 99;
  REFUSED(shearbus_ask(of, &question, &answer, &status), SHEARBUS_INVALID_VALUE, "what is 99");
  question.what = SHEARBUS_ASK_TOP;
  question.session = "7";
  REFUSED(shearbus_ask(of, &question, &answer, &status), SHEARBUS_INVALID_VALUE, "32 hexadecimal digits");
  CHECK(strstr(answer_to(of, SHEARBUS_ASK_CLOSE, named), "\"node_steps\": 6") != NULL);
  REFUSED(shearbus_step(session, &request, NULL, &status), SHEARBUS_UNKNOWN_SESSION, "");
  CHECK(strcmp(shearbus_fault_text(), status.text) == 0);
  shearbus_status empty;
  memset(&empty, 0, sizeof empty);  /* without its _INIT it has no place for a text */
  CHECK(shearbus_open(NULL, NULL, 0, NULL, NULL, &empty) == SHEARBUS_INVALID_VALUE);
  CHECK(strstr(shearbus_fault_text(), "shearbus_status") != NULL);
  shearbus_leave(&session);
  shearbus_disconnect(&of);
  CHECK(of == NULL);
  REFUSED(shearbus_ask(of, &question, &answer, &status), SHEARBUS_INVALID_VALUE, "no operator");

  char public_key[SHEARBUS_KEY_BYTES], secret_key[SHEARBUS_KEY_BYTES], text[4096] = "";
  OK(shearbus_make_keys(public_key, secret_key, &status));
  CHECK(strlen(public_key) == 40 && strlen(secret_key) == 40 && strcmp(public_key, secret_key) != 0);
  for (int i = 0; i < 60; ++i) snprintf(text + strlen(text), sizeof text - strlen(text), "unknown_key_%d = 1\n", i);
  options.scene_file = NULL;
  options.scene_text = text;
  options.scene_name = "keys.toml";
  REFUSED(shearbus_open(&session, &options, N, ids, NULL, &status), SHEARBUS_INVALID_SCENE, "keys.toml:1:1: ");
  CHECK(strlen(shearbus_fault_text()) > strlen(status.text) && strstr(shearbus_fault_text(), "unknown_key_30") != NULL);
}

/* A host in force-driven form whose scene is velocity-driven is told so. */
static void inputs_of_the_other_strategy(void) {
  shearbus_session* session = NULL;
  shearbus_options options = options_of();
  const shearbus_request request = request_of(SHEARBUS_ADVANCE);
  options.scene_file = NULL;
  options.scene_text =
      "name = 'driven'\nstrategy = 'velocity_driven'\n[soft]\nmaterial = 'aluminium_dlp'\n[hard]\nmaterial = "
      "'steel_dlp'\n"
      "[layer]\nthickness_m = 20e-6\ncells = 4\n";
  reset();
  OK(shearbus_open(&session, &options, N, ids, NULL, &status));
  REFUSED(shearbus_step(session, &request, NULL, &status), SHEARBUS_UNSUPPORTED, "stress_soft_pa is no input");
  CHECK(strstr(status.remedy, "strategy = \"velocity_driven\"") != NULL);
  OK(shearbus_close(&session, &status));
}

static int asked;
static int stops_at_the_third(void* user) {
  return ++*(int*)user >= 3;
}
/* A host that is told to stop ends a call that waits, and makes it again later. */
static void interrupted(pid_t server) {
  shearbus_session* session = NULL;
  shearbus_options options = options_of();
  shearbus_request request = request_of(SHEARBUS_ADVANCE);
  shearbus_result result = SHEARBUS_RESULT_INIT;
  options.interrupted = stops_at_the_third;
  options.interrupted_user = &asked;
  reset();
  OK(shearbus_open(&session, &options, N, ids, NULL, &status));
  asked = 0;
  kill(server, SIGSTOP);
  REFUSED(shearbus_step(session, &request, NULL, &status), SHEARBUS_UNKNOWN_OUTCOME, "");
  CHECK(asked == 3 && strstr(status.text, "interrupted") != NULL);
  kill(server, SIGCONT);
  asked = -1000;
  OK(shearbus_step(session, &request, &result, &status));
  CHECK(result.replayed == 1 && result.state_version == 1);
  OK(shearbus_close(&session, &status));
  options.endpoint = "file:///nowhere/at/all";
  asked = 0;
  REFUSED(shearbus_open(&session, &options, N, ids, NULL, &status), SHEARBUS_UNREACHABLE, "");
  CHECK(asked == 3 && session == NULL);
}

int main(int argc, char** argv) {
  if (argc != 3 || mkdtemp(directory) == NULL) return 2;
  program = argv[1];
  scene = argv[2];
  snprintf(endpoint, sizeof endpoint, "ipc://%s/bus", directory);
  pid_t server = start_server();
  names();
  bad_openings();
  bad_steps();
  inputs_of_the_other_strategy();
  steps();
  moves_and_tickets();
  environment();
  facts();
  operators();
  interrupted(server);
  interruptions(&server);
  const int code = stop(server, SIGTERM);
  CHECK(WIFEXITED(code) && WEXITSTATUS(code) == 0);
  char remove[96];
  snprintf(remove, sizeof remove, "rm -r '%s'", directory);
  CHECK(system(remove) == 0);
  if (faults == 0) printf("the C library keeps its contract\n");
  return faults == 0 ? 0 : 1;
}
