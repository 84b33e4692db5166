/* Hosts of every manner, by the C library: host CASE SCENE.toml ENDPOINT ["embedded" or that of a server].
 * Every fault is printed, and the exit code is their number; of the case `open` it is 3 if the opening was refused. */
#define _GNU_SOURCE
#include <errno.h>
#include <fcntl.h>
#include <fenv.h>
#include <locale.h>
#include <pthread.h>
#include <signal.h>
#include <stdatomic.h>
#include <stdlib.h>
#include <sys/resource.h>
#include <sys/syscall.h>
#include <sys/time.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>
#if defined(__SSE2__)
#include <xmmintrin.h>
#endif

#include "../contract/host_checks.h"

enum { N = 3000, STEPS = 4 }; /* enough nodes for both threads of the server */

static const char *scene, *endpoint;

/* ---- a session and its steps ---- */

static uint64_t ids[N];
static double columns[6][N];
static double stress[N], temperature[N];
static uint8_t outcome[N];
static shearbus_input inputs[6];
static const shearbus_output outputs[] = {{SHEARBUS_SHEAR_STRESS, 0, stress, 0},
                                          {SHEARBUS_INTERFACE_TEMPERATURE, 0, temperature, 0},
                                          {SHEARBUS_OUTCOME, 0, outcome, 0}};

static void fill(void) {
  for (int i = 0; i < N; ++i) {
    ids[i] = 7 * (uint64_t)i + 1;
    columns[0][i] = 90.0 + i / 300.0;
    columns[1][i] = 2e8 * (1 + i % 3);
    columns[2][i] = 1e3 * i;
    columns[3][i] = -1e3 * i;
    columns[4][i] = 4e-3;
    columns[5][i] = 12e-3;
  }
  for (int c = 0; c < 6; ++c) {
    const shearbus_input input = {SHEARBUS_VELOCITY_JUMP + (uint32_t)c, 0, columns[c], 0};
    inputs[c] = input;
  }
}
static shearbus_request request_of(size_t n) {
  return host_request(n, inputs, outputs, 3);
}
static shearbus_options options_of(void) {
  shearbus_options options = host_options(endpoint, scene, 30);
  options.threads = 2;
  return options;
}
static shearbus_session* open_session(size_t n) {
  const shearbus_options options = options_of();
  shearbus_session* session = NULL;
  OK(shearbus_open(&session, &options, n, ids, NULL, &status));
  if (session == NULL) exit(1);
  return session;
}
static int step(shearbus_session* session, size_t n) {
  const shearbus_request request = request_of(n);
  return shearbus_step(session, &request, NULL, &status);
}
static uint64_t hash(uint64_t sum, const void* bytes, size_t size) { /* FNV-1a */
  for (size_t i = 0; i < size; ++i) sum = (sum ^ ((const unsigned char*)bytes)[i]) * 0x100000001b3u;
  return sum;
}
/* Opens a session, makes steps and closes it; returns a hash of the bits of the answers. */
static uint64_t run(void) {
  uint64_t sum = 0xcbf29ce484222325u;
  shearbus_session* session = open_session(N);
  for (int i = 0; i < STEPS; ++i) {
    OK(step(session, N));
    sum = hash(hash(sum, stress, sizeof stress), temperature, sizeof temperature);
  }
  OK(shearbus_close(&session, &status));
  return sum;
}
static double now(void) {
  struct timespec time;
  clock_gettime(CLOCK_MONOTONIC, &time);
  return (double)time.tv_sec + 1e-9 * (double)time.tv_nsec;
}

/* ---- the floating-point environment of the host ---- */

static void plain(void) {}
static void trap(void) {
  feclearexcept(FE_ALL_EXCEPT);
  feenableexcept(FE_INVALID | FE_DIVBYZERO | FE_OVERFLOW | FE_UNDERFLOW);
}
static void upward(void) {
  fesetround(FE_UPWARD);
}
static void downward(void) {
  fesetround(FE_DOWNWARD);
}
static void flush_to_zero(void) {
#if defined(__SSE2__)
  _mm_setcsr(_mm_getcsr() | 0x8040U); /* FTZ and DAZ */
#endif
}
static void raise_flags(void) {
  feraiseexcept(FE_DIVBYZERO);
}

static void floating_point(void) {
  static const struct {
    const char* name;
    void (*set)(void);
  } modes[] = {{"plain", plain},           {"traps", trap},       {"upward", upward}, {"downward", downward},
               {"to zero", flush_to_zero}, {"flags", raise_flags}};
  uint64_t expected = 0;
  for (size_t i = 0; i < sizeof modes / sizeof modes[0]; ++i) {
    fesetenv(FE_DFL_ENV);
    modes[i].set();
    const int traps = fegetexcept(), rounding = fegetround(), flags = fetestexcept(FE_ALL_EXCEPT);
#if defined(__SSE2__)
    const unsigned control = _mm_getcsr();
#endif
    const uint64_t found = run();
    CHECK(fegetexcept() == traps && fegetround() == rounding && fetestexcept(FE_ALL_EXCEPT) == flags);
#if defined(__SSE2__)
    CHECK(_mm_getcsr() == control);
#endif
    fesetenv(FE_DFL_ENV);
    if (i == 0) expected = found;
    if (found != expected) {
      fprintf(stderr, "%s: other bits\n", modes[i].name);
      ++faults;
    }
  }
}

/* ---- fork ---- */

/* Waits for the child, which must end by itself with exit code 0. */
static void expect_end_of(pid_t child) {
  int code = 0;
  const double until = now() + 60;
  while (waitpid(child, &code, WNOHANG) == 0) {
    if (now() > until) {
      kill(child, SIGKILL);
      waitpid(child, &code, 0);
      fprintf(stderr, "the child hung\n");
      break;
    }
    usleep(1000);
  }
  CHECK(WIFEXITED(code) && WEXITSTATUS(code) == 0);
}
static void every_call_is_refused(shearbus_session* session, pid_t parent) {
  char number[32], ticket[SHEARBUS_TICKET_BYTES];
  uint8_t transfer[SHEARBUS_TRANSFER_BYTES] = {0};
  size_t vertices = 0;
  shearbus_info info = SHEARBUS_INFO_INIT;
  const shearbus_request request = request_of(N);
  const double started = now();
  snprintf(number, sizeof number, "process %d", (int)parent);
  CODE(step(session, N), SHEARBUS_OTHER_PROCESS);
  CHECK(strstr(status.text, number) != NULL && strstr(status.remedy, "in the child") != NULL);
  CODE(shearbus_start(session, &request, &status), SHEARBUS_OTHER_PROCESS);
  CODE(shearbus_finish(session, NULL, &status), SHEARBUS_OTHER_PROCESS);
  CODE(shearbus_commit(session, &status), SHEARBUS_OTHER_PROCESS);
  CODE(shearbus_rollback(session, &status), SHEARBUS_OTHER_PROCESS);
  CODE(shearbus_mark(session, "m", &status), SHEARBUS_OTHER_PROCESS);
  CODE(shearbus_rollback_to(session, "m", &status), SHEARBUS_OTHER_PROCESS);
  CODE(shearbus_profiles(session, 1, ids, NULL, NULL, 0, &vertices, &status), SHEARBUS_OTHER_PROCESS);
  CODE(shearbus_register(session, 1, ids, NULL, &status), SHEARBUS_OTHER_PROCESS);
  CODE(shearbus_retire(session, 1, ids, &status), SHEARBUS_OTHER_PROCESS);
  CODE(shearbus_offer(session, 1, ids, transfer, &status), SHEARBUS_OTHER_PROCESS);
  CODE(shearbus_accept(session, transfer, &status), SHEARBUS_OTHER_PROCESS);
  CODE(shearbus_ticket(session, ticket, &status), SHEARBUS_OTHER_PROCESS);
  CODE(shearbus_inspect(session, &info, &status), SHEARBUS_OTHER_PROCESS);
  CHECK(shearbus_node_count(session) == N && shearbus_warnings(session) != NULL);
  CHECK(now() - started < 5);
}
static void in_fork(void) {
  const uint64_t expected = run();
  const pid_t parent = getpid();
  shearbus_session *session = open_session(N), *copy = NULL;
  OK(step(session, N));
  pid_t child = fork();
  if (child == 0) {
    copy = session;
    every_call_is_refused(session, parent);
    CHECK(run() == expected); /* with a session of its own */
    CODE(shearbus_close(&copy, &status), SHEARBUS_OTHER_PROCESS);
    CHECK(copy == NULL);
    shearbus_leave(&session);
    CHECK(session == NULL);
    exit(faults);
  }
  expect_end_of(child);
  OK(step(session, N));
  const shearbus_request request = request_of(N);
  OK(shearbus_start(session, &request, &status));
  usleep(300000); /* the library's thread rests: what it locks is locked for ever in a child without the hooks, malloc(), too */
  child = (pid_t)syscall(SYS_clone, SIGCHLD, NULL, NULL, NULL, NULL); /* without the hooks of fork() */
  if (child == 0) {
    CODE(shearbus_finish(session, NULL, &status), SHEARBUS_OTHER_PROCESS);
    CODE(shearbus_close(&session, &status), SHEARBUS_OTHER_PROCESS);
    _exit(faults);
  }
  expect_end_of(child);
  OK(shearbus_finish(session, NULL, &status));
  OK(shearbus_close(&session, &status));
}
/* A child that lives on does not keep the state directory of its parent's server locked. */
static void durable_fork(void) {
  char directory[] = "/tmp/shearbus-host-XXXXXX", command[64];
  shearbus_options options = options_of();
  options.state_dir = mkdtemp(directory);
  pid_t child = 0;
  for (int i = 0; i < 2; ++i) {
    shearbus_session* session = NULL;
    OK(shearbus_open(&session, &options, 1, ids, NULL, &status));
    if (i == 0 && (child = fork()) == 0) {
      pause();
      _exit(0);
    }
    OK(step(session, 1));
    OK(shearbus_close(&session, &status));
  }
  kill(child, SIGKILL);
  waitpid(child, NULL, 0);
  snprintf(command, sizeof command, "rm -r %s", directory);
  CHECK(system(command) == 0);
}
static void forks(void) {
  in_fork();
  if (strcmp(endpoint, "embedded") == 0) durable_fork();
}

/* ---- signals ---- */

static volatile sig_atomic_t alarms = 0;
static void on_alarm(int number) {
  (void)number;
  ++alarms;
}
static void signals(void) {
  const struct itimerval every = {{0, 200}, {0, 200}}, never = {{0, 0}, {0, 0}};
  for (int restart = 0; restart < 2; ++restart) {
    struct sigaction action;
    memset(&action, 0, sizeof action);
    action.sa_handler = on_alarm;
    action.sa_flags = restart ? SA_RESTART : 0;
    sigaction(SIGALRM, &action, NULL);
    alarms = 0;
    setitimer(ITIMER_REAL, &every, NULL);
    for (int i = 0; i < 1000 && faults < 5; ++i) {
      shearbus_session* session = open_session(1);
      OK(step(session, 1));
      OK(shearbus_close(&session, &status));
    }
    setitimer(ITIMER_REAL, &never, NULL);
    CHECK(alarms > 1000);
  }
}

/* ---- limits ---- */

static void a_host_with_files(int free_files) {
  int file = open("/dev/null", O_RDONLY);
  const struct rlimit limit = {(rlim_t)(file + free_files), (rlim_t)(file + free_files)};
  close(file);
  setrlimit(RLIMIT_NOFILE, &limit);
  const shearbus_options options = options_of();
  shearbus_session* session = NULL;
  const int code = shearbus_open(&session, &options, 1, ids, NULL, &status);
  if (code == SHEARBUS_OK) {
    OK(step(session, 1));
    OK(shearbus_close(&session, &status));
    _exit(faults);
  }
  CHECK(code == SHEARBUS_UNREACHABLE && session == NULL && strstr(status.text, "(ulimit -n)") != NULL);
  _exit(faults == 0 ? 3 : faults);
}
static void files(void) {
  enum { MOST = 40 };
  int opened = 0, refused = 0;
  for (int i = 0; i < MOST; ++i) {
    const pid_t child = fork();
    if (child == 0) a_host_with_files(i);
    int code = 0;
    waitpid(child, &code, 0);
    opened += WIFEXITED(code) && WEXITSTATUS(code) == 0;
    refused += WIFEXITED(code) && WEXITSTATUS(code) == 3;
    if (i == MOST - 1) CHECK(WIFEXITED(code) && WEXITSTATUS(code) == 0);
  }
  CHECK(opened + refused == MOST && opened > 0 && refused > 0);
}
static int only_open(void) {
  shearbus_options options = options_of();
  options.connect_deadline_s = 2;
  shearbus_session* session = NULL;
  if (shearbus_open(&session, &options, 1, ids, NULL, &status) != SHEARBUS_OK) {
    printf("%s: %s\n", shearbus_code_name(status.code), status.text);
    return 3;
  }
  OK(step(session, 1));
  OK(shearbus_close(&session, &status));
  return faults;
}

/* ---- two threads ---- */

static shearbus_session* shared;
static atomic_int in_use, done;
static void* other_thread(void* unused) {
  (void)unused;
  shearbus_status own = SHEARBUS_STATUS_INIT;
  while (!done) {
    const double started = now();
    const int code = shearbus_commit(shared, &own);
    if (code == SHEARBUS_IN_USE) {
      in_use += strstr(own.text, "another thread") != NULL && now() - started < 5;
    } else if (code != SHEARBUS_NOTHING_TO_COMMIT) {
      fprintf(stderr, "the other thread: %s: %s\n", shearbus_code_name(code), own.text);
      in_use = -1000000;
    }
  }
  return NULL;
}
static void from_log(void* session, const char* line) {
  (void)line;
  shearbus_session** const bus = session;
  if (*bus == NULL) return;
  CODE(shearbus_commit(*bus, &status), SHEARBUS_IN_USE);
}
static void threads(void) {
  shared = open_session(N);
  pthread_t thread;
  pthread_create(&thread, NULL, other_thread, NULL);
  int steps = 0;
  for (const double until = now() + 60; now() < until && in_use >= 0 && in_use < 100; ++steps) {
    shearbus_status own = SHEARBUS_STATUS_INIT;
    const shearbus_request request = request_of(N);
    const int code = shearbus_step(shared, &request, NULL, &own);
    if (code != SHEARBUS_OK && code != SHEARBUS_IN_USE) {
      fprintf(stderr, "a step: %s: %s\n", shearbus_code_name(code), own.text);
      ++faults;
    }
  }
  done = 1;
  pthread_join(thread, NULL);
  CHECK(in_use >= 100 && steps > 0);
  OK(step(shared, N));
  OK(shearbus_close(&shared, &status));
  shearbus_options options = options_of();
  options.log = from_log;
  options.log_user = &shared;
  OK(shearbus_open(&shared, &options, 1, ids, NULL, &status)); /* the log gets a line of the opening */
  OK(shearbus_close(&shared, &status));
}

/* ---- arguments ---- */

static void strides(void) {
  static double spread[3 * N];
  shearbus_session* session = open_session(N);
  shearbus_request request = request_of(N);
  shearbus_output wanted[3];
  memcpy(wanted, outputs, sizeof wanted);
  request.outputs = wanted;
  for (ptrdiff_t stride = -7; stride < 8; ++stride) {
    if (stride == 0) continue;
    inputs[0].stride_bytes = stride;
    CODE(shearbus_step(session, &request, NULL, &status), SHEARBUS_INVALID_VALUE);
    CHECK(strstr(status.text, "in bytes") != NULL && strcmp(status.field, "velocity_jump_m_per_s") == 0);
    inputs[0].stride_bytes = 0;
    wanted[0].stride_bytes = stride;
    CODE(shearbus_step(session, &request, NULL, &status), SHEARBUS_INVALID_VALUE);
    CHECK(strstr(status.text, "in bytes") != NULL && strcmp(status.field, "shear_stress_pa") == 0);
    wanted[0].stride_bytes = 0;
  }
  OK(step(session, N));
  OK(shearbus_close(&session, &status));
  const double expected = stress[5];
  for (int i = 0; i < N; ++i) spread[3 * i] = columns[0][i];
  inputs[0].values = spread;
  inputs[0].stride_bytes = 3 * sizeof(double);
  wanted[2].stride_bytes = 1;
  wanted[0].values = stress + N - 1; /* backwards */
  wanted[0].stride_bytes = -(ptrdiff_t)sizeof(double);
  session = open_session(N);
  OK(shearbus_step(session, &request, NULL, &status));
  CHECK(stress[N - 6] == expected);
  OK(shearbus_close(&session, &status));
  fill();
}
static void endings(void) {
  shearbus_session* session = open_session(1);
  char ticket[SHEARBUS_TICKET_BYTES + 8];
  OK(shearbus_ticket(session, ticket, &status));
  if (strcmp(endpoint, "embedded") != 0) {
    shearbus_leave(&session);
    shearbus_options options = options_of();
    options.scene_file = NULL;
    strcat(ticket, " \r\n");
    OK(shearbus_resume(&session, &options, ticket, &status));
    OK(step(session, 1));
  }
  OK(shearbus_close(&session, &status));
  CHECK(session == NULL);
  OK(shearbus_close(&session, &status)); /* once more */
}
static void arguments(void) {
  strides();
  endings();
}

/* ---- the locale ---- */

static void in_locale(void) {
  if (setlocale(LC_ALL, "") == NULL) {
    fprintf(stderr, "no such locale\n");
    exit(77);
  }
  printf("%016llx\n", (unsigned long long)run());
  shearbus_session* session = open_session(1);
  printf("%s\n%s\n", shearbus_effective_scene(session), shearbus_warnings(session));
  shearbus_request request = request_of(1);
  request.dt_s = -1.5e-9;
  CODE(shearbus_step(session, &request, NULL, &status), SHEARBUS_INVALID_VALUE);
  printf("%s\n%s\n", status.text, status.remedy);
  OK(shearbus_close(&session, &status));
}

int main(int argc, char** argv) {
  static const struct {
    const char* name;
    void (*run)(void);
  } cases[] = {{"floating_point", floating_point},
               {"fork", forks},
               {"signals", signals},
               {"files", files},
               {"threads", threads},
               {"arguments", arguments},
               {"locale", in_locale}};
  if (argc != 4) {
    fprintf(stderr, "usage: host CASE SCENE.toml ENDPOINT\n");
    return 2;
  }
  scene = argv[2];
  endpoint = argv[3];
  fill();
  if (strcmp(argv[1], "open") == 0) return only_open();
  for (size_t i = 0; i < sizeof cases / sizeof cases[0]; ++i)
    if (strcmp(argv[1], cases[i].name) == 0) {
      cases[i].run();
      return faults > 100 ? 100 : faults;
    }
  fprintf(stderr, "host: no case %s\n", argv[1]);
  return 2;
}
