/* The C interface of the shearbus subgrid service.
 *
 *   shearbus_session* bus = NULL;
 *   shearbus_status status = SHEARBUS_STATUS_INIT;
 *   shearbus_options options = SHEARBUS_OPTIONS_INIT;
 *   options.scene_file = "friction.toml";
 *   if (shearbus_open(&bus, &options, n, node_ids, NULL, &status)) fail(status.text, status.remedy);
 *
 *   shearbus_input inputs[] = {{SHEARBUS_VELOCITY_JUMP, 0, jump, 0}, {SHEARBUS_PRESSURE, 0, pressure, 0}, ...};
 *   shearbus_output outputs[] = {{SHEARBUS_SHEAR_STRESS, 0, stress, 0}};
 *   shearbus_request step = SHEARBUS_REQUEST_INIT;
 *   step.dt_s = 1e-9;  step.n = n;  step.inputs = inputs;  step.n_inputs = 2;  step.outputs = outputs; ...
 *   if (shearbus_step(bus, &step, NULL, &status)) fail(status.text, status.remedy);
 *
 *   shearbus_close(&bus, &status);
 *
 * Every function that may fail returns a code: SHEARBUS_OK (0) or the code of the fault, and fills the caller's
 * status (which may be NULL) with what was expected and found, and with what to do. A call that fails changes no
 * state of the server, with one exception: after SHEARBUS_UNKNOWN_OUTCOME and SHEARBUS_NO_MEMORY the request may or
 * may not have run. If the caller then makes the same call with the same values, the library sends the same request:
 * the server does not run it twice and returns the answer that it kept.
 *
 * No call throws, aborts or blocks beyond its deadline. No call prints anything but warnings, and these go to the
 * log if there is one. A session belongs to one thread at a time: a call that another thread, or the log callback,
 * makes meanwhile is SHEARBUS_IN_USE at once and does nothing. It belongs to the process that opened it: after fork()
 * each call of the child is SHEARBUS_OTHER_PROCESS at once, and the parent goes on; the child opens sessions of its
 * own. Sessions are independent of each other. The library computes in the default floating-point environment, and
 * leaves the caller's as it was, traps, rounding and flags; it takes no signals, and signals do not disturb it. All
 * quantities are in SI units. Pointers that a function returns are valid until the next call on the session. Structs
 * grow only at their end: `size` tells the library which members the caller knows, so each struct starts from its
 * _INIT. Members that are zero have their default.
 *
 * Environment variables that a user sets, without a change of the host:
 *   SHEARBUS_ENDPOINT         replaces shearbus_options.endpoint
 *   SHEARBUS_SECRET_KEY_FILE  replaces shearbus_options.secret_key_file
 *   SHEARBUS_SCENE            file that replaces the scene of shearbus_options
 *   SHEARBUS_FALLBACK         allows the host's own law while the server is gone (shearbus_set_fallback), after this time [s]
 *   SHEARBUS_RECORD           directory (DIR/), or new file, that gets an event log of the session, for shearbus-replay
 *   SHEARBUS_LOG              file to which the library appends its log lines; "stderr" for standard error */
#ifndef SHEARBUS_H
#define SHEARBUS_H

#include <stddef.h>
#include <stdint.h>

#if defined(__GNUC__)
#define SHEARBUS_API __attribute__((visibility("default")))
#else
#define SHEARBUS_API
#endif

#ifdef __cplusplus
extern "C" {
#endif

typedef struct shearbus_session shearbus_session;

/* ---- codes ---- */

/* The hundreds are classes: 1xx the message, 2xx the session, 3xx the content, 4xx the server, 5xx the client.
 * Except for 0 and for 500 and above, the numbers are those of shearbus.v1.Code. proto/WIRE.md says what to do. */
/* clang-format off */
/* from the schema, by print_contract.py: codes */
enum {
  SHEARBUS_OK = 0,
  /* wrong number of frames: an empty delimiter (REQ socket), or a payload frame that the header does not declare or
   * lacks */
  SHEARBUS_BAD_FRAMING = 100,
  SHEARBUS_MALFORMED = 101, /* the header does not parse or breaks "The header" (WIRE.md) */
  SHEARBUS_VERSION = 102, /* no common protocol version; the text names both */
  /* larger than the welcome allows, or a quota of the user is used up; the text names limit, demand and option */
  SHEARBUS_LIMIT = 103,
  /* the payload is not what its header says: damage, or a buffer that changed while it was sent */
  SHEARBUS_CHECKSUM = 104,
  SHEARBUS_SHAPE = 105, /* columns missing, surplus, overlapping or of the wrong length */
  SHEARBUS_UNSUPPORTED = 106, /* a request, column or option that this server or this session does not have */
  /* never opened here, or closed: by its client, by an operator, after idle_limit_s, or with a server without
   * durability */
  SHEARBUS_UNKNOWN_SESSION = 200,
  /* an old request, as from a second process that uses the session; last_sequence is the present */
  SHEARBUS_STALE_SEQUENCE = 201,
  SHEARBUS_SEQUENCE_GAP = 202, /* requests are missing before this one */
  /* this number was used by a request with other bytes: after an unknown outcome another call was made, and the lost
   * one had run */
  SHEARBUS_SEQUENCE_REUSED = 203,
  SHEARBUS_EPOCH = 204, /* the server was restarted */
  /* no trial stands: it was committed, rolled back, or dropped by a step in mode advance */
  SHEARBUS_NOTHING_TO_COMMIT = 205,
  SHEARBUS_RESUME_REFUSED = 206, /* not the token of the opening, or the opening had none */
  SHEARBUS_SUPERSEDED = 207, /* another client has resumed the session */
  SHEARBUS_UNKNOWN_MARK = 208, /* no mark of this name, or no longer: a session keeps the newest two */
  SHEARBUS_TRIAL_STANDS = 209, /* the set of nodes cannot change while a trial waits */
  /* no offer of this number waits in the domain: accepted, withdrawn by a rollback, or not made yet */
  SHEARBUS_UNKNOWN_TRANSFER = 210,
  /* the session is another's, only an operator may ask this, or the key was taken off the server's list since it
   * connected */
  SHEARBUS_NOT_PERMITTED = 220,
  /* a key unknown, missing, out of bounds, or in conflict with another; the text gives file, line and column */
  SHEARBUS_INVALID_SCENE = 300,
  /* not finite, or outside what makes sense: often a wrong unit, or memory that was never set */
  SHEARBUS_INVALID_VALUE = 301,
  SHEARBUS_UNKNOWN_NODE = 302, /* a node that the session does not have */
  SHEARBUS_DUPLICATE_NODE = 303, /* given twice in a request, or in the session already */
  /* of another session of the domain, which the text names, or on its way between two; after a crash often of the run
   * before */
  SHEARBUS_NODE_OWNED = 304,
  SHEARBUS_OTHER_SCENE = 305, /* offered from a session of another scene */
  /* nodes without an answer, policy ALL_OR_NOTHING: no root, or more work than work_budget */
  SHEARBUS_STEP_FAILED = 306,
  SHEARBUS_SHUTTING_DOWN = 400, /* the server ends */
  SHEARBUS_INTERNAL = 401, /* the server's fault; nothing was changed */
  SHEARBUS_NO_SPACE = 402, /* the server's disk is full */
  SHEARBUS_DRAINING = 403, /* an operator has asked the server to admit no session */
  /* the checkpoint that an operator asked for could not be written; the ones before and the journal hold everything */
  SHEARBUS_CHECKPOINT_FAILED = 404,
  SHEARBUS_RECOVERING = 405, /* the server was restarted and replays its journal; the text says how far it is */
  SHEARBUS_UNREACHABLE = 500, /* no connection to the endpoint before the deadline; nothing was sent */
  SHEARBUS_UNKNOWN_OUTCOME = 501, /* no reply before the deadline: the request may or may not have run */
  /* the reply does not answer the request: the peer is no shearbus server, or of another version */
  SHEARBUS_UNEXPECTED_REPLY = 502,
  SHEARBUS_AUTH = 503, /* the server does not admit this client, or has another key than expected */
  SHEARBUS_NOT_CLOSED = 504, /* the host's jump is not the one that its last step answered (check_closure = error) */
  SHEARBUS_NO_MEMORY = 510, /* the process of the host has no memory; the request may have run */
  SHEARBUS_LIBRARY_FAULT = 511, /* any other fault inside the library, which the text names */
  SHEARBUS_IN_USE = 512, /* another thread is inside a call on the session; nothing was done */
  SHEARBUS_OTHER_PROCESS = 513, /* the session belongs to the process of which this one is a fork; nothing was done */
  SHEARBUS_NO_LIBRARY = 514 /* the program was built with shearbus_stub.h in place of the library */
};
/* print_contract.py: end */
/* clang-format on */

/* The text of this thread's last fault, whole; shearbus_status has its beginning. "" before the first. */
SHEARBUS_API const char* shearbus_fault_text(void);

/* The name of a code, such as "INVALID_VALUE". Never NULL. */
SHEARBUS_API const char* shearbus_code_name(int code);

#define SHEARBUS_NODES_NAMED 16
typedef struct shearbus_status {
  size_t size;
  int code;
  int n_nodes;                          /* number of entries of `nodes` that are set */
  uint64_t nodes[SHEARBUS_NODES_NAMED]; /* nodes at fault */
  char field[64];                       /* column or key of the scene at fault */
  char remedy[512];
  char text
      [2048]; /* what was expected and found; of a longer text, see shearbus_fault_text(), the beginning and "..." */
} shearbus_status;
#define SHEARBUS_STATUS_INIT                        \
  {                                                 \
    sizeof(shearbus_status), 0, 0, {0}, {0}, {0}, { \
      0                                             \
    }                                               \
  }

/* ---- columns ---- */

/* Columns of steps and profiles. All are double, except for the regime and the outcome, which are uint8_t. A tangential
 * column has a second component in a scene with tangential_components = 2. */
/* clang-format off */
/* from columns.inc, by print_contract.py: columns */
enum {
  /* [V] = V_soft - V_hard, tangential. Velocity-driven: of the step. Force-driven: at the middle of the last step,
   * n-1/2  [m/s]; tangential */
  SHEARBUS_VELOCITY_JUMP = 10,
  SHEARBUS_PRESSURE = 11, /* P, compression positive; P <= 0: no contact  [Pa] */
  SHEARBUS_STRESS_SOFT = 12, /* shear stress in the soft body, half a zone away from the interface  [Pa]; tangential */
  SHEARBUS_STRESS_HARD = 13, /* shear stress in the hard body, half a zone away from the interface  [Pa]; tangential */
  SHEARBUS_MASS_SOFT = 14, /* mass per area of the soft half zone that moves with the interface  [kg/m2] */
  SHEARBUS_MASS_HARD = 15, /* mass per area of the hard half zone that moves with the interface  [kg/m2] */
  SHEARBUS_SOFT_SHEAR_RATE = 16, /* shear rate of the soft zone  [1/s] */
  /* equivalent rate Ep_dot of the soft zone's plastic shear along the interface, with the sign of its shear stress
   * [1/s]; tangential */
  SHEARBUS_SOFT_PLASTIC_STRAIN_RATE = 17,
  SHEARBUS_STICK_STRESS = 18, /* stick form: traction that would make the new jump zero  [Pa]; tangential */
  /* stick form: Z = 1 / (dt (1/m_soft + 1/m_hard)), stress per reduction of the jump  [Pa s/m] */
  SHEARBUS_IMPEDANCE = 19,
  /* s = sigma_xz at the interface; positive when [V] > 0: the interface pulls the soft body back  [Pa]; tangential */
  SHEARBUS_SHEAR_STRESS = 30,
  SHEARBUS_SLIDING_VELOCITY = 31, /* [v], slip at the interface; s [v] >= 0  [m/s]; tangential */
  SHEARBUS_INTERFACE_TEMPERATURE = 32, /* T0, at z = 0  [K] */
  SHEARBUS_VELOCITY_JUMP_NEW = 33, /* [V] at n+1/2  [m/s]; tangential */
  SHEARBUS_REGIME = 34, /* uint8_t: what held the stress in the step: a value of Regime */
  SHEARBUS_OUTCOME = 35, /* uint8_t: 0, or a sum of bits of Outcome */
  SHEARBUS_FRICTION_HEAT = 36, /* heat that entered the layer in this step  [J/m2] */
  SHEARBUS_MEAN_SHEAR_STRESS = 37, /* impulse of s over the step, divided by dt_s  [Pa]; tangential */
  SHEARBUS_STRESS_PER_JUMP = 38, /* derivative of s by [V] of the request; 0: none is known  [Pa s/m] */
  SHEARBUS_STRESS_PER_PRESSURE = 39, /* derivative of s by P; 0: none is known  [1] */
  SHEARBUS_INTERFACE_WORK = 40, /* work of the interface stress  [J/m2] */
  SHEARBUS_HEAT_TO_SOFT = 41, /* heat given to the soft body  [J/m2] */
  SHEARBUS_HEAT_TO_HARD = 42, /* heat given to the hard body  [J/m2] */
  SHEARBUS_PLASTIC_WORK = 43, /* plastic work in the layer  [J/m2] */
  SHEARBUS_STORED_HEAT_SOFT = 44, /* growth of the heat stored in the soft body  [J/m2] */
  SHEARBUS_STORED_HEAT_HARD = 45, /* growth of the heat stored in the hard body, where it conducts  [J/m2] */
  SHEARBUS_ELASTIC_ENERGY = 46, /* growth of the layer's elastic energy h s^2 / (2 G0); velocity-driven  [J/m2] */
  SHEARBUS_HEAT_RESIDUAL = 47, /* heat released less heat stored where it is resolved: rounding  [J/m2] */
  SHEARBUS_ENERGY_RESIDUAL = 48, /* work less heat, cold plastic work and elastic energy  [J/m2] */
  /* time after the step in which T0 reaches T_melt at the mean rate of the step; infinity: it does not rise  [s] */
  SHEARBUS_TIME_TO_MELTING = 49,
  /* z of the vertex: 0 at the interface, above 0 in the soft body, below 0 in a conducting hard body  [m] */
  SHEARBUS_POSITION = 50,
  SHEARBUS_WIDTH = 51, /* length across the interface that the vertex stands for  [m] */
  SHEARBUS_LAYER_TEMPERATURE = 52, /* T at the vertex  [K] */
  /* equivalent plastic strain at the vertex; scenes whose layer flows; NaN outside of the layer  [1] */
  SHEARBUS_LAYER_PLASTIC_STRAIN = 53,
  /* Y(ep, P, T) at the vertex without the effect of the rate; scenes whose layer flows; NaN outside of the layer  [Pa]
   * */
  SHEARBUS_LAYER_FLOW_STRESS = 54,
  /* s at the vertex: uniform in a layer without inertia; NaN outside of the layer  [Pa]; tangential */
  SHEARBUS_LAYER_SHEAR_STRESS = 55,
  /* largest error of this step: of T0, relative to what it had to melting at the start; velocity-driven also of heat
   * and impulse; scenes with a tolerance  [1] */
  SHEARBUS_ERROR_ESTIMATE = 60,
  /* jump of the request less the jump answered before; NaN: none was; sessions that check closure  [m/s]; tangential */
  SHEARBUS_CLOSURE = 61,
  SHEARBUS_FILM_THICKNESS = 62, /* thickness of the melt at the end of the step; scenes with [melt_film]  [m] */
  /* impulse of the stress at z = h over the step, divided by dt_s; scenes with inertia  [Pa] */
  SHEARBUS_MEAN_FAR_STRESS = 63,
  /* heat that friction has given to the soft body since the node began; scenes with friction_energy = true  [J/m2] */
  SHEARBUS_FRICTION_ENERGY_SOFT = 70,
  /* heat that friction has given to the hard body since the node began; scenes with friction_energy = true  [J/m2] */
  SHEARBUS_FRICTION_ENERGY_HARD = 71
};
/* print_contract.py: end */
/* clang-format on */

/* Values of the column SHEARBUS_REGIME, and bits of SHEARBUS_OUTCOME, which is 0 or a sum of them. */
/* clang-format off */
/* from the schema, by print_contract.py: regimes and outcomes */
enum {
  SHEARBUS_REGIME_OPEN = 0, /* no contact: P <= 0 */
  SHEARBUS_REGIME_STICK = 1, /* no slip; the layer is elastic */
  SHEARBUS_REGIME_COULOMB = 2, /* slip at the friction limit mu P */
  SHEARBUS_REGIME_TRESCA = 3, /* slip, or flow of the layer, at the yield stress */
  /* as TRESCA, with the interface temperature T0 at or above 0.99 T_melt; or a melt film carries the stress */
  SHEARBUS_REGIME_MELTING = 4
};
enum {
  SHEARBUS_OUTCOME_SUBSTEPPED = 1,
  SHEARBUS_OUTCOME_MULTIPLE_ROOTS = 2, /* several answers satisfied the step; the node continued its previous regime */
  SHEARBUS_OUTCOME_OUTSIDE_DOMAIN = 4, /* the layer does not carry the slip that the host imposes */
  SHEARBUS_OUTCOME_SUDDEN = 8, /* stress or slip changed so much that shorter steps may give another jump */
  SHEARBUS_OUTCOME_OVER_BUDGET = 16, /* with OUTCOME_FAILED: the step needed more work than work_budget of the scene */
  SHEARBUS_OUTCOME_ASLEEP = 32, /* the node was at rest and not solved (layer.sleep); this is no warning */
  SHEARBUS_OUTCOME_FIRST_ORDER = 64, /* a second-order step left its domain: solved by backward Euler instead */
  SHEARBUS_OUTCOME_FAILED = 128, /* the node has no answer and keeps its old state */
  SHEARBUS_OUTCOME_FALLBACK = 160 /* FAILED with ASLEEP: the host's own law answered (shearbus_set_fallback) */
};
/* print_contract.py: end */
/* clang-format on */

/* Where a column lies in the caller's memory: one value per node, `stride_bytes` apart (0: without gaps), so that an
 * array of structs needs no copy. A stride below the size of a value is SHEARBUS_INVALID_VALUE: it is in bytes.
 * component: 0, or 1 for the second component of a tangential column. */
typedef struct shearbus_input {
  uint32_t field;
  uint32_t component;
  const double* values;
  ptrdiff_t stride_bytes;
} shearbus_input;
typedef struct shearbus_output {
  uint32_t field;
  uint32_t component;
  void* values; /* double*, or uint8_t* for the regime and the outcome */
  ptrdiff_t stride_bytes;
} shearbus_output;

/* shearbus_field_name(): the name of a column on the wire with its unit, such as "pressure_pa", or NULL for an
 * unknown number. shearbus_field_number(): the number of the column that has this name, or 0 for an unknown name. */
SHEARBUS_API const char* shearbus_field_name(uint32_t field);
SHEARBUS_API uint32_t shearbus_field_number(const char* name);

/* ---- sessions ---- */

/* Called from inside a call of this library with one line of text, without line end: about the session that was
 * opened, a warning, or, after 2, 4, 8, ... s of waiting, what the call waits for. The callback must not call this
 * library, and runs in the default floating-point environment. */
typedef void (*shearbus_log_fn)(void* user, const char* line);

/* Called from inside a call of this library that waits, about ten times a second and after each signal; never within
 * the first 0.1 s without a signal. The call goes on after 0. After another value it ends as if its deadline had
 * passed, with SHEARBUS_UNKNOWN_OUTCOME or, if nothing was sent, SHEARBUS_UNREACHABLE. The callback must not call this
 * library. */
typedef int (*shearbus_interrupted_fn)(void* user);

/* A force-driven host that applies the answered stress has, except for rounding, the velocity jump that its last
 * step answered. By default the library compares the two in the first 100 steps and warns once of a difference, with
 * the mistake of the host that could explain it. Of later steps, and of the first one of a resumed session, it knows
 * the largest difference alone, from the reply, and warns of that. */
enum {
  SHEARBUS_CHECK_WARN = 0,
  SHEARBUS_CHECK_OFF = 1,  /* for hosts whose jump also has other causes, for instance a turning interface; also no
                              warnings about the inputs of steps */
  SHEARBUS_CHECK_ERROR = 2 /* every step is compared before it is sent; a difference is SHEARBUS_NOT_CLOSED. One of
                              the first step of a resumed session refuses the step after it. */
};

typedef struct shearbus_options {
  size_t size;
  const char* endpoint;        /* tcp://host:port, ipc://path, or file://path of a server's endpoint file; NULL, "" or
                                  "embedded": a server in this process. Several endpoints with a comma between two of
                                  them, or file://path of a directory of endpoint files: the nodes are divided over
                                  these servers, and the answers are those of one server */
  const char* scene_file;      /* path of a TOML file; set either scene_file or scene_text */
  const char* scene_text;      /* TOML text */
  const char* domain;          /* node ids are unique among the sessions of a domain; NULL: within this session only */
  const char* name;            /* name of this host, for the server's log */
  const char* server_key_file; /* tcp: file of the server's public CURVE key; set both key files or none. An endpoint
                                  file has the server's key: with file:// this may be NULL */
  const char* secret_key_file; /* tcp: file of this client's secret CURVE key */
  double connect_deadline_s;   /* deadline of connecting and the first exchange; default 5 */
  double reply_deadline_s;     /* deadline of any call, repeats included; default 60 */
  double retry_after_s;        /* time after which an unanswered request is repeated on a fresh connection; default 5 */
  shearbus_log_fn log;
  void* log_user;
  const char* state_dir; /* embedded: directory of a durable server's states; NULL: states end with the session */
  uint32_t threads;      /* embedded: number of threads that solve layers; default 1 */
  int check_closure;     /* SHEARBUS_CHECK_WARN, _OFF or _ERROR */
  uint64_t idle_limit_s; /* the server closes the session after this time without a request; 0: never */
  shearbus_interrupted_fn interrupted; /* NULL: a call ends with its answer or its deadline */
  void* interrupted_user;
  const char* scene_name; /* name of scene_text in messages, such as that of its file; NULL: "scene_text" */
  int ignore_environment; /* 1: the environment variables above replace nothing, as in a program whose command line
                             decides */
} shearbus_options;
#define SHEARBUS_OPTIONS_INIT \
  { sizeof(shearbus_options), 0, 0, 0, 0, 0, 0, 0, 0.0, 0.0, 0.0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0 }

/* Opens a session with n nodes; *session is NULL before the call. initial_temperature_k: one value per node, or NULL
 * for the scene's value. After a fault *session is NULL again, with two exceptions: after SHEARBUS_UNKNOWN_OUTCOME
 * and SHEARBUS_NO_MEMORY the session may be open on the server, and *session may hold a handle with which the same
 * call opens the same session. */
SHEARBUS_API int shearbus_open(shearbus_session** session, const shearbus_options* options, size_t n,
                               const uint64_t* node_ids, const double* initial_temperature_k, shearbus_status* status);

/* Nodes that differ from the scene's tables outside of [pair.NAME], with one value per node in every array.
 * pairs: names of tables [pair.NAME] of the scene, or "" for the tables outside of them; pair: the place of each node's
 * pair in this list; NULL: all nodes have the constants of the tables outside. parameters: number-valued keys of the
 * scene, such as "interface.friction_coefficient", that have another value for each node: values[i] is the array of the
 * i-th key, in its unit. The opening of a session chooses the keys; nodes that are registered later give all of them,
 * or none: then they have the values of their pairs. */
typedef struct shearbus_nodes {
  size_t size;
  size_t n;
  const uint64_t* node_ids;
  const double* initial_temperature_k; /* NULL: the scene's value */
  size_t n_pairs;
  const char* const* pairs;
  const uint64_t* pair;
  size_t n_parameters;
  const char* const* parameters;
  const double* const* values;
} shearbus_nodes;
#define SHEARBUS_NODES_INIT \
  { sizeof(shearbus_nodes), 0, 0, 0, 0, 0, 0, 0, 0, 0 }

/* shearbus_open() for nodes of several material pairs or with parameters of their own. */
SHEARBUS_API int shearbus_open_nodes(shearbus_session** session, const shearbus_options* options,
                                     const shearbus_nodes* nodes, shearbus_status* status);

/* Ends the session on the server and waits for its confirmation. *session is NULL afterwards, whatever the code is,
 * except after SHEARBUS_IN_USE: then the other thread still needs it. A session that is NULL is SHEARBUS_OK, so that a
 * second close is. In a fork, close and leave only forget the session, which stays with the process that opened it. */
SHEARBUS_API int shearbus_close(shearbus_session** session, shearbus_status* status);

typedef struct shearbus_totals {
  size_t size;
  uint64_t requests;
  uint64_t node_steps;
  uint64_t solver_ns;
  uint64_t asleep_node_steps; /* of node_steps, those that were answered without solving */
} shearbus_totals;
#define SHEARBUS_TOTALS_INIT \
  { sizeof(shearbus_totals), 0, 0, 0, 0 }
/* shearbus_close() for a host that wants the session's totals (may be NULL), or that makes the call again after a fault:
 * the handle stays, whatever the code is, and shearbus_leave() frees it. After SHEARBUS_OK the session is closed. */
SHEARBUS_API int shearbus_end(shearbus_session* session, shearbus_totals* totals, shearbus_status* status);

/* Frees the session here and leaves it open on the server, for shearbus_resume(). *session is NULL afterwards, unless
 * another thread is inside a call on it. */
SHEARBUS_API void shearbus_leave(shearbus_session** session);

#define SHEARBUS_TICKET_BYTES 80
/* A text by which another process continues the session after this one has left it. It is a secret: its holder owns the
 * session. shearbus_resume() leaves out white space at its end, such as the line end of a file. The session keeps the
 * scene with which it was opened: that of the options is not read. A closed session cannot be resumed. */
SHEARBUS_API int shearbus_ticket(const shearbus_session* session, char ticket[SHEARBUS_TICKET_BYTES],
                                 shearbus_status* status);
SHEARBUS_API int shearbus_resume(shearbus_session** session, const shearbus_options* options, const char* ticket,
                                 shearbus_status* status);
/* shearbus_resume() for a host that knows its nodes: those in `nodes` must be in the session, with the same pairs and
 * parameters, else the call is SHEARBUS_RESUME_REFUSED with the nodes at fault, and the session stays as it is. What
 * `nodes` leaves out is not compared, nor are initial temperatures; of nodes that it leaves out there is a warning. */
SHEARBUS_API int shearbus_resume_nodes(shearbus_session** session, const shearbus_options* options, const char* ticket,
                                       const shearbus_nodes* nodes, shearbus_status* status);
/* What the server told of the nodes of a resumed session: ids, pairs and parameters as they were given, in the order
 * that shearbus_node_ids() had then. `pairs` are "" and the pairs of the scene. Without pairs and parameters in the
 * scene, or if the server did not tell, n_pairs and n_parameters are 0; n is 0 for a session that was opened. The
 * pointers are valid as long as the session. */
SHEARBUS_API int shearbus_resumed_nodes(const shearbus_session* session, shearbus_nodes* nodes,
                                        shearbus_status* status);

/* Changes the deadline of all later calls on the session (shearbus_options.reply_deadline_s). */
SHEARBUS_API int shearbus_set_reply_deadline(shearbus_session* session, double reply_deadline_s,
                                             shearbus_status* status);

/* ---- steps ---- */

enum { SHEARBUS_ADVANCE = 0, SHEARBUS_TRIAL = 1 };

typedef struct shearbus_request {
  size_t size;
  double dt_s;
  double time_s; /* end of the step, for records only */
  uint64_t step; /* number of the step, for records only */
  uint32_t attempt;
  int mode;            /* SHEARBUS_ADVANCE commits the new states; after SHEARBUS_TRIAL a commit or rollback follows */
  int commit_previous; /* SHEARBUS_TRIAL: 1 commits the standing trial first */
  int all_or_nothing;  /* 1: a node without an answer is a fault, SHEARBUS_STEP_FAILED, and no state changes */
  size_t n;            /* number of rows */
  const uint64_t* node_ids; /* node of each row; NULL: all nodes of the session, in its order */
  const shearbus_input* inputs;
  size_t n_inputs;
  const shearbus_output* outputs;
  size_t n_outputs;
  int open_absent; /* only with node_ids. 1: nodes not named are stepped without contact and cool; 0: not stepped */
} shearbus_request;
#define SHEARBUS_REQUEST_INIT \
  { sizeof(shearbus_request), 0.0, 0.0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0 }

typedef struct shearbus_result {
  size_t size;
  uint64_t nodes;         /* number of rows answered */
  uint64_t flagged_nodes; /* number of nodes with an outcome bit other than SHEARBUS_OUTCOME_ASLEEP */
  uint64_t state_version;
  uint64_t solver_ns;     /* time that the solver took */
  uint64_t service_ns;    /* time that the request took in the server, the solver included */
  uint64_t round_trip_ns; /* time from the request to its answer, as the client saw it */
  /* Of force-driven sessions, unless check_closure is off: */
  double largest_closure_m_per_s; /* largest |jump of the host - jump answered before| of the rows */
  uint64_t closure_node;
  double layer_time_s; /* sum of the dt_s of the answered steps of closure_node */
  int replayed;        /* 1: the answer that the server had kept of a request that it received again */
} shearbus_result;
#define SHEARBUS_RESULT_INIT \
  { sizeof(shearbus_result), 0, 0, 0, 0, 0, 0, 0.0, 0, 0.0, 0 }

/* Steps nodes and fills the outputs, which are unchanged after a fault. result may be NULL. */
SHEARBUS_API int shearbus_step(shearbus_session* session, const shearbus_request* request, shearbus_result* result,
                               shearbus_status* status);

/* The host's own law, for steps while the server is gone. The function fills the outputs of the request from its inputs
 * and returns 0, or another value if it has no answer; it must not call this library, and runs in the default
 * floating-point environment. The library calls it from shearbus_step() with SHEARBUS_ADVANCE, and only if the user allows
 * it by the environment variable SHEARBUS_FALLBACK: the time in seconds that a step gives the server. After that time the
 * law answers this step and, until the server is back, the following ones; the library looks for the server again after
 * the same time. It is never silent: each such row has the outcome SHEARBUS_OUTCOME_FALLBACK and is one of
 * flagged_nodes, the log (or standard error) has a line when the server is gone, when it is back and at the end of the
 * session, and shearbus_count_fallbacks() has the totals. The layers keep their states meanwhile; a step that the server
 * may have got is completed there when it is back, before anything else. Without the variable, for a trial, and after
 * other faults than UNREACHABLE, UNKNOWN_OUTCOME and SHUTTING_DOWN the step fails as it does without a law. NULL takes
 * the law away. */
typedef int (*shearbus_fallback_fn)(void* user, const shearbus_request* request);
SHEARBUS_API int shearbus_set_fallback(shearbus_session* session, shearbus_fallback_fn law, void* user,
                                       shearbus_status* status);
typedef struct shearbus_fallbacks {
  size_t size;
  uint64_t steps; /* number of steps that the host's own law answered */
  uint64_t node_steps;
  double time_s;     /* sum of their dt_s */
  uint64_t absences; /* number of times that the server was found gone */
  int allowed;       /* 1: the user has set SHEARBUS_FALLBACK */
} shearbus_fallbacks;
#define SHEARBUS_FALLBACKS_INIT \
  { sizeof(shearbus_fallbacks), 0, 0, 0.0, 0, 0 }
SHEARBUS_API int shearbus_count_fallbacks(const shearbus_session* session, shearbus_fallbacks* fallbacks,
                                          shearbus_status* status);

/* shearbus_step() in two halves, for a host with other work to do while the server steps the layers. Between the two
 * the caller makes no other call on the session but close and leave. shearbus_start() copies the inputs; the memory
 * of the outputs must last until shearbus_finish(). If shearbus_finish() fails, shearbus_step() with the same values
 * sends the same request. A step that was started and then left may run or not. */
SHEARBUS_API int shearbus_start(shearbus_session* session, const shearbus_request* request, shearbus_status* status);
SHEARBUS_API int shearbus_finish(shearbus_session* session, shearbus_result* result, shearbus_status* status);

SHEARBUS_API int shearbus_commit(shearbus_session* session, shearbus_status* status);
SHEARBUS_API int shearbus_rollback(shearbus_session* session, shearbus_status* status);

/* shearbus_mark() keeps the committed states on the server under a name, such as that of the host's restart dump;
 * the server keeps the newest two marks. shearbus_rollback_to() restores the nodes of a mark with their states, and
 * drops a trial. */
SHEARBUS_API int shearbus_mark(shearbus_session* session, const char* name, shearbus_status* status);
SHEARBUS_API int shearbus_rollback_to(shearbus_session* session, const char* name, shearbus_status* status);

/* ---- profiles ---- */

/* The profiles of n nodes across the layer, from their committed states. The outputs take the columns SHEARBUS_POSITION
 * to SHEARBUS_LAYER_SHEAR_STRESS, each an array of at least n * *vertices doubles: the vertices of a node in ascending
 * z, the nodes in the order of node_ids. NaN: the vertex lies outside of the layer and the quantity is one of the
 * layer, or the scene does not have the quantity (a layer that cannot flow has no plastic strain). pressure_pa: P at
 * which the flow stress is evaluated, one value per node, or NULL for 0. Before the call *vertices is the number of
 * vertices per node for which the arrays have room; afterwards it is the number of vertices of each node. Where that is larger the call is SHEARBUS_SHAPE and writes no output: make the arrays larger and call
 * again. A scene that keeps no profile is SHEARBUS_UNSUPPORTED, with the reason. Does not change the session. */
SHEARBUS_API int shearbus_profiles(shearbus_session* session, size_t n, const uint64_t* node_ids,
                                   const double* pressure_pa, const shearbus_output* outputs, size_t n_outputs,
                                   size_t* vertices, shearbus_status* status);

/* ---- nodes ---- */

/* New nodes are added after the present ones, which keep their order; retired nodes are removed with their states. */
SHEARBUS_API int shearbus_register(shearbus_session* session, size_t n, const uint64_t* node_ids,
                                   const double* initial_temperature_k, shearbus_status* status);
SHEARBUS_API int shearbus_register_nodes(shearbus_session* session, const shearbus_nodes* nodes,
                                         shearbus_status* status);
SHEARBUS_API int shearbus_retire(shearbus_session* session, size_t n, const uint64_t* node_ids,
                                 shearbus_status* status);

#define SHEARBUS_TRANSFER_BYTES 16
/* shearbus_offer() moves nodes with their states out of this session and fills `transfer`, an id that another
 * session of the domain passes to shearbus_accept(). Between the two calls the server keeps the nodes. The accepted
 * nodes are the last ones of shearbus_node_ids(). */
SHEARBUS_API int shearbus_offer(shearbus_session* session, size_t n, const uint64_t* node_ids,
                                uint8_t transfer[SHEARBUS_TRANSFER_BYTES], shearbus_status* status);
SHEARBUS_API int shearbus_accept(shearbus_session* session, const uint8_t transfer[SHEARBUS_TRANSFER_BYTES],
                                 shearbus_status* status);
/* For a resumed session: copies at most `capacity` ids of its offers that no session had accepted by then, and
 * returns the number of all such offers. */
SHEARBUS_API size_t shearbus_offers(const shearbus_session* session, size_t capacity,
                                    uint8_t (*transfers)[SHEARBUS_TRANSFER_BYTES]);

/* The number of nodes, and their ids in the order of the rows of a step without node_ids. A session on several servers
 * that was resumed has its nodes in ascending order of the ids, where that was their order on each server. */
SHEARBUS_API size_t shearbus_node_count(const shearbus_session* session);
SHEARBUS_API const uint64_t* shearbus_node_ids(const shearbus_session* session);

/* ---- what the server has understood ---- */

/* The scene as TOML text with every default and constant; and the server's warnings about the scene, one per line. A
 * line that begins with "note: " only informs; the others go to the log or to standard error at the opening, too.
 * "" for a session that is NULL. */
SHEARBUS_API const char* shearbus_effective_scene(const shearbus_session* session);
SHEARBUS_API const char* shearbus_warnings(const shearbus_session* session);

typedef struct shearbus_info {
  size_t size;
  int strategy; /* 1 velocity-driven, 2 force-driven */
  uint32_t tangential_components;
  uint64_t bytes_per_node;       /* memory that a node takes on the server */
  uint64_t last_sequence;        /* number of the last answered request; 0 is the opening */
  int outlives_server;           /* 1: a durable server, which answers again after its restart */
  uint64_t state_version;        /* number of commits so far, as the last answer told it */
  uint64_t max_rows_per_message; /* a step of more rows is sent in parts */
  uint64_t max_marks;            /* number of marks that the server keeps */
} shearbus_info;
#define SHEARBUS_INFO_INIT \
  { sizeof(shearbus_info), 0, 0, 0, 0, 0, 0, 0, 0 }
SHEARBUS_API int shearbus_inspect(const shearbus_session* session, shearbus_info* info, shearbus_status* status);

/* Texts about the session and its server; a list has one entry per line. "" for a session that is NULL. */
enum {
  SHEARBUS_SCENE_NAME = 0,
  SHEARBUS_PAIR_NAMES = 1,     /* list: the pairs of the scene */
  SHEARBUS_PARAMETER_KEYS = 2, /* list: the keys that have a value per node */
  SHEARBUS_MARK_NAMES = 3, /* list: the marks that the server keeps, oldest first, as the last shearbus_mark() told */
  SHEARBUS_SERVER_VERSION = 4,
  SHEARBUS_CAPABILITIES = 5, /* list: what the server can do (proto/WIRE.md, "Versions") */
  SHEARBUS_DURABILITY = 6,   /* of the server's sessions, such as "none" */
  SHEARBUS_ACCESS = 7        /* how the server has admitted this client, such as "key" */
};
SHEARBUS_API const char* shearbus_text(const shearbus_session* session, int which);

/* The columns of this session's steps: writes at most `capacity` of their numbers to `fields` and returns how many
 * columns there are. */
enum {
  SHEARBUS_REQUIRED_INPUT = 0,
  SHEARBUS_OPTIONAL_INPUT = 1,
  SHEARBUS_DEFAULT_OUTPUT = 2,
  SHEARBUS_OUTPUT_ON_REQUEST = 3
};
SHEARBUS_API size_t shearbus_columns(const shearbus_session* session, int use, size_t capacity, uint32_t* fields);

/* ---- operators ---- */

/* A connection to a server without a session: for any user what the server tells of itself, for an operator (an
 * operator's key, or the user who runs the server) also what it does for all users. The options are those of an opening;
 * a server that recovers its sessions is not waited for (SHEARBUS_RECOVERING). */
typedef struct shearbus_operator shearbus_operator;
SHEARBUS_API int shearbus_connect(shearbus_operator** at, const shearbus_options* options, shearbus_status* status);
SHEARBUS_API void shearbus_disconnect(shearbus_operator** at); /* *at is NULL afterwards */

enum {
  SHEARBUS_ASK_WELCOME = 0,    /* server_version, capabilities, durability, access, limits */
  SHEARBUS_ASK_STATUS = 1,     /* ServerStatus: what the server holds and has done */
  SHEARBUS_ASK_SESSIONS = 2,   /* sessions: a SessionInfo for each open session */
  SHEARBUS_ASK_TOP = 3,        /* the nodes of `session` that rank highest by `top`: 1 hottest, 2 fastest, 3 molten */
  SHEARBUS_ASK_CLOSE = 4,      /* ends `session`, unless it has gone on since `last_sequence`: its states are lost */
  SHEARBUS_ASK_CHECKPOINT = 5, /* writes a checkpoint now */
  SHEARBUS_ASK_DRAIN = 6       /* no new sessions; `exit`: the server ends with the last one, or after `within_s` */
};
typedef struct shearbus_question {
  size_t size;
  int what;            /* SHEARBUS_ASK_... */
  const char* session; /* session_id: 32 hexadecimal digits */
  int top;
  uint32_t count; /* of top nodes */
  uint64_t last_sequence;
  int exit;
  uint64_t within_s; /* 0: no such time */
} shearbus_question;
#define SHEARBUS_QUESTION_INIT \
  { sizeof(shearbus_question), 0, 0, 0, 0, 0, 0, 0 }
/* Sends a question and gives its answer as JSON, an object with the fields of the answer's message in
 * shearbus/v1/control.proto, and columns by their names on the wire. It is valid until the next question. */
SHEARBUS_API int shearbus_ask(shearbus_operator* of, const shearbus_question* question, const char** answer,
                              shearbus_status* status);

#define SHEARBUS_KEY_BYTES 41
/* Makes a new pair of CURVE keys, texts of 40 characters. */
SHEARBUS_API int shearbus_make_keys(char public_key[SHEARBUS_KEY_BYTES], char secret_key[SHEARBUS_KEY_BYTES],
                                    shearbus_status* status);

/* Version of the library, such as "0.1.0". */
SHEARBUS_API const char* shearbus_version(void);

#ifdef __cplusplus
}
#endif
#endif
