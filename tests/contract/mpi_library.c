/* The MPI helpers against a live server. mpi.py starts this program on several ranks:
 *   mpi_library SCENE ENDPOINT DIRECTORY errors
 *   mpi_library SCENE ENDPOINT DIRECTORY run FROM TO open|restart|root [dump=STEP] [pause=STEP] [die]
 * `run` steps 24 nodes from step FROM to step TO, moves nodes between the ranks, and writes what was answered to
 * DIRECTORY/answers.FROM; it pauses on rank 0 until a line arrives, and dies by SIGKILL on all ranks. */
#define _POSIX_C_SOURCE 200809L
#include <shearbus/shearbus_mpi.h>
#include <signal.h>
#include <stdlib.h>

#include "host_checks.h"

/* shearbus_mpi.c is compiled with shearbus_open named so: an opening whose answer is lost on one rank. */
static int lose_answer = 0;
#undef shearbus_open
int shearbus_open(shearbus_session** session, const shearbus_options* options, size_t n, const uint64_t* node_ids,
                  const double* initial_temperature_k, shearbus_status* status);
int shearbus_open_by_test(shearbus_session** session, const shearbus_options* options, size_t n,
                          const uint64_t* node_ids, const double* initial_temperature_k, shearbus_status* to) {
  if (!lose_answer) return shearbus_open(session, options, n, node_ids, initial_temperature_k, to);
  lose_answer = 0;
  strcpy(to->text, "the answer is lost");
  return to->code = SHEARBUS_UNKNOWN_OUTCOME;
}

enum { N = 24, STEPS = 40 };

typedef struct answer {
  double stress, temperature;
  uint64_t regime;
} answer;
static int rank = 0, size = 1;
static const char *scene, *endpoint, *directory;
static node rows[N];
static answer answers[STEPS][N], all_answers[STEPS][N];

/* The code and a word of the text, which all ranks must have alike. */
#undef REFUSED
#define REFUSED(call, expected, word) refused(call, expected, word, __LINE__)
static void refused(int code, int expected, const char* word, int line) {
  shearbus_status of_rank_0 = status;
  MPI_Bcast(&of_rank_0, (int)sizeof of_rank_0, MPI_BYTE, 0, MPI_COMM_WORLD);
  if (code == expected && status.code == code && strstr(status.text, word) != NULL &&
      strstr(status.text, "rank ") == status.text && strcmp(status.text, of_rank_0.text) == 0 &&
      strcmp(status.remedy, of_rank_0.remedy) == 0)
    return;
  fprintf(stderr, "rank %d, line %d: %s \"%s\", expected %s \"rank ...%s...\", and rank 0 has \"%s\"\n", rank, line,
          shearbus_code_name(code), status.text, shearbus_code_name(expected), word, of_rank_0.text);
  ++faults;
}
#undef OK
#define OK(call) must(call, #call, __LINE__)
static void must(int code, const char* what, int line) {
  if (code == SHEARBUS_OK) return;
  fprintf(stderr, "rank %d, line %d: %s gave %s: %s (%s)\n", rank, line, what, shearbus_code_name(code), status.text,
          status.remedy);
  MPI_Abort(MPI_COMM_WORLD, 1);
}

static shearbus_options options_of(void) {
  return host_options(endpoint, scene, 20);
}

/* The rank of a node, at random: another one after every move, and some ranks may have none. */
static int owner_of(uint64_t node, int move) {
  uint64_t x = (node + 1) * 0x9e3779b97f4a7c15u + (uint64_t)move * 0xd1b54a32d192ed03u;
  x ^= x >> 29;
  x *= 0xbf58476d1ce4e5b9u;
  return (int)((x >> 33) % (uint64_t)size);
}
static size_t nodes_of(int which, int move, uint64_t* ids) {
  size_t n = 0;
  for (uint64_t node = 0; node < N; ++node)
    if (owner_of(node, move) == which) ids[n++] = node;
  return n;
}

/* ---- a step: inputs that depend on the node and the step alone ---- */

static shearbus_input inputs[6];
static shearbus_output outputs[4];
static shearbus_request request_of(int step, size_t n, const uint64_t* ids, int with_ids) {
  for (size_t i = 0; i < n; ++i) {
    const double x = (double)ids[i], t = (double)step;
    const node fresh = {
        40.0 + 3 * x - 0.5 * t, 1e8 * (1 + x / 4), 1e6 * (x - t), -1e6 * x, 4e-3, 12e-3, -1, -1, 99, 99};
    rows[i] = fresh;
  }
  columns_of(rows, inputs, outputs);
  shearbus_request request = host_request(n, inputs, outputs, 4);
  request.step = (uint64_t)step;
  request.node_ids = with_ids ? ids : NULL;
  return request;
}
static void keep(int step, size_t n, const uint64_t* ids) {
  for (size_t i = 0; i < n; ++i) {
    const answer one = {rows[i].stress, rows[i].temperature, rows[i].regime};
    answers[step][ids[i]] = one;
  }
}

static void path_of(const char* name, int number, char* to, size_t bytes) {
  snprintf(to, bytes, "%s/%s.%d", directory, name, number);
}

static void write_answers(int from, int to) {
  char path[256];
  MPI_Reduce(answers, all_answers, (int)(sizeof answers / sizeof(uint64_t)), MPI_UINT64_T, MPI_BOR, 0, MPI_COMM_WORLD);
  if (rank != 0) return;
  path_of("answers", from, path, sizeof path);
  FILE* file = fopen(path, "wb");
  const size_t steps = (size_t)(to - from);
  CHECK(file != NULL && fwrite(all_answers[from], sizeof answers[0], steps, file) == steps && fclose(file) == 0);
}

static void run(int from, int to, const char* how, int dump, int pause, int die) {
  shearbus_mpi* ranks = NULL;
  shearbus_session* bus = NULL;
  const shearbus_options options = options_of();
  uint64_t ids[N];
  int owner[N];
  char manifest[256];
  const int on_root = strcmp(how, "root") == 0;
  path_of("tickets", 0, manifest, sizeof manifest);
  size_t n = nodes_of(rank, 100 + size, ids);
  if (on_root)
    OK(shearbus_mpi_open_on_root(&ranks, MPI_COMM_WORLD, &bus, &options, n, ids, NULL, &status));
  else if (strcmp(how, "open") == 0)
    OK(shearbus_mpi_open(&ranks, MPI_COMM_WORLD, &bus, &options, n, ids, NULL, &status));
  else
    OK(shearbus_mpi_restart(&ranks, MPI_COMM_WORLD, &bus, &options, manifest, n, ids, &status));
  for (int step = from; step < to; ++step) {
    if (step == dump) OK(shearbus_mpi_dump(ranks, bus, "the dump", manifest, &status));
    if (step == pause && rank == 0) {
      printf("paused\n");
      fflush(stdout);
      CHECK(getchar() != EOF);
    }
    if (on_root) {
      if (step % 2 == 1) /* the rows in another order */
        for (size_t i = 0; i < n / 2; ++i) {
          const uint64_t first = ids[i];
          ids[i] = ids[n - 1 - i];
          ids[n - 1 - i] = first;
        }
      shearbus_result result = SHEARBUS_RESULT_INIT;
      const shearbus_request request = request_of(step, n, ids, step % 4 == 1 || step % 4 == 2);
      OK(shearbus_mpi_step_on_root(ranks, bus, &request, &result, &status));
      CHECK(result.nodes == N && (bus != NULL) == (rank == 0));
    } else {
      if (step % 7 == 3) {
        for (size_t i = 0; i < n; ++i) owner[i] = owner_of(shearbus_node_ids(bus)[i], step);
        OK(shearbus_mpi_redistribute(ranks, bus, owner, &status));
        CHECK(shearbus_node_count(bus) == nodes_of(rank, step, ids));
      }
      n = shearbus_node_count(bus);
      if (n > 0) memcpy(ids, shearbus_node_ids(bus), n * sizeof ids[0]);
      const shearbus_request request = request_of(step, n, ids, 0);
      OK(shearbus_step(bus, &request, NULL, &status));
    }
    keep(step, n, ids);
  }
  write_answers(from, to);
  MPI_Barrier(MPI_COMM_WORLD);
  if (die) { /* in the middle of a move: an offer waits that nobody accepts */
    uint8_t transfer[SHEARBUS_TRANSFER_BYTES];
    if (shearbus_node_count(bus) > 0) OK(shearbus_offer(bus, 1, shearbus_node_ids(bus), transfer, &status));
    MPI_Barrier(MPI_COMM_WORLD);
    raise(SIGKILL);
  }
  OK(shearbus_mpi_close(&ranks, &bus, &status));
  CHECK(ranks == NULL && bus == NULL);
}

/* ---- faults of one rank ---- */

static void openings(void) {
  shearbus_mpi* ranks = NULL;
  shearbus_session* bus = NULL;
  const int last = rank == size - 1;
  const uint64_t twice[2] = {last ? 1u : 1u + 10u * (uint64_t)rank, 2u + 10u * (uint64_t)rank};
  const uint64_t ids[2] = {1u + 10u * (uint64_t)rank, 2u + 10u * (uint64_t)rank};
  shearbus_options options = options_of();
  REFUSED(shearbus_mpi_open(&ranks, MPI_COMM_WORLD, &bus, &options, 2, twice, NULL, &status), SHEARBUS_NODE_OWNED, "");
  CHECK(ranks == NULL && bus == NULL);
  if (last) options.scene_file = "/nowhere.toml";
  REFUSED(shearbus_mpi_open(&ranks, MPI_COMM_WORLD, &bus, &options, 2, ids, NULL, &status), SHEARBUS_INVALID_SCENE,
          "/nowhere.toml");
  options = options_of();
  if (last) options.endpoint = "ipc:///tmp/shearbus-nobody-listens";
  options.connect_deadline_s = last ? 0.2 : 20;
  REFUSED(shearbus_mpi_open(&ranks, MPI_COMM_WORLD, &bus, &options, 2, ids, NULL, &status), SHEARBUS_UNREACHABLE,
          "no server answered");
  options = options_of();
  options.endpoint = "embedded";
  REFUSED(shearbus_mpi_open(&ranks, MPI_COMM_WORLD, &bus, &options, 2, ids, NULL, &status), SHEARBUS_UNSUPPORTED,
          "nodes cannot move");
  REFUSED(shearbus_mpi_open(&ranks, MPI_COMM_WORLD, &bus, last ? NULL : &options, 2, last ? NULL : ids, NULL, &status),
          SHEARBUS_UNSUPPORTED, "");
  CHECK(ranks == NULL && bus == NULL);

  /* The domain is that of the job and its attempt. */
  options = options_of();
  setenv("SLURM_JOB_ID", "77", 1);
  setenv("SLURM_RESTART_COUNT", "2", 1);
  OK(shearbus_mpi_open(&ranks, MPI_COMM_WORLD, &bus, &options, 2, ids, NULL, &status));
  CHECK(strcmp(shearbus_mpi_domain(ranks), "slurm-77-2-0") == 0 && shearbus_mpi_rank(ranks) == rank);
  REFUSED(shearbus_mpi_open(&ranks, MPI_COMM_WORLD, &bus, &options, 2, ids, NULL, &status), SHEARBUS_INVALID_VALUE,
          "open already");
  OK(shearbus_mpi_close(&ranks, &bus, &status));
  unsetenv("SLURM_JOB_ID");
  setenv("PBS_JOBID", "5.server", 1);
  OK(shearbus_mpi_open(&ranks, MPI_COMM_WORLD, &bus, &options, 0, NULL, NULL, &status));
  CHECK(strncmp(shearbus_mpi_domain(ranks), "pbs-5.server-", 13) == 0 && strlen(shearbus_mpi_domain(ranks)) == 13 + 16);
  OK(shearbus_mpi_close(&ranks, &bus, &status));
  unsetenv("PBS_JOBID");
}

/* An opening in doubt comes before a refusal, and the same call opens all sessions in the same domain. */
static void opening_in_doubt(void) {
  shearbus_mpi* ranks = NULL;
  shearbus_session* bus = NULL;
  shearbus_options options = options_of();
  const uint64_t id = (uint64_t)rank;
  char domain[200] = "";
  lose_answer = rank == size - 1;
  if (rank == 0) options.scene_file = "/nowhere.toml";
  REFUSED(shearbus_mpi_open(&ranks, MPI_COMM_WORLD, &bus, &options, 1, &id, NULL, &status), SHEARBUS_UNKNOWN_OUTCOME,
          "the answer is lost");
  CHECK(ranks != NULL && bus == NULL);
  snprintf(domain, sizeof domain, "%s", shearbus_mpi_domain(ranks));
  options = options_of();
  OK(shearbus_mpi_open(&ranks, MPI_COMM_WORLD, &bus, &options, 1, &id, NULL, &status));
  CHECK(strlen(domain) == 20 && strcmp(domain, shearbus_mpi_domain(ranks)) == 0 && shearbus_node_count(bus) == 1);
  OK(shearbus_mpi_close(&ranks, &bus, &status));
}

static void moves(void) {
  shearbus_mpi* ranks = NULL;
  shearbus_session* bus = NULL;
  const shearbus_options options = options_of();
  uint64_t ids[N];
  int owner[N] = {0};
  char manifest[256], text[4096];
  const int last = rank == size - 1;
  size_t n = nodes_of(rank, 0, ids);
  OK(shearbus_mpi_open(&ranks, MPI_COMM_WORLD, &bus, &options, n, ids, NULL, &status));
  CHECK(strncmp(shearbus_mpi_domain(ranks), "mpi-", 4) == 0);
  REFUSED(shearbus_mpi_agree(ranks, last ? SHEARBUS_STEP_FAILED : SHEARBUS_OK, &status), SHEARBUS_STEP_FAILED, "");
  OK(shearbus_mpi_agree(ranks, SHEARBUS_OK, &status));

  for (size_t i = 0; i < n; ++i) owner[i] = owner_of(ids[i], 1);
  if (n > 0 && rank == owner_of(0, 0)) owner[0] = size;
  REFUSED(shearbus_mpi_redistribute(ranks, bus, owner, &status), SHEARBUS_INVALID_VALUE, "new_owner of node");
  for (size_t i = 0; i < n; ++i) owner[i] = owner_of(ids[i], 1);
  /* One giver is refused, and one taker: the nodes are where they were. */
  const shearbus_request request = request_of(0, n, ids, 0);
  shearbus_request trial = request;
  trial.mode = SHEARBUS_TRIAL;
  if (rank == 0) OK(shearbus_step(bus, &trial, NULL, &status));
  REFUSED(shearbus_mpi_redistribute(ranks, bus, owner, &status), SHEARBUS_TRIAL_STANDS, "rank 0");
  CHECK(shearbus_node_count(bus) == n);
  if (rank == 0) OK(shearbus_rollback(bus, &status));
  if (size > 1) { /* rank 0 only takes here, from a rank whose offers it refuses */
    int to_0[N] = {0};
    for (size_t i = 0; i < n; ++i) to_0[i] = rank == size - 1 && i == 0 ? 0 : rank;
    const uint64_t* now = shearbus_node_ids(bus);
    const uint64_t moved = now == NULL ? 0 : now[0];
    if (rank == 0) OK(shearbus_step(bus, &trial, NULL, &status));
    REFUSED(shearbus_mpi_redistribute(ranks, bus, to_0, &status), SHEARBUS_TRIAL_STANDS, "rank 0");
    CHECK(shearbus_node_count(bus) == n);
    if (last) CHECK(shearbus_node_ids(bus)[n - 1] == moved); /* taken back, as the last one */
    if (rank == 0) OK(shearbus_rollback(bus, &status));
    n = shearbus_node_count(bus);
  }
  for (size_t i = 0; i < n; ++i) owner[i] = owner_of(shearbus_node_ids(bus)[i], 1);
  OK(shearbus_mpi_redistribute(ranks, bus, owner, &status));
  CHECK(shearbus_node_count(bus) == nodes_of(rank, 1, ids));

  REFUSED(shearbus_mpi_dump(ranks, bus, "d", "/nowhere/tickets", &status), SHEARBUS_INVALID_VALUE,
          "/nowhere/tickets cannot be written");
  REFUSED(shearbus_mpi_dump(ranks, bus, last ? "two\nlines" : "d", "x", &status), SHEARBUS_INVALID_VALUE, "mark");
  path_of("errors", 0, manifest, sizeof manifest);
  OK(shearbus_mpi_dump(ranks, bus, "d", manifest, &status));
  shearbus_mpi_leave(&ranks, &bus);

  /* What is asked for must be what was dumped. */
  n = nodes_of(rank, 2, ids);
  REFUSED(shearbus_mpi_restart(&ranks, MPI_COMM_WORLD, &bus, &options, "/nowhere/tickets", n, ids, &status),
          SHEARBUS_INVALID_VALUE, "/nowhere/tickets cannot be read");
  const size_t less = n > 0 && rank == owner_of(5, 2) ? n - 1 : n;
  REFUSED(shearbus_mpi_restart(&ranks, MPI_COMM_WORLD, &bus, &options, manifest, less, ids, &status),
          SHEARBUS_UNKNOWN_NODE, "no rank asks for it");
  CHECK(ranks == NULL && bus == NULL && status.n_nodes == 1);
  ids[n] = rank == 0 ? owner_of(3, 2) != 0 ? 3 : ids[0] : 0;
  REFUSED(shearbus_mpi_restart(&ranks, MPI_COMM_WORLD, &bus, &options, manifest, n + (rank == 0), ids, &status),
          SHEARBUS_DUPLICATE_NODE, "is asked for by rank");
  ids[n] = 1000;
  REFUSED(shearbus_mpi_restart(&ranks, MPI_COMM_WORLD, &bus, &options, manifest, n + (rank == 0), ids, &status),
          SHEARBUS_UNKNOWN_NODE, "node 1000 is asked for by rank 0");
  if (rank == 0) { /* a manifest without its end */
    FILE* file = fopen(manifest, "r+");
    const size_t length = file == NULL ? 0 : fread(text, 1, sizeof text, file);
    if (file != NULL) fclose(file);
    snprintf(manifest, sizeof manifest, "%s/cut", directory);
    file = fopen(manifest, "w");
    CHECK(file != NULL && fwrite(text, 1, length - 30, file) == length - 30 && fclose(file) == 0);
    path_of("errors", 0, manifest, sizeof manifest);
  }
  char cut[256];
  snprintf(cut, sizeof cut, "%s/cut", directory);
  REFUSED(shearbus_mpi_restart(&ranks, MPI_COMM_WORLD, &bus, &options, cut, n, ids, &status), SHEARBUS_INVALID_VALUE,
          "no complete manifest");
  OK(shearbus_mpi_restart(&ranks, MPI_COMM_WORLD, &bus, &options, manifest, n, ids, &status));
  CHECK(shearbus_node_count(bus) == n);
  OK(shearbus_mpi_close(&ranks, &bus, &status));
}

static void on_root(void) {
  shearbus_mpi* ranks = NULL;
  shearbus_session* bus = NULL;
  shearbus_options options = options_of();
  uint64_t ids[N];
  double warm[N];
  const int last = rank == size - 1;
  const size_t n = nodes_of(rank, 0, ids);
  for (int i = 0; i < N; ++i) warm[i] = 310.0 + i;
  if (size > 1)
    REFUSED(shearbus_mpi_open_on_root(&ranks, MPI_COMM_WORLD, &bus, &options, n, ids, last ? warm : NULL, &status),
            SHEARBUS_SHAPE, "some ranks give");
  options.endpoint = "ipc:///tmp/shearbus-nobody-listens";
  options.connect_deadline_s = 0.2;
  REFUSED(shearbus_mpi_open_on_root(&ranks, MPI_COMM_WORLD, &bus, &options, n, ids, NULL, &status),
          SHEARBUS_UNREACHABLE, "rank 0");
  CHECK(ranks == NULL && bus == NULL);
  options = options_of();
  options.endpoint = "embedded";
  OK(shearbus_mpi_open_on_root(&ranks, MPI_COMM_WORLD, &bus, &options, n, ids, warm, &status));
  REFUSED(shearbus_mpi_redistribute(ranks, bus, NULL, &status), SHEARBUS_INVALID_VALUE, "");
  shearbus_request request = request_of(0, n, ids, 0);
  if (size > 1) {
    if (last) request.dt_s = 2e-9;
    REFUSED(shearbus_mpi_step_on_root(ranks, bus, &request, NULL, &status), SHEARBUS_SHAPE, "the dt of the step is 2e-09 s");
  }
  request = request_of(0, n, ids, 0);
  if (rank == owner_of(3, 0)) rows[0].pressure = 1e300;
  char whose[64];
  snprintf(whose, sizeof whose, "rank %d: pressure_pa", owner_of(3, 0));
  REFUSED(shearbus_mpi_step_on_root(ranks, bus, &request, NULL, &status), SHEARBUS_INVALID_VALUE, whose);
  CHECK(n == 0 || rows[0].stress == -1);
  request = request_of(0, n, ids, 0);
  if (last) ++request.n;
  REFUSED(shearbus_mpi_step_on_root(ranks, bus, &request, NULL, &status), SHEARBUS_SHAPE, "this rank has");
  OK(shearbus_mpi_close(&ranks, &bus, &status));
}

int main(int argc, char** argv) {
  int dump = -1, pause = -1, die = 0;
  MPI_Init(&argc, &argv);
  MPI_Comm_rank(MPI_COMM_WORLD, &rank);
  MPI_Comm_size(MPI_COMM_WORLD, &size);
  if (argc < 5) MPI_Abort(MPI_COMM_WORLD, 2);
  scene = argv[1];
  endpoint = argv[2];
  directory = argv[3];
  if (strcmp(argv[4], "errors") == 0) {
    openings();
    opening_in_doubt();
    moves();
    on_root();
  } else if (argc >= 8) {
    for (int i = 8; i < argc; ++i) {
      if (strncmp(argv[i], "dump=", 5) == 0) dump = atoi(argv[i] + 5);
      if (strncmp(argv[i], "pause=", 6) == 0) pause = atoi(argv[i] + 6);
      if (strcmp(argv[i], "die") == 0) die = 1;
    }
    run(atoi(argv[5]), atoi(argv[6]), argv[7], dump, pause, die);
  }
  int of_all = 0;
  MPI_Allreduce(&faults, &of_all, 1, MPI_INT, MPI_SUM, MPI_COMM_WORLD);
  MPI_Finalize();
  return of_all == 0 ? 0 : 1;
}
