/* The MPI helpers (shearbus/shearbus_mpi.h), compiled with the MPI of the host. Every exchange is collective, and
 * every fault of one rank is given to all ranks by agree() before the next exchange: so no rank waits for a rank that
 * has left. */
#define _POSIX_C_SOURCE 200809L
#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <shearbus/shearbus_mpi.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

enum { NAME_BYTES = 128, COLUMNS_AT_MOST = 64 };
/* A session has at most 256 waiting offers, some of which it may have before. */
#ifndef SHEARBUS_MPI_OFFERS_PER_ROUND
#define SHEARBUS_MPI_OFFERS_PER_ROUND 128
#endif

/* Memory that is freed as a whole: a block knows the one before it. */
typedef union block {
  union block* before;
  double aligned; /* as what follows the block must be */
} block;

struct shearbus_mpi {
  block* held;   /* what lives as long as the ranks: they themselves, `idle` and `rows` */
  MPI_Comm comm; /* a duplicate of the host's */
  int rank, size;
  int mpi_fault; /* the first error code of MPI */
  int in_doubt;  /* the opening may have happened, and can be repeated */
  char domain[NAME_BYTES + 1];
  size_t n_idle; /* sessions without nodes, kept for another restart from the same manifest */
  shearbus_session** idle;
  int dumps; /* since the restart */
  int* rows; /* one session on root: rows of each rank */
};

/* A call of this rank: its first fault, after which it makes no request and allocates nothing until agree() has given
 * the fault to all ranks, and the memory that it holds until its end. */
typedef struct call {
  shearbus_mpi* ranks;
  int code;
  int is_refused;          /* all ranks have the fault */
  shearbus_status* status; /* the caller's, or `own` where there is none that can be filled */
  shearbus_status own;
  block* held;
} call;

static int is_sound(const call* now) {
  return now->code == SHEARBUS_OK;
}

/* ---- faults ---- */

/* The fault of this rank, unless it has one. */
static void refuse(call* now, int code, const char* field, const char* remedy, const char* format, ...) {
  shearbus_status* const status = now->status;
  if (!is_sound(now)) return;
  va_list arguments;
  va_start(arguments, format);
  vsnprintf(status->text, sizeof status->text, format, arguments);
  va_end(arguments);
  snprintf(status->remedy, sizeof status->remedy, "%s", remedy);
  snprintf(status->field, sizeof status->field, "%s", field);
  status->n_nodes = 0;
  now->code = status->code = code;
}
static void name_node(call* now, uint64_t node) {
  if (now->status->n_nodes < SHEARBUS_NODES_NAMED) now->status->nodes[now->status->n_nodes++] = node;
}

/* Memory for n elements, set to 0, until `held` is released. */
static void* zeros_in(call* now, block** held, size_t n, size_t size) {
  if (!is_sound(now)) return NULL;
  block* made = n > (SIZE_MAX - sizeof *made) / size ? NULL : calloc(1, sizeof *made + n * size);
  if (made == NULL) {
    refuse(now, SHEARBUS_NO_MEMORY, "", "Free memory and make the same call again.",
           "the host's process has no memory left");
    return NULL;
  }
  made->before = *held;
  *held = made;
  return made + 1;
}
static void* zeros(call* now, size_t n, size_t size) {
  return zeros_in(now, &now->held, n, size);
}
/* Frees what is held, except for the blocks from `kept` on. */
static void release(block** held, const block* kept) {
  while (*held != kept) {
    block* const before = (*held)->before;
    free(*held);
    *held = before;
  }
}

static void mpi(call* now, int code) {
  if (code != MPI_SUCCESS && now->ranks->mpi_fault == MPI_SUCCESS) now->ranks->mpi_fault = code;
}

static int is_in_doubt(int code) {
  return code == SHEARBUS_UNKNOWN_OUTCOME || code == SHEARBUS_NO_MEMORY;
}

/* Gives all ranks the fault of one: of the lowest rank whose request may have run, else of the lowest that was
 * refused. The text names that rank, or `whose` if that is none of them: the rank whose values are at fault. Returns
 * whether there is none. After a fault of all ranks it returns at once. */
static int agree_on(call* now, int whose) {
  shearbus_mpi* const ranks = now->ranks;
  if (now->is_refused) return 0;
  if (ranks->mpi_fault != MPI_SUCCESS) {
    char text[MPI_MAX_ERROR_STRING] = "";
    int length = 0;
    MPI_Error_string(ranks->mpi_fault, text, &length);
    refuse(now, SHEARBUS_LIBRARY_FAULT, "", "End the run; its sessions stay on the server.", "MPI: %s", text);
  }
  const int mine = is_sound(now) ? INT_MAX : is_in_doubt(now->code) ? ranks->rank : ranks->size + ranks->rank;
  int first = mine;
  mpi(now, MPI_Allreduce(&mine, &first, 1, MPI_INT, MPI_MIN, ranks->comm));
  if (first == INT_MAX) {
    if (ranks->mpi_fault != MPI_SUCCESS) now->code = SHEARBUS_LIBRARY_FAULT;
    return is_sound(now);
  }
  const int from = first % ranks->size;
  shearbus_status theirs = *now->status;
  if (ranks->rank == from) {
    const int prefix = snprintf(theirs.text, sizeof theirs.text, "rank %d: ", whose < 0 ? from : whose);
    snprintf(theirs.text + prefix, sizeof theirs.text - (size_t)prefix, "%.*s", (int)(sizeof theirs.text - 32),
             now->status->code == now->code ? now->status->text : shearbus_code_name(now->code));
    theirs.code = now->code;
  }
  mpi(now, MPI_Bcast(&theirs, (int)sizeof theirs, MPI_BYTE, from, ranks->comm));
  *now->status = theirs;
  now->code = theirs.code;
  now->is_refused = 1;
  return 0;
}

static int agree(call* now) {
  return agree_on(now, -1);
}

/* ---- calls ---- */

static void begin(call* now, shearbus_mpi* ranks, shearbus_status* status) {
  const shearbus_status cleared = SHEARBUS_STATUS_INIT;
  memset(now, 0, sizeof *now);
  now->ranks = ranks;
  now->own = cleared;
  now->status = status != NULL && status->size == sizeof *status ? status : &now->own;
}

/* Begins a call on open ranks. Returns whether they are. */
static int begin_on(call* now, shearbus_mpi* ranks, shearbus_status* status) {
  begin(now, ranks, status);
  if (ranks == NULL)
    refuse(now, SHEARBUS_INVALID_VALUE, "ranks", "Call shearbus_mpi_open() first.",
           "there are no ranks: they were not opened");
  return is_sound(now);
}

static int end(call* now) {
  release(&now->held, NULL);
  return now->code;
}

static shearbus_mpi ranks_of(MPI_Comm comm) {
  shearbus_mpi ranks;
  memset(&ranks, 0, sizeof ranks);
  ranks.comm = comm;
  const int fault = MPI_Comm_rank(comm, &ranks.rank);
  ranks.mpi_fault = MPI_Comm_size(comm, &ranks.size);
  if (fault != MPI_SUCCESS) ranks.mpi_fault = fault;
  return ranks;
}

/* Frees what this rank has, and leaves its idle sessions on the server. */
static void drop(shearbus_mpi** ranks) {
  if (*ranks == NULL) return;
  for (size_t i = 0; i < (*ranks)->n_idle; ++i) shearbus_leave(&(*ranks)->idle[i]);
  block* held = (*ranks)->held; /* the ranks themselves, too */
  release(&held, NULL);
  *ranks = NULL;
}

/* The same on all ranks, with the communicator. */
static void drop_all(shearbus_mpi** ranks) {
  MPI_Comm_free(&(*ranks)->comm);
  drop(ranks);
}

/* Begins a call that opens sessions: makes the ranks, or takes those that an opening in doubt has left. */
static int begin_opening(call* now, shearbus_mpi** ranks, MPI_Comm comm, shearbus_session** session,
                         shearbus_status* status) {
  shearbus_mpi first = ranks_of(comm);
  const int again = ranks != NULL && *ranks != NULL && (*ranks)->in_doubt;
  begin(now, &first, status);
  if (ranks == NULL || session == NULL)
    refuse(now, SHEARBUS_INVALID_VALUE, "", "Give &ranks and &session.", "an address is NULL");
  else if (!again && (*ranks != NULL || *session != NULL))
    refuse(now, SHEARBUS_INVALID_VALUE, "", "Close them first, or use other handles.",
           "these ranks or this session are open already");
  shearbus_mpi* made = again ? NULL : zeros_in(now, &first.held, 1, sizeof *made);
  if (agree(now) && !again) {
    mpi(now, MPI_Comm_dup(comm, &first.comm));
    *made = first;
    *ranks = made;
  } else {
    release(&first.held, NULL);
  }
  now->ranks = is_sound(now) ? *ranks : NULL;
  return is_sound(now);
}

/* After the sessions of all ranks were to be opened: all are open, or none. */
static int end_opening(call* now, shearbus_mpi** ranks, shearbus_session** session) {
  const int opened = is_sound(now);
  const int agreed = agree(now);
  (*ranks)->in_doubt = is_in_doubt(now->code);
  if (!agreed && opened) shearbus_close(session, NULL);
  if (!agreed && !(*ranks)->in_doubt) {
    shearbus_leave(session);
    drop_all(ranks);
  }
  return end(now);
}

/* ---- the ranks of a run ---- */

static void random_digits(call* now, char* to) {
  unsigned char bytes[8] = {0};
  FILE* source = fopen("/dev/urandom", "rb");
  const size_t read = source == NULL ? 0 : fread(bytes, 1, sizeof bytes, source);
  if (source != NULL) fclose(source);
  if (read != sizeof bytes)
    refuse(now, SHEARBUS_LIBRARY_FAULT, "domain", "Name the domain in shearbus_options.",
           "/dev/urandom cannot be read, and the run needs a name");
  for (size_t i = 0; i < sizeof bytes; ++i) snprintf(to + 2 * i, 3, "%02x", bytes[i]);
}

static const char* environment(const char* name, const char* otherwise) {
  const char* value = getenv(name);
  return value == NULL || *value == '\0' ? otherwise : value;
}

/* Names the domain of the run on rank 0 and gives the name to all. */
static int choose_domain(call* now, const char* given) {
  int length = 0;
  char digits[17] = "", *to = now->ranks->domain;
  if (now->ranks->rank == 0) {
    const char *slurm = environment("SLURM_JOB_ID", NULL), *pbs = environment("PBS_JOBID", NULL);
    if (given != NULL && *given != '\0') {
      length = snprintf(to, NAME_BYTES + 1, "%s", given);
    } else if (slurm != NULL) {
      length = snprintf(to, NAME_BYTES + 1, "slurm-%s-%s-%s", slurm, environment("SLURM_RESTART_COUNT", "0"),
                        environment("SLURM_STEP_ID", "0"));
    } else {
      random_digits(now, digits);
      length =
          snprintf(to, NAME_BYTES + 1, "%s%s%s%s", pbs == NULL ? "mpi" : "pbs-", pbs == NULL ? "" : pbs, "-", digits);
    }
    if (length > NAME_BYTES)
      refuse(now, SHEARBUS_LIMIT, "domain", "Give a shorter name in shearbus_options.",
             "the name of the domain has %d bytes, expected at most %d", length, NAME_BYTES);
  }
  mpi(now, MPI_Bcast(to, NAME_BYTES + 1, MPI_CHAR, 0, now->ranks->comm));
  return agree(now);
}

/* The caller's options in the domain of the run; what this header does not know is left to the library to refuse. */
static const shearbus_options* in_domain(const shearbus_mpi* ranks, const shearbus_options* given,
                                         shearbus_options* to) {
  if (given == NULL || given->size != sizeof *to) return given;
  *to = *given;
  to->domain = ranks->domain;
  return to;
}

int shearbus_mpi_open(shearbus_mpi** ranks, MPI_Comm comm, shearbus_session** session, const shearbus_options* options,
                      size_t n, const uint64_t* node_ids, const double* initial_temperature_k,
                      shearbus_status* status) {
  call now;
  shearbus_options mine = SHEARBUS_OPTIONS_INIT;
  if (!begin_opening(&now, ranks, comm, session, status)) return now.code;
  if (!(*ranks)->in_doubt && !choose_domain(&now, options == NULL ? NULL : options->domain)) {
    drop_all(ranks);
    return now.code;
  }
  now.code = shearbus_open(session, in_domain(*ranks, options, &mine), n, node_ids, initial_temperature_k, now.status);
  return end_opening(&now, ranks, session);
}

int shearbus_mpi_agree(shearbus_mpi* ranks, int code, shearbus_status* status) {
  call now;
  if (!begin_on(&now, ranks, status)) return now.code;
  now.code = code;
  agree(&now);
  return now.code;
}

int shearbus_mpi_close(shearbus_mpi** ranks, shearbus_session** session, shearbus_status* status) {
  call now;
  begin(&now, ranks == NULL ? NULL : *ranks, status);
  if (session != NULL) now.code = shearbus_close(session, now.status);
  if (now.ranks == NULL) return now.code;
  for (size_t i = 0; i < now.ranks->n_idle; ++i) {
    shearbus_status of_idle = SHEARBUS_STATUS_INIT;
    const int found = shearbus_close(&now.ranks->idle[i], &of_idle);
    if (!is_sound(&now) || found == SHEARBUS_OK) continue;
    now.code = found;
    *now.status = of_idle;
  }
  agree(&now);
  drop_all(ranks);
  return now.code;
}

void shearbus_mpi_leave(shearbus_mpi** ranks, shearbus_session** session) {
  shearbus_leave(session);
  if (ranks != NULL) drop(ranks); /* the communicator stays: to free it is collective */
}

const char* shearbus_mpi_domain(const shearbus_mpi* ranks) {
  return ranks == NULL ? "" : ranks->domain;
}
int shearbus_mpi_rank(const shearbus_mpi* ranks) {
  return ranks == NULL ? -1 : ranks->rank;
}

/* ---- moves ---- */

/* The nodes of one session, sorted by the rank that gets them; `at` has size + 1 offsets. */
typedef struct parcel {
  shearbus_session* from;
  uint64_t* ids;
  size_t* at;
} parcel;

static void sort_by_owner(parcel* to, const int* owner, int size) {
  const size_t n = shearbus_node_count(to->from);
  const uint64_t* ids = shearbus_node_ids(to->from);
  for (size_t i = 0; i < n; ++i) ++to->at[owner[i] + 1];
  for (int d = 0; d < size; ++d) to->at[d + 1] += to->at[d];
  for (size_t i = 0; i < n; ++i) to->ids[to->at[owner[i]]++] = ids[i];
  for (int d = size; d > 0; --d) to->at[d] = to->at[d - 1];
  to->at[0] = 0;
}

typedef struct transfer {
  uint8_t id[SHEARBUS_TRANSFER_BYTES];
} transfer;

static int offsets(int size, const int* counts, int* at) {
  int total = 0;
  for (int i = 0; i < size; total += counts[i++]) at[i] = total;
  return total;
}

/* One round: this rank offers what it has for the ranks [first, first + n) after its own, all ranks exchange the
 * numbers of their offers, accept, and give back what they could not accept. */
static void move_round(call* now, int first, int n, size_t n_parcels, const parcel* parcels, shearbus_session* to) {
  const MPI_Comm comm = now->ranks->comm;
  const int size = now->ranks->size;
  const size_t s = (size_t)size, most = (size_t)n * n_parcels;
  const block* const before = now->held;
  int n_given = 0, n_taken = 0;
  int* given_to = zeros(now, s, sizeof(int));
  int* given_at = zeros(now, s, sizeof(int));
  int* taken_from = zeros(now, s, sizeof(int));
  int* taken_at = zeros(now, s, sizeof(int));
  shearbus_session** giver = zeros(now, most, sizeof *giver);
  transfer* given = zeros(now, most, sizeof *given);
  unsigned char *refused = NULL, *returned = zeros(now, most, 1);
  transfer* taken = NULL;
  for (int d = 0; d < size && is_sound(now); ++d) {
    const int distance = (d - now->ranks->rank + size) % size;
    if (distance < first || distance >= first + n) continue;
    for (size_t p = 0; p < n_parcels && is_sound(now); ++p) {
      const size_t count = parcels[p].at[d + 1] - parcels[p].at[d];
      if (count == 0 || (d == now->ranks->rank && parcels[p].from == to)) continue;
      now->code =
          shearbus_offer(parcels[p].from, count, parcels[p].ids + parcels[p].at[d], given[n_given].id, now->status);
      if (!is_sound(now)) break;
      giver[n_given++] = parcels[p].from;
      ++given_to[d];
    }
  }
  if (agree(now)) {
    mpi(now, MPI_Alltoall(given_to, 1, MPI_INT, taken_from, 1, MPI_INT, comm));
    offsets(size, given_to, given_at);
    n_taken = offsets(size, taken_from, taken_at);
    taken = zeros(now, (size_t)n_taken, sizeof *taken);
    refused = zeros(now, (size_t)n_taken, 1);
    agree(now);
  }
  if (!is_sound(now)) { /* every giver takes back what it has offered */
    for (int i = 0; i < n_given; ++i) shearbus_accept(giver[i], given[i].id, NULL);
    release(&now->held, before);
    return;
  }

  MPI_Datatype bytes;
  mpi(now, MPI_Type_contiguous((int)sizeof(transfer), MPI_BYTE, &bytes));
  mpi(now, MPI_Type_commit(&bytes));
  mpi(now, MPI_Alltoallv(given, given_to, given_at, bytes, taken, taken_from, taken_at, bytes, comm));
  mpi(now, MPI_Type_free(&bytes));
  for (int i = 0; i < n_taken; ++i) {
    if (is_sound(now)) now->code = shearbus_accept(to, taken[i].id, now->status);
    refused[i] = !is_sound(now);
  }
  mpi(now, MPI_Alltoallv(refused, taken_from, taken_at, MPI_BYTE, returned, given_to, given_at, MPI_BYTE, comm));
  for (int i = 0; i < n_given; ++i)
    if (returned[i]) shearbus_accept(giver[i], given[i].id, NULL);
  release(&now->held, before);
  agree(now);
}

/* Moves the nodes of sessions of this rank to the sessions `to` of their owners. owner[i]: of the nodes of from[i]. */
static void move(call* now, size_t n_from, shearbus_session** from, int** owner, shearbus_session* to) {
  const int size = now->ranks->size;
  parcel* parcels = zeros(now, n_from, sizeof *parcels);
  for (size_t i = 0; i < n_from && is_sound(now); ++i) {
    parcels[i].from = from[i];
    parcels[i].ids = zeros(now, shearbus_node_count(from[i]), sizeof(uint64_t));
    parcels[i].at = zeros(now, (size_t)size + 1, sizeof(size_t));
    if (is_sound(now)) sort_by_owner(&parcels[i], owner[i], size);
  }
  agree(now);
  for (int first = 0; first < size && is_sound(now); first += SHEARBUS_MPI_OFFERS_PER_ROUND) {
    const int left = size - first;
    move_round(now, first, left < SHEARBUS_MPI_OFFERS_PER_ROUND ? left : SHEARBUS_MPI_OFFERS_PER_ROUND, n_from, parcels,
               to);
  }
}

int shearbus_mpi_redistribute(shearbus_mpi* ranks, shearbus_session* session, const int* new_owner,
                              shearbus_status* status) {
  call now;
  if (!begin_on(&now, ranks, status)) return now.code;
  const size_t n = shearbus_node_count(session);
  if (session == NULL)
    refuse(&now, SHEARBUS_INVALID_VALUE, "", "Open a session on every rank.", "there is no session");
  else if (n > 0 && new_owner == NULL)
    refuse(&now, SHEARBUS_INVALID_VALUE, "new_owner", "Give the rank of each node.", "new_owner is NULL for %zu nodes",
           n);
  for (size_t i = 0; i < n && is_sound(&now); ++i) {
    if (new_owner[i] >= 0 && new_owner[i] < ranks->size) continue;
    refuse(&now, SHEARBUS_INVALID_VALUE, "new_owner", "Give a rank of the communicator.",
           "new_owner of node %llu is %d, expected 0 to %d", (unsigned long long)shearbus_node_ids(session)[i],
           new_owner[i], ranks->size - 1);
    name_node(&now, shearbus_node_ids(session)[i]);
  }
  int* owner = zeros(&now, n, sizeof *owner);
  if (owner != NULL && n > 0) memcpy(owner, new_owner, n * sizeof *owner);
  if (agree(&now)) move(&now, 1, &session, &owner, session);
  return end(&now);
}

/* ---- the manifest ---- */

/* Tickets of the sessions of this rank, one line each, gathered on rank 0 in the order of the ranks. */
static char* gather_tickets(call* now, const char* word, int wanted, size_t n, shearbus_session* const* sessions,
                            const int* marked, int* count) {
  enum { LINE_BYTES = 16 + SHEARBUS_TICKET_BYTES };
  const shearbus_mpi* ranks = now->ranks;
  int length = 0, lines = 0;
  char* mine = zeros(now, n * LINE_BYTES + 1, 1);
  int* lengths = zeros(now, (size_t)ranks->size, sizeof(int));
  int* at = zeros(now, (size_t)ranks->size, sizeof(int));
  for (size_t i = 0; i < n && is_sound(now); ++i) {
    char ticket[SHEARBUS_TICKET_BYTES];
    if (marked[i] != wanted) continue;
    now->code = shearbus_ticket(sessions[i], ticket, now->status);
    if (!is_sound(now)) break;
    length += snprintf(mine + length, LINE_BYTES, "%s %s\n", word, ticket);
    ++lines;
  }
  if (!agree(now)) return NULL;
  mpi(now, MPI_Reduce(&lines, count, 1, MPI_INT, MPI_SUM, 0, ranks->comm));
  mpi(now, MPI_Gather(&length, 1, MPI_INT, lengths, 1, MPI_INT, 0, ranks->comm));
  char* text = zeros(now, (size_t)offsets(ranks->size, lengths, at) + 1, 1);
  if (agree(now)) mpi(now, MPI_Gatherv(mine, length, MPI_CHAR, text, lengths, at, MPI_CHAR, 0, ranks->comm));
  return text;
}

/* Brings the text to the disk under another name and renames it, so that the file is complete at any moment. */
static void write_whole(call* now, const char* path, const char* head, const char* first, const char* second) {
  char other[PATH_MAX];
  const char* slash = strrchr(path, '/');
  int directory = -1, file = -1, done = 0;
  if (snprintf(other, sizeof other, "%s.new", path) < (int)sizeof other)
    file = open(other, O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, S_IRUSR | S_IWUSR);
  else
    errno = ENAMETOOLONG;
  if (file >= 0) {
    FILE* stream = fchmod(file, S_IRUSR | S_IWUSR) == 0 ? fdopen(file, "w") : NULL;
    if (stream == NULL) {
      close(file);
    } else {
      done = fprintf(stream, "%s%s%send\n", head, first, second) > 0 && fflush(stream) == 0 && fsync(file) == 0;
      done = fclose(stream) == 0 && done;
    }
    done = done && rename(other, path) == 0;
  }
  if (!done) {
    refuse(now, errno == ENOSPC || errno == EDQUOT ? SHEARBUS_NO_SPACE : SHEARBUS_INVALID_VALUE, "manifest",
           "Name a file in a directory that rank 0 may write to, and write the dump again.",
           "the manifest %s cannot be written: %s", path, strerror(errno));
    return;
  }
  /* The new name lasts once its directory is on the disk, too. */
  snprintf(other, sizeof other, "%.*s", slash == NULL || slash == path ? 1 : (int)(slash - path),
           slash == NULL ? "." : path);
  directory = open(other, O_RDONLY | O_CLOEXEC);
  if (directory >= 0) {
    fsync(directory);
    close(directory);
  }
}

static void write_manifest(call* now, const char* mark, const char* path, size_t n, shearbus_session* const* sessions,
                           const int* marked) {
  char head[3 * NAME_BYTES], *without = NULL;
  int n_with = 0, n_without = 0;
  char* with_mark = gather_tickets(now, "marked", 1, n, sessions, marked, &n_with);
  if (is_sound(now)) without = gather_tickets(now, "unmarked", 0, n, sessions, marked, &n_without);
  if (!is_sound(now)) return;
  snprintf(head, sizeof head, "shearbus manifest 1\nmark %s\ndomain %s\nsessions %d\n", mark, now->ranks->domain,
           n_with + n_without);
  if (now->ranks->rank == 0) write_whole(now, path, head, with_mark, without);
  agree(now);
}

static void check_line(call* now, const char* text, const char* what) {
  size_t length = 0;
  while (text != NULL && (unsigned char)text[length] >= ' ') ++length;
  if (text == NULL || length == 0 || length > NAME_BYTES || text[length] != '\0')
    refuse(now, SHEARBUS_INVALID_VALUE, what, "Give a name without control characters.",
           "the %s is no name of 1 to %d bytes on one line", what, NAME_BYTES);
}

int shearbus_mpi_dump(shearbus_mpi* ranks, shearbus_session* session, const char* mark, const char* manifest,
                      shearbus_status* status) {
  call now;
  if (!begin_on(&now, ranks, status)) return now.code;
  check_line(&now, mark, "mark");
  check_line(&now, ranks->domain, "domain");
  if (manifest == NULL || *manifest == '\0')
    refuse(&now, SHEARBUS_INVALID_VALUE, "manifest", "Name a file beside the dump.", "the manifest has no name");
  const size_t n = ranks->n_idle + 1;
  shearbus_session** sessions = zeros(&now, n, sizeof *sessions);
  int* marked = zeros(&now, n, sizeof *marked);
  if (agree(&now)) now.code = shearbus_mark(session, mark, now.status);
  if (agree(&now)) {
    sessions[0] = session;
    marked[0] = 1;
    for (size_t i = 1; i < n; ++i) sessions[i] = ranks->idle[i - 1];
    write_manifest(&now, mark, manifest, n, sessions, marked);
  }
  /* The server keeps two marks: after the second dump nothing needs the sessions without nodes. If one cannot be
   * closed, its idle limit ends it, or an operator. */
  if (is_sound(&now) && ++ranks->dumps == 2) {
    for (size_t i = 0; i < ranks->n_idle; ++i) shearbus_close(&ranks->idle[i], NULL);
    ranks->n_idle = 0;
  }
  return end(&now);
}

/* ---- restart ---- */

typedef struct dump_file {
  char* text;
  const char *mark, *domain;
  int n;
  const char** tickets;
  int* marked;
} dump_file;

static char* read_file(call* now, const char* path, long* length) {
  FILE* file = path == NULL ? NULL : fopen(path, "rb");
  char* text = NULL;
  *length = -1;
  if (file != NULL && fseek(file, 0, SEEK_END) == 0) *length = ftell(file);
  if (*length >= 0 && *length < INT_MAX && fseek(file, 0, SEEK_SET) == 0) {
    text = zeros(now, (size_t)*length + 1, 1);
    if (text != NULL && fread(text, 1, (size_t)*length, file) != (size_t)*length) *length = -1;
  }
  if (*length < 0 || text == NULL)
    refuse(now, SHEARBUS_INVALID_VALUE, "manifest", "Name the file that shearbus_mpi_dump() has written.",
           "the manifest %s cannot be read: %s", path == NULL ? "NULL" : path, strerror(errno));
  if (file != NULL) fclose(file);
  return text;
}

/* Ends the line at *at and returns what follows `word` on it, NULL if the line is another one; *at is the next line
 * then. */
static const char* value_of_line(char** at, const char* word) {
  char* line = *at;
  char* end = strchr(line, '\n');
  const size_t length = strlen(word);
  if (end == NULL || strncmp(line, word, length) != 0) return NULL;
  *end = '\0';
  *at = end + 1;
  return line + length;
}

static void parse(call* now, dump_file* to, const char* path) {
  char *at = to->text, *end = NULL;
  const char* count = NULL;
  int read = 0;
  if (value_of_line(&at, "shearbus manifest 1") != NULL && (to->mark = value_of_line(&at, "mark ")) != NULL &&
      (to->domain = value_of_line(&at, "domain ")) != NULL && (count = value_of_line(&at, "sessions ")) != NULL) {
    const long n = strtol(count, &end, 10);
    to->n = *end == '\0' && n > 0 && n < 1000000 ? (int)n : 0;
  }
  to->tickets = zeros(now, (size_t)to->n, sizeof *to->tickets);
  to->marked = zeros(now, (size_t)to->n, sizeof *to->marked);
  if (!is_sound(now)) return;
  for (; read < to->n; ++read) {
    to->tickets[read] = value_of_line(&at, "marked ");
    to->marked[read] = to->tickets[read] != NULL;
    if (to->tickets[read] == NULL) to->tickets[read] = value_of_line(&at, "unmarked ");
    if (to->tickets[read] == NULL) break;
  }
  if (to->n == 0 || read < to->n || strcmp(at, "end\n") != 0 || strlen(to->domain) > NAME_BYTES)
    refuse(now, SHEARBUS_INVALID_VALUE, "manifest", "Name the file that shearbus_mpi_dump() has written, unchanged.",
           "%s is no complete manifest: %d of %d tickets were read", path, read, to->n);
}

static int read_manifest(call* now, const char* path, dump_file* to) {
  shearbus_mpi* const ranks = now->ranks;
  long length = 0;
  if (ranks->rank == 0) to->text = read_file(now, path, &length);
  if (!agree(now)) return 0;
  mpi(now, MPI_Bcast(&length, 1, MPI_LONG, 0, ranks->comm));
  if (ranks->rank != 0) to->text = zeros(now, (size_t)length + 1, 1);
  if (!agree(now)) return 0;
  mpi(now, MPI_Bcast(to->text, (int)length, MPI_CHAR, 0, ranks->comm));
  parse(now, to, path == NULL ? "the file" : path);
  if (!agree(now)) return 0;
  snprintf(ranks->domain, sizeof ranks->domain, "%s", to->domain);
  return 1;
}

/* Opens this rank's session without nodes, if it has none, with the scene of rank 0's. */
static void open_empty(call* now, shearbus_session** session, const shearbus_options* options) {
  shearbus_options mine = SHEARBUS_OPTIONS_INIT;
  const shearbus_mpi* ranks = now->ranks;
  const int lacks = *session == NULL;
  long length = ranks->rank == 0 ? (long)strlen(shearbus_effective_scene(*session)) : 0;
  mpi(now, MPI_Bcast(&length, 1, MPI_LONG, 0, ranks->comm));
  char* scene = zeros(now, (size_t)length + 1, 1);
  if (scene != NULL && ranks->rank == 0) memcpy(scene, shearbus_effective_scene(*session), (size_t)length);
  if (!agree(now)) return;
  mpi(now, MPI_Bcast(scene, (int)length, MPI_CHAR, 0, ranks->comm));
  options = in_domain(ranks, options, &mine);
  mine.scene_file = NULL;
  mine.scene_text = scene;
  if (lacks) now->code = shearbus_open(session, options, 0, NULL, NULL, now->status);
  const int opened = lacks && is_sound(now);
  if (!agree(now) && opened) shearbus_close(session, NULL);
}

/* Takes the nodes out of a session: its waiting offers first, which hold nodes, too. */
static void empty(call* now, shearbus_session* session) {
  const size_t n_offers = shearbus_offers(session, 0, NULL);
  uint8_t(*offers)[SHEARBUS_TRANSFER_BYTES] = zeros(now, n_offers, sizeof *offers);
  if (offers != NULL) shearbus_offers(session, n_offers, offers);
  for (size_t i = 0; i < n_offers && is_sound(now); ++i) {
    now->code = shearbus_accept(session, offers[i], now->status);
    if (now->code == SHEARBUS_UNKNOWN_TRANSFER) now->code = SHEARBUS_OK; /* another session has accepted it since */
  }
  const size_t n = shearbus_node_count(session);
  uint64_t* ids = zeros(now, n, sizeof *ids);
  if (ids == NULL || n == 0) return;
  memcpy(ids, shearbus_node_ids(session), n * sizeof *ids);
  now->code = shearbus_retire(session, n, ids, now->status);
}

/* Brings back the nodes and states of the mark. Nodes that have moved between sessions since the mark stand in each
 * other's way: then the sessions concerned are emptied first, since the mark keeps its states by itself. */
static int roll_back(call* now, const char* mark, size_t n, shearbus_session** sessions, const int* marked) {
  int* blocked = zeros(now, n, sizeof *blocked);
  for (size_t i = 0; i < n && is_sound(now); ++i) {
    blocked[i] = !marked[i];
    if (marked[i]) now->code = shearbus_rollback_to(sessions[i], mark, now->status);
    if (now->code == SHEARBUS_NODE_OWNED) {
      blocked[i] = 1;
      now->code = SHEARBUS_OK;
    }
  }
  agree(now);
  for (size_t i = 0; i < n && is_sound(now); ++i)
    if (blocked[i]) empty(now, sessions[i]);
  agree(now);
  for (size_t i = 0; i < n && is_sound(now); ++i)
    if (blocked[i] && marked[i]) now->code = shearbus_rollback_to(sessions[i], mark, now->status);
  return agree(now);
}

typedef struct claim {
  uint64_t id;
  int rank;
  size_t place; /* before the claims were sorted */
} claim;
static int by_id(const void* a, const void* b) {
  const uint64_t x = ((const claim*)a)->id, y = ((const claim*)b)->id;
  return x < y ? -1 : x > y;
}

/* The nodes that the ranks ask for, of all ranks, sorted by id. Each rank holds the whole list, once a run. */
static claim* gather_claims(call* now, size_t n, const uint64_t* node_ids, size_t* total) {
  const MPI_Comm comm = now->ranks->comm;
  const int size = now->ranks->size, count = (int)n;
  const long long mine = (long long)n;
  long long all = 0;
  if (n > 0 && node_ids == NULL)
    refuse(now, SHEARBUS_INVALID_VALUE, "node_ids", "Give one id per node.", "node_ids is NULL for %zu nodes", n);
  mpi(now, MPI_Allreduce(&mine, &all, 1, MPI_LONG_LONG, MPI_SUM, comm));
  if (all > INT_MAX)
    refuse(now, SHEARBUS_LIMIT, "node_ids", "Divide the interface between several domains.",
           "the ranks ask for %lld nodes, expected at most %d", all, INT_MAX);
  int* counts = zeros(now, (size_t)size, sizeof *counts);
  int* at = zeros(now, (size_t)size, sizeof *at);
  uint64_t* ids = zeros(now, (size_t)all, sizeof *ids);
  claim* claims = zeros(now, (size_t)all, sizeof *claims);
  if (!agree(now)) return NULL;
  mpi(now, MPI_Allgather(&count, 1, MPI_INT, counts, 1, MPI_INT, comm));
  offsets(size, counts, at);
  mpi(now, MPI_Allgatherv(node_ids, count, MPI_UINT64_T, ids, counts, at, MPI_UINT64_T, comm));
  for (int r = 0; r < size; ++r)
    for (int i = at[r]; i < at[r] + counts[r]; ++i) {
      const claim one = {ids[i], r, (size_t)i};
      claims[i] = one;
    }
  *total = (size_t)all;
  qsort(claims, *total, sizeof *claims, by_id);
  for (size_t i = 1; i < *total; ++i) {
    if (claims[i].id != claims[i - 1].id) continue;
    refuse(now, SHEARBUS_DUPLICATE_NODE, "node_ids", "Ask for each node of the dump once.",
           "node %llu is asked for by rank %d and by rank %d", (unsigned long long)claims[i].id, claims[i - 1].rank,
           claims[i].rank);
    name_node(now, claims[i].id);
  }
  agree(now);
  return claims;
}

/* Finds the rank that asks for each node of the sessions, which must be the nodes that are asked for, each once. */
static int find_owners(call* now, size_t n_sessions, shearbus_session* const* sessions, const claim* claims,
                       size_t total, int** owner) {
  unsigned char* found = zeros(now, total, 1);
  for (size_t i = 0; i < n_sessions; ++i) {
    const size_t n = shearbus_node_count(sessions[i]);
    const uint64_t* ids = shearbus_node_ids(sessions[i]);
    owner[i] = zeros(now, n, sizeof(int));
    for (size_t j = 0; j < n && (is_sound(now) || now->code == SHEARBUS_UNKNOWN_NODE); ++j) {
      const claim key = {ids[j], 0, 0};
      const claim* hit = total == 0 ? NULL : bsearch(&key, claims, total, sizeof *claims, by_id);
      if (hit != NULL) {
        if (owner[i] != NULL) owner[i][j] = hit->rank;
        found[hit - claims] = 1;
        continue;
      }
      refuse(now, SHEARBUS_UNKNOWN_NODE, "node_ids", "Ask for every node of the dump; retire nodes afterwards.",
             "node %llu is in the dump, and no rank asks for it", (unsigned long long)ids[j]);
      name_node(now, ids[j]);
    }
  }
  if (!agree(now)) return 0;
  mpi(now, MPI_Allreduce(MPI_IN_PLACE, found, (int)total, MPI_UNSIGNED_CHAR, MPI_MAX, now->ranks->comm));
  for (size_t i = 0; i < total; ++i) {
    if (found[i]) continue;
    refuse(now, SHEARBUS_UNKNOWN_NODE, "node_ids", "Ask for the nodes of the dump; register others afterwards.",
           "node %llu is asked for by rank %d, and is not in the dump", (unsigned long long)claims[i].id,
           claims[i].rank);
    name_node(now, claims[i].id);
  }
  return agree(now);
}

/* Brings the sessions of the dump to its ranks, as ranks->idle, of which the first gets all nodes of this rank. */
static void restart(call* now, const shearbus_options* options, const char* path, size_t n, const uint64_t* node_ids) {
  shearbus_mpi* const ranks = now->ranks;
  dump_file from;
  memset(&from, 0, sizeof from);
  size_t total = 0;
  if (!read_manifest(now, path, &from)) return;
  claim* claims = gather_claims(now, n, node_ids, &total);
  if (!is_sound(now)) return;
  const int share = (from.n - ranks->rank + ranks->size - 1) / ranks->size;
  const size_t most = share > 0 ? (size_t)share : 0;
  int* marked = zeros(now, most + 1, sizeof *marked);
  int** owner = zeros(now, most + 1, sizeof *owner);
  shearbus_session** mine = ranks->idle = zeros_in(now, &ranks->held, most + 1, sizeof *mine);
  for (size_t i = 0; i < most && is_sound(now); ++i) { /* session i of the manifest goes to rank i modulo size */
    const size_t at = (size_t)ranks->rank + i * (size_t)ranks->size;
    marked[ranks->n_idle] = from.marked[at];
    now->code = shearbus_resume(&mine[ranks->n_idle], options, from.tickets[at], now->status);
    if (is_sound(now)) ++ranks->n_idle;
    if (now->code == SHEARBUS_UNKNOWN_SESSION && !from.marked[at])
      now->code = SHEARBUS_OK; /* ended since, and held no state */
  }
  if (!agree(now)) return;
  const int lacks = ranks->n_idle == 0;
  int any = 0;
  mpi(now, MPI_Allreduce(&lacks, &any, 1, MPI_INT, MPI_MAX, ranks->comm));
  if (any) { /* the manifest names the new sessions before they get nodes */
    open_empty(now, &mine[0], options);
    if (!is_sound(now)) return;
    if (lacks) ranks->n_idle = 1;
    write_manifest(now, from.mark, path, ranks->n_idle, mine, marked);
    if (!is_sound(now)) return;
  }
  if (roll_back(now, from.mark, ranks->n_idle, mine, marked) &&
      find_owners(now, ranks->n_idle, mine, claims, total, owner))
    move(now, ranks->n_idle, mine, owner, mine[0]);
}

int shearbus_mpi_restart(shearbus_mpi** ranks, MPI_Comm comm, shearbus_session** session,
                         const shearbus_options* options, const char* manifest, size_t n, const uint64_t* node_ids,
                         shearbus_status* status) {
  call now;
  if (!begin_opening(&now, ranks, comm, session, status)) return now.code;
  restart(&now, options, manifest, n, node_ids);
  if (is_sound(&now)) {
    *session = *now.ranks->idle++;
    --now.ranks->n_idle;
  } else {
    drop_all(ranks);
  }
  return end(&now);
}

/* ---- one session on root ---- */

int shearbus_mpi_open_on_root(shearbus_mpi** ranks, MPI_Comm comm, shearbus_session** session,
                              const shearbus_options* options, size_t n, const uint64_t* node_ids,
                              const double* initial_temperature_k, shearbus_status* status) {
  call now;
  if (!begin_opening(&now, ranks, comm, session, status)) return now.code;
  shearbus_mpi* all = *ranks;
  const int with_temperatures = initial_temperature_k != NULL, mine = n > INT_MAX ? INT_MAX : (int)n;
  int any[2] = {with_temperatures, !with_temperatures};
  long long rows = (long long)n, total = 0;
  if (n > 0 && node_ids == NULL)
    refuse(&now, SHEARBUS_INVALID_VALUE, "node_ids", "Give one id per node.", "node_ids is NULL for %zu nodes", n);
  mpi(&now, MPI_Allreduce(MPI_IN_PLACE, any, 2, MPI_INT, MPI_MAX, all->comm));
  mpi(&now, MPI_Allreduce(&rows, &total, 1, MPI_LONG_LONG, MPI_SUM, all->comm));
  if (any[0] && any[1])
    refuse(&now, SHEARBUS_SHAPE, "initial_temperature_k",
           "Give one value per node on every rank, or NULL on every rank.",
           "some ranks give initial_temperature_k, and others do not");
  if (total > INT_MAX)
    refuse(&now, SHEARBUS_LIMIT, "node_ids", "Use shearbus_mpi_open().",
           "the ranks have %lld nodes, expected at most %d", total, INT_MAX);
  const size_t on_root = all->rank == 0 && total <= INT_MAX ? (size_t)total : 0;
  int* at = zeros(&now, (size_t)all->size, sizeof *at);
  uint64_t* ids = zeros(&now, on_root, sizeof *ids);
  double* temperatures = zeros(&now, on_root, sizeof *temperatures);
  all->rows = zeros_in(&now, &all->held, (size_t)all->size, sizeof *all->rows);
  if (agree(&now)) {
    mpi(&now, MPI_Allgather(&mine, 1, MPI_INT, all->rows, 1, MPI_INT, all->comm));
    offsets(all->size, all->rows, at);
    mpi(&now, MPI_Gatherv(node_ids, mine, MPI_UINT64_T, ids, all->rows, at, MPI_UINT64_T, 0, all->comm));
    if (any[0])
      mpi(&now,
          MPI_Gatherv(initial_temperature_k, mine, MPI_DOUBLE, temperatures, all->rows, at, MPI_DOUBLE, 0, all->comm));
    if (all->rank == 0)
      now.code = shearbus_open(session, options, on_root, ids, any[0] ? temperatures : NULL, now.status);
  }
  return end_opening(&now, ranks, session);
}

/* What all ranks must give alike. Compared by its bytes, which are all set. */
typedef struct plan {
  double dt_s, time_s;
  uint64_t step, n_inputs, n_outputs;
  uint32_t columns[2 * COLUMNS_AT_MOST][2];
  uint32_t attempt;
  int mode, commit_previous, all_or_nothing, open_absent, with_node_ids;
} plan;

static void make_plan(call* now, const shearbus_request* request, plan* to) {
  memset(to, 0, sizeof *to);
  if (request == NULL || request->size != sizeof *request || request->n_inputs > COLUMNS_AT_MOST ||
      request->n_outputs > COLUMNS_AT_MOST || (request->inputs == NULL && request->n_inputs > 0) ||
      (request->outputs == NULL && request->n_outputs > 0)) {
    refuse(now, SHEARBUS_INVALID_VALUE, "request", "Start the request from SHEARBUS_REQUEST_INIT.",
           "the request is NULL, has another size than that of this header, or has columns at NULL or more than %d",
           COLUMNS_AT_MOST);
    return;
  }
  to->dt_s = request->dt_s;
  to->time_s = request->time_s;
  to->step = request->step;
  to->n_inputs = request->n_inputs;
  to->n_outputs = request->n_outputs;
  to->attempt = request->attempt;
  to->mode = request->mode;
  to->commit_previous = request->commit_previous;
  to->all_or_nothing = request->all_or_nothing;
  to->open_absent = request->open_absent;
  to->with_node_ids = request->node_ids != NULL;
  const void* at_null = NULL;
  for (size_t c = 0; c < request->n_inputs + request->n_outputs; ++c) {
    const int is_input = c < request->n_inputs;
    const shearbus_input* in = &request->inputs[c];
    const shearbus_output* out = &request->outputs[is_input ? 0 : c - request->n_inputs];
    to->columns[c][0] = is_input ? in->field : out->field;
    to->columns[c][1] = is_input ? in->component : out->component;
    const char* name = shearbus_field_name(to->columns[c][0]);
    if (request->n > 0 && (is_input ? (const void*)in->values : out->values) == at_null)
      refuse(now, SHEARBUS_INVALID_VALUE, name == NULL ? "" : name, "Give one value per row.",
             "the values of column %u are NULL", to->columns[c][0]);
  }
}

static size_t bytes_of(uint32_t field) {
  return field == SHEARBUS_REGIME || field == SHEARBUS_OUTCOME ? 1 : sizeof(double);
}
static ptrdiff_t stride_of(ptrdiff_t given, size_t bytes) {
  return given == 0 ? (ptrdiff_t)bytes : given;
}

/* The columns of one rank, or on rank 0 of all ranks: each `rows` values without gaps. */
typedef struct columns {
  uint64_t* ids;
  double* in;
  char* out;
} columns;
static columns make_columns(call* now, size_t rows, const plan* of) {
  columns made;
  made.ids = zeros(now, of->with_node_ids ? rows : 0, sizeof(uint64_t));
  made.in = zeros(now, rows * of->n_inputs, sizeof(double));
  made.out = zeros(now, rows * of->n_outputs, sizeof(double));
  return made;
}

/* Rank 0: the step of all rows. */
static int step_all(shearbus_session* session, const shearbus_request* request, size_t rows, columns* all,
                    shearbus_result* result, shearbus_status* status) {
  shearbus_input inputs[COLUMNS_AT_MOST];
  shearbus_output outputs[COLUMNS_AT_MOST];
  shearbus_request whole = *request;
  for (size_t c = 0; c < request->n_inputs; ++c) {
    const shearbus_input input = {request->inputs[c].field, request->inputs[c].component, all->in + c * rows, 0};
    inputs[c] = input;
  }
  for (size_t c = 0; c < request->n_outputs; ++c) {
    const shearbus_output output = {request->outputs[c].field, request->outputs[c].component,
                                    all->out + c * rows * sizeof(double), 0};
    outputs[c] = output;
  }
  whole.n = rows;
  whole.node_ids = request->node_ids == NULL ? NULL : all->ids;
  whole.inputs = inputs;
  whole.outputs = outputs;
  return shearbus_step(session, &whole, result, status);
}

/* Rank 0: the rank whose row has the first node that the fault of a step names; -1 if it names none. */
static int rank_at_fault(const shearbus_mpi* ranks, const shearbus_session* session, const uint64_t* ids, size_t rows,
                         const int* at, const shearbus_status* status) {
  if (ids == NULL && shearbus_node_count(session) == rows) ids = shearbus_node_ids(session);
  if (ids == NULL || status->n_nodes == 0) return -1;
  size_t row = 0;
  while (row < rows && ids[row] != status->nodes[0]) ++row;
  if (row == rows) return -1;
  int rank = ranks->size - 1;
  while (rank > 0 && (size_t)at[rank] > row) --rank;
  return rank;
}

int shearbus_mpi_step_on_root(shearbus_mpi* ranks, shearbus_session* session, const shearbus_request* request,
                              shearbus_result* result, shearbus_status* status) {
  call now;
  shearbus_result answer = SHEARBUS_RESULT_INIT;
  if (!begin_on(&now, ranks, status)) return now.code;
  plan mine, root;
  make_plan(&now, request, &mine);
  root = mine;
  mpi(&now, MPI_Bcast(&root, (int)sizeof root, MPI_BYTE, 0, ranks->comm));
  if (memcmp(&root, &mine, sizeof root) != 0) {
    const char* const remedy =
        "Give the same columns in the same order, node ids on all or on no rank, dt and mode on all ranks.";
    if (mine.dt_s != root.dt_s)
      refuse(&now, SHEARBUS_SHAPE, "", remedy, "the dt of the step is %g s, and that of rank 0 %g s", mine.dt_s,
             root.dt_s);
    else
      refuse(&now, SHEARBUS_SHAPE, "", remedy,
             "the step has other columns, node ids or another mode than that of rank 0");
  }
  if (ranks->rows == NULL)
    refuse(&now, SHEARBUS_INVALID_VALUE, "", "Call shearbus_step() on every rank.",
           "every rank has a session of its own");
  if (is_sound(&now) && !mine.with_node_ids && request->n != (size_t)ranks->rows[ranks->rank])
    refuse(&now, SHEARBUS_SHAPE, "n", "Give one row per node of the opening, or name the node of each row in node_ids.",
           "n is %zu, and this rank has %d nodes", request->n, ranks->rows[ranks->rank]);
  if (is_sound(&now) && request->n > INT_MAX)
    refuse(&now, SHEARBUS_LIMIT, "n", "Step fewer rows.", "n is %zu, expected at most %d", request->n, INT_MAX);
  int* rows = zeros(&now, (size_t)ranks->size, sizeof *rows);
  int* at = zeros(&now, (size_t)ranks->size, sizeof *at);
  if (!agree(&now)) return end(&now);

  const int n = (int)request->n;
  const size_t size = request->n;
  mpi(&now, MPI_Allgather(&n, 1, MPI_INT, rows, 1, MPI_INT, ranks->comm));
  long long total = 0;
  for (int r = 0; r < ranks->size; ++r) total += rows[r];
  if (total > INT_MAX)
    refuse(&now, SHEARBUS_LIMIT, "n", "Step fewer rows.", "all ranks have %lld rows, expected at most %d", total,
           INT_MAX);
  else
    offsets(ranks->size, rows, at);
  const size_t on_root = ranks->rank == 0 && total <= INT_MAX ? (size_t)total : 0;
  columns own = make_columns(&now, size, &mine), all = make_columns(&now, on_root, &mine);
  if (!agree(&now)) return end(&now);
  if (mine.with_node_ids)
    mpi(&now, MPI_Gatherv(request->node_ids, n, MPI_UINT64_T, all.ids, rows, at, MPI_UINT64_T, 0, ranks->comm));
  for (size_t c = 0; c < mine.n_inputs; ++c) {
    const char* from = (const char*)request->inputs[c].values;
    const ptrdiff_t stride = stride_of(request->inputs[c].stride_bytes, sizeof(double));
    for (size_t i = 0; i < size; ++i) memcpy(own.in + c * size + i, from + (ptrdiff_t)i * stride, sizeof(double));
    mpi(&now,
        MPI_Gatherv(own.in + c * size, n, MPI_DOUBLE, all.in + c * on_root, rows, at, MPI_DOUBLE, 0, ranks->comm));
  }
  int whose = -1;
  if (ranks->rank == 0) {
    now.code = step_all(session, request, on_root, &all, &answer, now.status);
    if (!is_sound(&now))
      whose = rank_at_fault(ranks, session, mine.with_node_ids ? all.ids : NULL, on_root, at, now.status);
  }
  if (!agree_on(&now, whose)) return end(&now);
  for (size_t c = 0; c < mine.n_outputs; ++c) {
    const size_t bytes = bytes_of(request->outputs[c].field);
    const ptrdiff_t stride = stride_of(request->outputs[c].stride_bytes, bytes);
    const MPI_Datatype type = bytes == 1 ? MPI_UINT8_T : MPI_DOUBLE;
    char *values = own.out + c * size * sizeof(double), *to = (char*)request->outputs[c].values;
    mpi(&now, MPI_Scatterv(all.out + c * on_root * sizeof(double), rows, at, type, values, n, type, 0, ranks->comm));
    for (size_t i = 0; i < size; ++i) memcpy(to + (ptrdiff_t)i * stride, values + i * bytes, bytes);
  }
  mpi(&now, MPI_Bcast(&answer, (int)sizeof answer, MPI_BYTE, 0, ranks->comm));
  if (result != NULL && result->size == sizeof answer) *result = answer;
  agree(&now);
  return end(&now);
}

/* ---- entries for the Fortran module (client/mpi/shearbus_ranks.f90) ---- */

int shearbus_mpi_open_f(shearbus_mpi** ranks, int comm, int fault, int on_root, shearbus_session** session,
                        const shearbus_options* options, size_t n, const uint64_t* node_ids,
                        const double* initial_temperature_k, shearbus_status* status);
int shearbus_mpi_restart_f(shearbus_mpi** ranks, int comm, shearbus_session** session, const shearbus_options* options,
                           const char* path, size_t n, const uint64_t* node_ids, shearbus_status* status);
int shearbus_mpi_step_f(shearbus_mpi* ranks, shearbus_session* session, int fault, const shearbus_request* request,
                        shearbus_result* result, shearbus_status* status);
void shearbus_mpi_share_f(shearbus_mpi* ranks, void* from_root, int bytes);

/* fault: of this rank, before the call. */
int shearbus_mpi_open_f(shearbus_mpi** ranks, int comm, int fault, int on_root, shearbus_session** session,
                        const shearbus_options* options, size_t n, const uint64_t* node_ids,
                        const double* initial_temperature_k, shearbus_status* status) {
  shearbus_mpi first = ranks_of(MPI_Comm_f2c((MPI_Fint)comm));
  const int code = shearbus_mpi_agree(&first, fault, status);
  if (code != SHEARBUS_OK) return code;
  return (on_root ? shearbus_mpi_open_on_root : shearbus_mpi_open)(ranks, first.comm, session, options, n, node_ids,
                                                                   initial_temperature_k, status);
}
int shearbus_mpi_restart_f(shearbus_mpi** ranks, int comm, shearbus_session** session, const shearbus_options* options,
                           const char* path, size_t n, const uint64_t* node_ids, shearbus_status* status) {
  return shearbus_mpi_restart(ranks, MPI_Comm_f2c((MPI_Fint)comm), session, options, path, n, node_ids, status);
}
int shearbus_mpi_step_f(shearbus_mpi* ranks, shearbus_session* session, int fault, const shearbus_request* request,
                        shearbus_result* result, shearbus_status* status) {
  const int code = shearbus_mpi_agree(ranks, fault, status);
  return code != SHEARBUS_OK ? code : shearbus_mpi_step_on_root(ranks, session, request, result, status);
}
void shearbus_mpi_share_f(shearbus_mpi* ranks, void* from_root, int bytes) {
  call now;
  begin(&now, ranks, NULL);
  mpi(&now, MPI_Bcast(from_root, bytes, MPI_BYTE, 0, ranks->comm));
}
