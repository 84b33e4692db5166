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

/* ---- faults ---- */

static int refuse(shearbus_status* status, int code, const char* field, const char* remedy, const char* format, ...) {
  va_list arguments;
  va_start(arguments, format);
  vsnprintf(status->text, sizeof status->text, format, arguments);
  va_end(arguments);
  snprintf(status->remedy, sizeof status->remedy, "%s", remedy);
  snprintf(status->field, sizeof status->field, "%s", field);
  status->n_nodes = 0;
  return status->code = code;
}
static void name_node(shearbus_status* status, uint64_t node) {
  if (status->n_nodes < SHEARBUS_NODES_NAMED) status->nodes[status->n_nodes++] = node;
}

/* Memory for n elements, set to 0, until `held` is released. After the first fault nothing is allocated any more. */
static void* zeros(block** held, size_t n, size_t size, int* code, shearbus_status* status) {
  if (*code != SHEARBUS_OK) return NULL;
  block* made = n > (SIZE_MAX - sizeof *made) / size ? NULL : calloc(1, sizeof *made + n * size);
  if (made == NULL) {
    *code = refuse(status, SHEARBUS_NO_MEMORY, "", "Free memory and make the same call again.",
                   "the host's process has no memory left");
    return NULL;
  }
  made->before = *held;
  *held = made;
  return made + 1;
}
static void release(block* held) {
  while (held != NULL) {
    block* const before = held->before;
    free(held);
    held = before;
  }
}

static void mpi(shearbus_mpi* ranks, int code) {
  if (code != MPI_SUCCESS && ranks->mpi_fault == MPI_SUCCESS) ranks->mpi_fault = code;
}

static int is_in_doubt(int code) {
  return code == SHEARBUS_UNKNOWN_OUTCOME || code == SHEARBUS_NO_MEMORY;
}

/* Gives all ranks the fault of one: of the lowest rank whose request may have run, else of the lowest that was
 * refused. The text names that rank, or `whose` if that is none of them: the rank whose values are at fault. */
static int agree_on(shearbus_mpi* ranks, int code, shearbus_status* status, int whose) {
  if (code == SHEARBUS_OK && ranks->mpi_fault != MPI_SUCCESS) {
    char text[MPI_MAX_ERROR_STRING] = "";
    int length = 0;
    MPI_Error_string(ranks->mpi_fault, text, &length);
    code = refuse(status, SHEARBUS_LIBRARY_FAULT, "", "End the run; its sessions stay on the server.", "MPI: %s", text);
  }
  const int mine = code == SHEARBUS_OK ? INT_MAX : is_in_doubt(code) ? ranks->rank : ranks->size + ranks->rank;
  int first = mine;
  mpi(ranks, MPI_Allreduce(&mine, &first, 1, MPI_INT, MPI_MIN, ranks->comm));
  if (first == INT_MAX) return ranks->mpi_fault == MPI_SUCCESS ? SHEARBUS_OK : SHEARBUS_LIBRARY_FAULT;
  const int from = first % ranks->size;
  shearbus_status theirs = *status;
  if (ranks->rank == from) {
    const int prefix = snprintf(theirs.text, sizeof theirs.text, "rank %d: ", whose < 0 ? from : whose);
    snprintf(theirs.text + prefix, sizeof theirs.text - (size_t)prefix, "%.*s", (int)(sizeof theirs.text - 32),
             status->code == code ? status->text : shearbus_code_name(code));
    theirs.code = code;
  }
  mpi(ranks, MPI_Bcast(&theirs, (int)sizeof theirs, MPI_BYTE, from, ranks->comm));
  *status = theirs;
  return theirs.code;
}

static int agree(shearbus_mpi* ranks, int code, shearbus_status* status) {
  return agree_on(ranks, code, status, -1);
}

/* The caller's status, or one of our own where there is none that can be filled. */
static shearbus_status* usable(shearbus_status* given, shearbus_status* own) {
  return given != NULL && given->size == sizeof *given ? given : own;
}

static int missing(const shearbus_mpi* ranks, shearbus_status* status) {
  return ranks != NULL ? SHEARBUS_OK
                       : refuse(status, SHEARBUS_INVALID_VALUE, "ranks", "Call shearbus_mpi_open() first.",
                                "there are no ranks: they were not opened");
}

/* ---- the ranks of a run ---- */

static void drop(shearbus_mpi** ranks) {
  if (*ranks == NULL) return;
  for (size_t i = 0; i < (*ranks)->n_idle; ++i) shearbus_leave(&(*ranks)->idle[i]);
  release((*ranks)->held);
  *ranks = NULL;
}

static int start(shearbus_mpi** ranks, MPI_Comm comm, shearbus_session** session, shearbus_status* status) {
  shearbus_mpi now;
  memset(&now, 0, sizeof now);
  now.comm = comm;
  mpi(&now, MPI_Comm_rank(comm, &now.rank));
  mpi(&now, MPI_Comm_size(comm, &now.size));
  int code = SHEARBUS_OK;
  const int again = ranks != NULL && *ranks != NULL && (*ranks)->in_doubt;
  if (ranks == NULL || session == NULL)
    code = refuse(status, SHEARBUS_INVALID_VALUE, "", "Give &ranks and &session.", "an address is NULL");
  else if (!again && (*ranks != NULL || *session != NULL))
    code = refuse(status, SHEARBUS_INVALID_VALUE, "", "Close them first, or use other handles.",
                  "these ranks or this session are open already");
  shearbus_mpi* made = again ? NULL : zeros(&now.held, 1, sizeof *made, &code, status);
  code = agree(&now, code, status);
  if (code == SHEARBUS_OK && !again) {
    mpi(&now, MPI_Comm_dup(comm, &now.comm));
    *made = now;
    *ranks = made;
    return SHEARBUS_OK;
  }
  release(now.held);
  return code;
}

/* After the sessions of all ranks were to be opened: all are open, or none. */
static int settle(shearbus_mpi** ranks, shearbus_session** session, int code, shearbus_status* status) {
  const int agreed = agree(*ranks, code, status);
  (*ranks)->in_doubt = is_in_doubt(agreed);
  if (agreed == SHEARBUS_OK) return agreed;
  if (code == SHEARBUS_OK) shearbus_close(session, NULL);
  if (is_in_doubt(agreed)) return agreed;
  shearbus_leave(session);
  MPI_Comm_free(&(*ranks)->comm);
  drop(ranks);
  return agreed;
}

static int random_digits(char* to, shearbus_status* status) {
  unsigned char bytes[8] = {0};
  FILE* source = fopen("/dev/urandom", "rb");
  const size_t read = source == NULL ? 0 : fread(bytes, 1, sizeof bytes, source);
  if (source != NULL) fclose(source);
  if (read != sizeof bytes)
    return refuse(status, SHEARBUS_LIBRARY_FAULT, "domain", "Name the domain in shearbus_options.",
                  "/dev/urandom cannot be read, and the run needs a name");
  for (size_t i = 0; i < sizeof bytes; ++i) snprintf(to + 2 * i, 3, "%02x", bytes[i]);
  return SHEARBUS_OK;
}

static const char* environment(const char* name, const char* otherwise) {
  const char* value = getenv(name);
  return value == NULL || *value == '\0' ? otherwise : value;
}

/* Names the domain of the run on rank 0 and gives the name to all. */
static int choose_domain(shearbus_mpi* ranks, const char* given, shearbus_status* status) {
  int code = SHEARBUS_OK, length = 0;
  char digits[17] = "", *to = ranks->domain;
  if (ranks->rank == 0) {
    const char *slurm = environment("SLURM_JOB_ID", NULL), *pbs = environment("PBS_JOBID", NULL);
    if (given != NULL && *given != '\0') {
      length = snprintf(to, NAME_BYTES + 1, "%s", given);
    } else if (slurm != NULL) {
      length = snprintf(to, NAME_BYTES + 1, "slurm-%s-%s-%s", slurm, environment("SLURM_RESTART_COUNT", "0"),
                        environment("SLURM_STEP_ID", "0"));
    } else {
      code = random_digits(digits, status);
      length =
          snprintf(to, NAME_BYTES + 1, "%s%s%s%s", pbs == NULL ? "mpi" : "pbs-", pbs == NULL ? "" : pbs, "-", digits);
    }
    if (code == SHEARBUS_OK && length > NAME_BYTES)
      code = refuse(status, SHEARBUS_LIMIT, "domain", "Give a shorter name in shearbus_options.",
                    "the name of the domain has %d bytes, expected at most %d", length, NAME_BYTES);
  }
  mpi(ranks, MPI_Bcast(ranks->domain, NAME_BYTES + 1, MPI_CHAR, 0, ranks->comm));
  return agree(ranks, code, status);
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
  shearbus_status own = SHEARBUS_STATUS_INIT;
  shearbus_options mine = SHEARBUS_OPTIONS_INIT;
  status = usable(status, &own);
  int code = start(ranks, comm, session, status);
  if (code != SHEARBUS_OK) return code;
  if (!(*ranks)->in_doubt) {
    code = choose_domain(*ranks, options == NULL ? NULL : options->domain, status);
    if (code != SHEARBUS_OK) {
      MPI_Comm_free(&(*ranks)->comm);
      drop(ranks);
      return code;
    }
  }
  code = shearbus_open(session, in_domain(*ranks, options, &mine), n, node_ids, initial_temperature_k, status);
  return settle(ranks, session, code, status);
}

int shearbus_mpi_agree(shearbus_mpi* ranks, int code, shearbus_status* status) {
  shearbus_status own = SHEARBUS_STATUS_INIT;
  status = usable(status, &own);
  return missing(ranks, status) != SHEARBUS_OK ? SHEARBUS_INVALID_VALUE : agree(ranks, code, status);
}

int shearbus_mpi_close(shearbus_mpi** ranks, shearbus_session** session, shearbus_status* status) {
  shearbus_status own = SHEARBUS_STATUS_INIT;
  status = usable(status, &own);
  int code = session == NULL ? SHEARBUS_OK : shearbus_close(session, status);
  if (ranks == NULL || *ranks == NULL) return code;
  for (size_t i = 0; i < (*ranks)->n_idle; ++i) {
    shearbus_status of_idle = SHEARBUS_STATUS_INIT;
    const int found = shearbus_close(&(*ranks)->idle[i], &of_idle);
    if (code == SHEARBUS_OK && found != SHEARBUS_OK) {
      code = found;
      *status = of_idle;
    }
  }
  code = agree(*ranks, code, status);
  MPI_Comm_free(&(*ranks)->comm);
  drop(ranks);
  return code;
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
static int move_round(shearbus_mpi* ranks, int first, int n, size_t n_parcels, const parcel* parcels,
                      shearbus_session* to, shearbus_status* status) {
  const int size = ranks->size;
  const size_t s = (size_t)size, most = (size_t)n * n_parcels;
  int code = SHEARBUS_OK, n_given = 0, n_taken = 0;
  block* held = NULL;
  int* given_to = zeros(&held, s, sizeof(int), &code, status);
  int* given_at = zeros(&held, s, sizeof(int), &code, status);
  int* taken_from = zeros(&held, s, sizeof(int), &code, status);
  int* taken_at = zeros(&held, s, sizeof(int), &code, status);
  shearbus_session** giver = zeros(&held, most, sizeof *giver, &code, status);
  transfer* given = zeros(&held, most, sizeof *given, &code, status);
  unsigned char *refused = NULL, *returned = zeros(&held, most, 1, &code, status);
  transfer* taken = NULL;
  for (int d = 0; d < size && code == SHEARBUS_OK; ++d) {
    const int distance = (d - ranks->rank + size) % size;
    if (distance < first || distance >= first + n) continue;
    for (size_t p = 0; p < n_parcels && code == SHEARBUS_OK; ++p) {
      const size_t count = parcels[p].at[d + 1] - parcels[p].at[d];
      if (count == 0 || (d == ranks->rank && parcels[p].from == to)) continue;
      code = shearbus_offer(parcels[p].from, count, parcels[p].ids + parcels[p].at[d], given[n_given].id, status);
      if (code != SHEARBUS_OK) break;
      giver[n_given++] = parcels[p].from;
      ++given_to[d];
    }
  }
  code = agree(ranks, code, status);
  if (code == SHEARBUS_OK) {
    mpi(ranks, MPI_Alltoall(given_to, 1, MPI_INT, taken_from, 1, MPI_INT, ranks->comm));
    offsets(size, given_to, given_at);
    n_taken = offsets(size, taken_from, taken_at);
    taken = zeros(&held, (size_t)n_taken, sizeof *taken, &code, status);
    refused = zeros(&held, (size_t)n_taken, 1, &code, status);
    code = agree(ranks, code, status);
  }
  if (code != SHEARBUS_OK) { /* every giver takes back what it has offered */
    for (int i = 0; i < n_given; ++i) shearbus_accept(giver[i], given[i].id, NULL);
    release(held);
    return code;
  }

  MPI_Datatype bytes;
  mpi(ranks, MPI_Type_contiguous((int)sizeof(transfer), MPI_BYTE, &bytes));
  mpi(ranks, MPI_Type_commit(&bytes));
  mpi(ranks, MPI_Alltoallv(given, given_to, given_at, bytes, taken, taken_from, taken_at, bytes, ranks->comm));
  mpi(ranks, MPI_Type_free(&bytes));
  for (int i = 0; i < n_taken; ++i) {
    if (code == SHEARBUS_OK) code = shearbus_accept(to, taken[i].id, status);
    refused[i] = code != SHEARBUS_OK;
  }
  mpi(ranks,
      MPI_Alltoallv(refused, taken_from, taken_at, MPI_BYTE, returned, given_to, given_at, MPI_BYTE, ranks->comm));
  for (int i = 0; i < n_given; ++i)
    if (returned[i]) shearbus_accept(giver[i], given[i].id, NULL);
  release(held);
  return agree(ranks, code, status);
}

/* Moves the nodes of sessions of this rank to the sessions `to` of their owners. owner[i]: of the nodes of from[i]. */
static int move(shearbus_mpi* ranks, size_t n_from, shearbus_session** from, int** owner, shearbus_session* to,
                shearbus_status* status) {
  int code = SHEARBUS_OK;
  block* held = NULL;
  parcel* parcels = zeros(&held, n_from, sizeof *parcels, &code, status);
  for (size_t i = 0; i < n_from && code == SHEARBUS_OK; ++i) {
    parcels[i].from = from[i];
    parcels[i].ids = zeros(&held, shearbus_node_count(from[i]), sizeof(uint64_t), &code, status);
    parcels[i].at = zeros(&held, (size_t)ranks->size + 1, sizeof(size_t), &code, status);
    if (code == SHEARBUS_OK) sort_by_owner(&parcels[i], owner[i], ranks->size);
  }
  code = agree(ranks, code, status);
  for (int first = 0; first < ranks->size && code == SHEARBUS_OK; first += SHEARBUS_MPI_OFFERS_PER_ROUND) {
    const int left = ranks->size - first;
    code = move_round(ranks, first, left < SHEARBUS_MPI_OFFERS_PER_ROUND ? left : SHEARBUS_MPI_OFFERS_PER_ROUND, n_from,
                      parcels, to, status);
  }
  release(held);
  return code;
}

int shearbus_mpi_redistribute(shearbus_mpi* ranks, shearbus_session* session, const int* new_owner,
                              shearbus_status* status) {
  shearbus_status own = SHEARBUS_STATUS_INIT;
  status = usable(status, &own);
  int code = missing(ranks, status);
  if (code != SHEARBUS_OK) return code;
  block* held = NULL;
  const size_t n = shearbus_node_count(session);
  if (session == NULL)
    code = refuse(status, SHEARBUS_INVALID_VALUE, "", "Open a session on every rank.", "there is no session");
  else if (n > 0 && new_owner == NULL)
    code = refuse(status, SHEARBUS_INVALID_VALUE, "new_owner", "Give the rank of each node.",
                  "new_owner is NULL for %zu nodes", n);
  for (size_t i = 0; i < n && code == SHEARBUS_OK; ++i) {
    if (new_owner[i] >= 0 && new_owner[i] < ranks->size) continue;
    code = refuse(status, SHEARBUS_INVALID_VALUE, "new_owner", "Give a rank of the communicator.",
                  "new_owner of node %llu is %d, expected 0 to %d", (unsigned long long)shearbus_node_ids(session)[i],
                  new_owner[i], ranks->size - 1);
    name_node(status, shearbus_node_ids(session)[i]);
  }
  int* owner = zeros(&held, n, sizeof *owner, &code, status);
  if (code == SHEARBUS_OK && n > 0) memcpy(owner, new_owner, n * sizeof *owner);
  code = agree(ranks, code, status);
  if (code == SHEARBUS_OK) code = move(ranks, 1, &session, &owner, session, status);
  release(held);
  return code;
}

/* ---- the manifest ---- */

/* Tickets of the sessions of this rank, one line each, gathered on rank 0 in the order of the ranks. */
static int gather_tickets(shearbus_mpi* ranks, block** held, const char* word, int wanted, size_t n,
                          shearbus_session* const* sessions, const int* marked, char** text, int* count,
                          shearbus_status* status) {
  enum { LINE_BYTES = 16 + SHEARBUS_TICKET_BYTES };
  int code = SHEARBUS_OK, length = 0, lines = 0;
  char* mine = zeros(held, n * LINE_BYTES + 1, 1, &code, status);
  int* lengths = zeros(held, (size_t)ranks->size, sizeof(int), &code, status);
  int* at = zeros(held, (size_t)ranks->size, sizeof(int), &code, status);
  for (size_t i = 0; i < n && code == SHEARBUS_OK; ++i) {
    char ticket[SHEARBUS_TICKET_BYTES];
    if (marked[i] != wanted) continue;
    code = shearbus_ticket(sessions[i], ticket, status);
    if (code != SHEARBUS_OK) break;
    length += snprintf(mine + length, LINE_BYTES, "%s %s\n", word, ticket);
    ++lines;
  }
  *count = 0;
  *text = NULL;
  code = agree(ranks, code, status);
  if (code == SHEARBUS_OK) {
    mpi(ranks, MPI_Reduce(&lines, count, 1, MPI_INT, MPI_SUM, 0, ranks->comm));
    mpi(ranks, MPI_Gather(&length, 1, MPI_INT, lengths, 1, MPI_INT, 0, ranks->comm));
    *text = zeros(held, (size_t)offsets(ranks->size, lengths, at) + 1, 1, &code, status);
    code = agree(ranks, code, status);
  }
  if (code == SHEARBUS_OK)
    mpi(ranks, MPI_Gatherv(mine, length, MPI_CHAR, *text, lengths, at, MPI_CHAR, 0, ranks->comm));
  return code;
}

/* Brings the text to the disk under another name and renames it, so that the file is complete at any moment. */
static int write_whole(const char* path, const char* head, const char* first, const char* second,
                       shearbus_status* status) {
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
  const int fault = errno;
  if (done) { /* the new name lasts once its directory is on the disk, too */
    snprintf(other, sizeof other, "%.*s",
             slash == NULL   ? 1
             : slash == path ? 1
                             : (int)(slash - path),
             slash == NULL ? "." : path);
    directory = open(other, O_RDONLY | O_CLOEXEC);
    if (directory >= 0) {
      fsync(directory);
      close(directory);
    }
    return SHEARBUS_OK;
  }
  return refuse(status, fault == ENOSPC || fault == EDQUOT ? SHEARBUS_NO_SPACE : SHEARBUS_INVALID_VALUE, "manifest",
                "Name a file in a directory that rank 0 may write to, and write the dump again.",
                "the manifest %s cannot be written: %s", path, strerror(fault));
}

static int write_manifest(shearbus_mpi* ranks, const char* mark, const char* path, size_t n,
                          shearbus_session* const* sessions, const int* marked, shearbus_status* status) {
  char head[3 * NAME_BYTES], *with_mark = NULL, *without = NULL;
  int n_with = 0, n_without = 0;
  block* held = NULL;
  int code = gather_tickets(ranks, &held, "marked", 1, n, sessions, marked, &with_mark, &n_with, status);
  if (code == SHEARBUS_OK)
    code = gather_tickets(ranks, &held, "unmarked", 0, n, sessions, marked, &without, &n_without, status);
  if (code == SHEARBUS_OK) {
    snprintf(head, sizeof head, "shearbus manifest 1\nmark %s\ndomain %s\nsessions %d\n", mark, ranks->domain,
             n_with + n_without);
    if (ranks->rank == 0) code = write_whole(path, head, with_mark, without, status);
    code = agree(ranks, code, status);
  }
  release(held);
  return code;
}

static int check_line(const char* text, const char* what, shearbus_status* status) {
  size_t length = 0;
  while (text != NULL && (unsigned char)text[length] >= ' ') ++length;
  if (text != NULL && length > 0 && length <= NAME_BYTES && text[length] == '\0') return SHEARBUS_OK;
  return refuse(status, SHEARBUS_INVALID_VALUE, what, "Give a name without control characters.",
                "the %s is no name of 1 to %d bytes on one line", what, NAME_BYTES);
}

int shearbus_mpi_dump(shearbus_mpi* ranks, shearbus_session* session, const char* mark, const char* manifest,
                      shearbus_status* status) {
  shearbus_status own = SHEARBUS_STATUS_INIT;
  status = usable(status, &own);
  int code = missing(ranks, status);
  if (code != SHEARBUS_OK) return code;
  code = check_line(mark, "mark", status);
  if (code == SHEARBUS_OK) code = check_line(ranks->domain, "domain", status);
  if (code == SHEARBUS_OK && (manifest == NULL || *manifest == '\0'))
    code =
        refuse(status, SHEARBUS_INVALID_VALUE, "manifest", "Name a file beside the dump.", "the manifest has no name");
  block* held = NULL;
  const size_t n = ranks->n_idle + 1;
  shearbus_session** sessions = zeros(&held, n, sizeof *sessions, &code, status);
  int* marked = zeros(&held, n, sizeof *marked, &code, status);
  code = agree(ranks, code, status);
  if (code == SHEARBUS_OK) code = agree(ranks, shearbus_mark(session, mark, status), status);
  if (code == SHEARBUS_OK) {
    sessions[0] = session;
    marked[0] = 1;
    for (size_t i = 1; i < n; ++i) sessions[i] = ranks->idle[i - 1];
    code = write_manifest(ranks, mark, manifest, n, sessions, marked, status);
  }
  /* The server keeps two marks: after the second dump nothing needs the sessions without nodes. If one cannot be
   * closed, its idle limit ends it, or an operator. */
  if (code == SHEARBUS_OK && ++ranks->dumps == 2) {
    for (size_t i = 0; i < ranks->n_idle; ++i) shearbus_close(&ranks->idle[i], NULL);
    ranks->n_idle = 0;
  }
  release(held);
  return code;
}

/* ---- restart ---- */

typedef struct dump_file {
  block* held; /* all that is pointed to */
  char* text;
  const char *mark, *domain;
  int n;
  const char** tickets;
  int* marked;
} dump_file;

static char* read_file(block** held, const char* path, long* length, int* code, shearbus_status* status) {
  FILE* file = path == NULL ? NULL : fopen(path, "rb");
  char* text = NULL;
  *length = -1;
  if (file != NULL && fseek(file, 0, SEEK_END) == 0) *length = ftell(file);
  if (*length >= 0 && *length < INT_MAX && fseek(file, 0, SEEK_SET) == 0) {
    text = zeros(held, (size_t)*length + 1, 1, code, status);
    if (text != NULL && fread(text, 1, (size_t)*length, file) != (size_t)*length) *length = -1;
  }
  if (*code == SHEARBUS_OK && (*length < 0 || text == NULL))
    *code = refuse(status, SHEARBUS_INVALID_VALUE, "manifest", "Name the file that shearbus_mpi_dump() has written.",
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

static int parse(dump_file* to, const char* path, shearbus_status* status) {
  char *at = to->text, *end = NULL;
  const char* count = NULL;
  int code = SHEARBUS_OK, read = 0;
  if (value_of_line(&at, "shearbus manifest 1") != NULL && (to->mark = value_of_line(&at, "mark ")) != NULL &&
      (to->domain = value_of_line(&at, "domain ")) != NULL && (count = value_of_line(&at, "sessions ")) != NULL) {
    const long n = strtol(count, &end, 10);
    to->n = *end == '\0' && n > 0 && n < 1000000 ? (int)n : 0;
  }
  to->tickets = zeros(&to->held, (size_t)to->n, sizeof *to->tickets, &code, status);
  to->marked = zeros(&to->held, (size_t)to->n, sizeof *to->marked, &code, status);
  if (code != SHEARBUS_OK) return code;
  for (; read < to->n; ++read) {
    to->tickets[read] = value_of_line(&at, "marked ");
    to->marked[read] = to->tickets[read] != NULL;
    if (to->tickets[read] == NULL) to->tickets[read] = value_of_line(&at, "unmarked ");
    if (to->tickets[read] == NULL) break;
  }
  if (to->n > 0 && read == to->n && strcmp(at, "end\n") == 0 && strlen(to->domain) <= NAME_BYTES) return SHEARBUS_OK;
  return refuse(status, SHEARBUS_INVALID_VALUE, "manifest",
                "Name the file that shearbus_mpi_dump() has written, unchanged.",
                "%s is no complete manifest: %d of %d tickets were read", path, read, to->n);
}

static int read_manifest(shearbus_mpi* ranks, const char* path, dump_file* to, shearbus_status* status) {
  int code = SHEARBUS_OK;
  long length = 0;
  if (ranks->rank == 0) to->text = read_file(&to->held, path, &length, &code, status);
  code = agree(ranks, code, status);
  if (code != SHEARBUS_OK) return code;
  mpi(ranks, MPI_Bcast(&length, 1, MPI_LONG, 0, ranks->comm));
  if (ranks->rank != 0) to->text = zeros(&to->held, (size_t)length + 1, 1, &code, status);
  code = agree(ranks, code, status);
  if (code != SHEARBUS_OK) return code;
  mpi(ranks, MPI_Bcast(to->text, (int)length, MPI_CHAR, 0, ranks->comm));
  code = agree(ranks, parse(to, path == NULL ? "the file" : path, status), status);
  if (code == SHEARBUS_OK) snprintf(ranks->domain, sizeof ranks->domain, "%s", to->domain);
  return code;
}

/* Opens this rank's session without nodes, with the scene of rank 0's. */
static int open_empty(shearbus_mpi* ranks, shearbus_session** session, const shearbus_session* of_rank_0,
                      const shearbus_options* options, shearbus_status* status) {
  shearbus_options mine = SHEARBUS_OPTIONS_INIT;
  int code = SHEARBUS_OK;
  block* held = NULL;
  long length = ranks->rank == 0 ? (long)strlen(shearbus_effective_scene(of_rank_0)) : 0;
  mpi(ranks, MPI_Bcast(&length, 1, MPI_LONG, 0, ranks->comm));
  char* scene = zeros(&held, (size_t)length + 1, 1, &code, status);
  if (scene != NULL && ranks->rank == 0) memcpy(scene, shearbus_effective_scene(of_rank_0), (size_t)length);
  code = agree(ranks, code, status);
  if (code == SHEARBUS_OK) {
    mpi(ranks, MPI_Bcast(scene, (int)length, MPI_CHAR, 0, ranks->comm));
    options = in_domain(ranks, options, &mine);
    mine.scene_file = NULL;
    mine.scene_text = scene;
    const int lacks = *session == NULL;
    if (lacks) code = shearbus_open(session, options, 0, NULL, NULL, status);
    const int opened = lacks && code == SHEARBUS_OK;
    code = agree(ranks, code, status);
    if (code != SHEARBUS_OK && opened) shearbus_close(session, NULL);
  }
  release(held);
  return code;
}

/* Takes the nodes out of a session: its waiting offers first, which hold nodes, too. */
static int empty(shearbus_session* session, shearbus_status* status) {
  int code = SHEARBUS_OK;
  block* held = NULL;
  const size_t n_offers = shearbus_offers(session, 0, NULL);
  uint8_t(*offers)[SHEARBUS_TRANSFER_BYTES] = zeros(&held, n_offers, sizeof *offers, &code, status);
  if (offers != NULL) shearbus_offers(session, n_offers, offers);
  for (size_t i = 0; i < n_offers && code == SHEARBUS_OK; ++i) {
    code = shearbus_accept(session, offers[i], status);
    if (code == SHEARBUS_UNKNOWN_TRANSFER) code = SHEARBUS_OK; /* another session has accepted it since */
  }
  const size_t n = shearbus_node_count(session);
  uint64_t* ids = zeros(&held, n, sizeof *ids, &code, status);
  if (code == SHEARBUS_OK && n > 0) {
    memcpy(ids, shearbus_node_ids(session), n * sizeof *ids);
    code = shearbus_retire(session, n, ids, status);
  }
  release(held);
  return code;
}

/* Brings back the nodes and states of the mark. Nodes that have moved between sessions since the mark stand in each
 * other's way: then the sessions concerned are emptied first, since the mark keeps its states by itself. */
static int roll_back(shearbus_mpi* ranks, const char* mark, size_t n, shearbus_session** sessions, int* marked,
                     shearbus_status* status) {
  int code = SHEARBUS_OK;
  block* held = NULL;
  int* blocked = zeros(&held, n, sizeof *blocked, &code, status);
  for (size_t i = 0; i < n && code == SHEARBUS_OK; ++i) {
    blocked[i] = !marked[i];
    if (marked[i]) code = shearbus_rollback_to(sessions[i], mark, status);
    if (code == SHEARBUS_NODE_OWNED) {
      blocked[i] = 1;
      code = SHEARBUS_OK;
    }
  }
  code = agree(ranks, code, status);
  for (size_t i = 0; i < n && code == SHEARBUS_OK; ++i)
    if (blocked[i]) code = empty(sessions[i], status);
  code = agree(ranks, code, status);
  for (size_t i = 0; i < n && code == SHEARBUS_OK; ++i)
    if (blocked[i] && marked[i]) code = shearbus_rollback_to(sessions[i], mark, status);
  release(held);
  return agree(ranks, code, status);
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
static claim* gather_claims(shearbus_mpi* ranks, block** held, size_t n, const uint64_t* node_ids, size_t* total,
                            int* code, shearbus_status* status) {
  const size_t s = (size_t)ranks->size;
  const long long mine = (long long)n;
  long long all = 0;
  int count = (int)n;
  if (n > 0 && node_ids == NULL)
    *code = refuse(status, SHEARBUS_INVALID_VALUE, "node_ids", "Give one id per node.",
                   "node_ids is NULL for %zu nodes", n);
  mpi(ranks, MPI_Allreduce(&mine, &all, 1, MPI_LONG_LONG, MPI_SUM, ranks->comm));
  if (*code == SHEARBUS_OK && all > INT_MAX)
    *code = refuse(status, SHEARBUS_LIMIT, "node_ids", "Divide the interface between several domains.",
                   "the ranks ask for %lld nodes, expected at most %d", all, INT_MAX);
  int* counts = zeros(held, s, sizeof *counts, code, status);
  int* at = zeros(held, s, sizeof *at, code, status);
  uint64_t* ids = zeros(held, (size_t)all, sizeof *ids, code, status);
  claim* claims = zeros(held, (size_t)all, sizeof *claims, code, status);
  *code = agree(ranks, *code, status);
  if (*code == SHEARBUS_OK) {
    mpi(ranks, MPI_Allgather(&count, 1, MPI_INT, counts, 1, MPI_INT, ranks->comm));
    offsets(ranks->size, counts, at);
    mpi(ranks, MPI_Allgatherv(node_ids, count, MPI_UINT64_T, ids, counts, at, MPI_UINT64_T, ranks->comm));
    for (int r = 0; r < ranks->size; ++r)
      for (int i = at[r]; i < at[r] + counts[r]; ++i) {
        const claim one = {ids[i], r, (size_t)i};
        claims[i] = one;
      }
    *total = (size_t)all;
    qsort(claims, *total, sizeof *claims, by_id);
    for (size_t i = 1; i < *total; ++i)
      if (claims[i].id == claims[i - 1].id) {
        if (*code == SHEARBUS_OK)
          *code = refuse(status, SHEARBUS_DUPLICATE_NODE, "node_ids", "Ask for each node of the dump once.",
                         "node %llu is asked for by rank %d and by rank %d", (unsigned long long)claims[i].id,
                         claims[i - 1].rank, claims[i].rank);
        name_node(status, claims[i].id);
      }
    *code = agree(ranks, *code, status);
  }
  return claims;
}

/* Finds the rank that asks for each node of the sessions, which must be the nodes that are asked for, each once. */
static int find_owners(shearbus_mpi* ranks, block** held, size_t n_sessions, shearbus_session* const* sessions,
                       const claim* claims, size_t total, int** owner, shearbus_status* status) {
  int code = SHEARBUS_OK;
  unsigned char* found = zeros(held, total, 1, &code, status);
  for (size_t i = 0; i < n_sessions; ++i) {
    const size_t n = shearbus_node_count(sessions[i]);
    const uint64_t* ids = shearbus_node_ids(sessions[i]);
    owner[i] = zeros(held, n, sizeof(int), &code, status);
    for (size_t j = 0; j < n && (code == SHEARBUS_OK || code == SHEARBUS_UNKNOWN_NODE); ++j) {
      const claim key = {ids[j], 0, 0};
      const claim* hit = total == 0 ? NULL : bsearch(&key, claims, total, sizeof *claims, by_id);
      if (hit != NULL) {
        if (owner[i] != NULL) owner[i][j] = hit->rank;
        found[hit - claims] = 1;
        continue;
      }
      if (code == SHEARBUS_OK)
        code = refuse(status, SHEARBUS_UNKNOWN_NODE, "node_ids",
                      "Ask for every node of the dump; retire nodes afterwards.",
                      "node %llu is in the dump, and no rank asks for it", (unsigned long long)ids[j]);
      name_node(status, ids[j]);
    }
  }
  code = agree(ranks, code, status);
  if (code == SHEARBUS_OK) {
    mpi(ranks, MPI_Allreduce(MPI_IN_PLACE, found, (int)total, MPI_UNSIGNED_CHAR, MPI_MAX, ranks->comm));
    for (size_t i = 0; i < total; ++i) {
      if (found[i]) continue;
      if (code == SHEARBUS_OK)
        code = refuse(status, SHEARBUS_UNKNOWN_NODE, "node_ids",
                      "Ask for the nodes of the dump; register others afterwards.",
                      "node %llu is asked for by rank %d, and is not in the dump", (unsigned long long)claims[i].id,
                      claims[i].rank);
      name_node(status, claims[i].id);
    }
    code = agree(ranks, code, status);
  }
  return code;
}

static int restart(shearbus_mpi* ranks, shearbus_session** session, const shearbus_options* options, const char* path,
                   size_t n, const uint64_t* node_ids, size_t* n_mine, shearbus_session*** mine,
                   shearbus_status* status) {
  dump_file from;
  memset(&from, 0, sizeof from);
  int code = read_manifest(ranks, path, &from, status);
  size_t total = 0;
  claim* claims = NULL;
  if (code == SHEARBUS_OK) claims = gather_claims(ranks, &from.held, n, node_ids, &total, &code, status);
  const int share = code != SHEARBUS_OK ? 0 : (from.n - ranks->rank + ranks->size - 1) / ranks->size;
  const size_t most = share > 0 ? (size_t)share : 0;
  int* marked = zeros(&from.held, most + 1, sizeof *marked, &code, status);
  int** owner = zeros(&from.held, most + 1, sizeof *owner, &code, status);
  *mine = zeros(&ranks->held, most + 1, sizeof **mine, &code, status);
  for (size_t i = 0; i < most && code == SHEARBUS_OK; ++i) { /* session i of the manifest goes to rank i modulo size */
    const size_t at = (size_t)ranks->rank + i * (size_t)ranks->size;
    marked[*n_mine] = from.marked[at];
    code = shearbus_resume(&(*mine)[*n_mine], options, from.tickets[at], status);
    if (code == SHEARBUS_OK) ++*n_mine;
    if (code == SHEARBUS_UNKNOWN_SESSION && !from.marked[at]) code = SHEARBUS_OK; /* ended since, and held no state */
  }
  code = agree(ranks, code, status);
  if (code == SHEARBUS_OK) {
    const int lacks = *n_mine == 0;
    int any = 0;
    mpi(ranks, MPI_Allreduce(&lacks, &any, 1, MPI_INT, MPI_MAX, ranks->comm));
    if (any) { /* the manifest names the new sessions before they get nodes */
      code = open_empty(ranks, &(*mine)[0], (*mine)[0], options, status);
      if (code == SHEARBUS_OK && lacks) *n_mine = 1;
      if (code == SHEARBUS_OK) code = write_manifest(ranks, from.mark, path, *n_mine, *mine, marked, status);
    }
  }
  if (code == SHEARBUS_OK) code = roll_back(ranks, from.mark, *n_mine, *mine, marked, status);
  if (code == SHEARBUS_OK) code = find_owners(ranks, &from.held, *n_mine, *mine, claims, total, owner, status);
  if (code == SHEARBUS_OK) code = move(ranks, *n_mine, *mine, owner, (*mine)[0], status);
  if (code == SHEARBUS_OK) *session = (*mine)[0];
  release(from.held);
  return code;
}

int shearbus_mpi_restart(shearbus_mpi** ranks, MPI_Comm comm, shearbus_session** session,
                         const shearbus_options* options, const char* manifest, size_t n, const uint64_t* node_ids,
                         shearbus_status* status) {
  shearbus_status own = SHEARBUS_STATUS_INIT;
  status = usable(status, &own);
  int code = start(ranks, comm, session, status);
  if (code != SHEARBUS_OK) return code;
  shearbus_session** mine = NULL;
  size_t n_mine = 0;
  code = restart(*ranks, session, options, manifest, n, node_ids, &n_mine, &mine, status);
  if (code == SHEARBUS_OK) {
    (*ranks)->n_idle = n_mine - 1;
    (*ranks)->idle = mine;
    memmove(mine, mine + 1, (n_mine - 1) * sizeof *mine);
    return code;
  }
  for (size_t i = 0; i < n_mine; ++i) shearbus_leave(&mine[i]);
  MPI_Comm_free(&(*ranks)->comm);
  drop(ranks);
  return code;
}

/* ---- one session on root ---- */

int shearbus_mpi_open_on_root(shearbus_mpi** ranks, MPI_Comm comm, shearbus_session** session,
                              const shearbus_options* options, size_t n, const uint64_t* node_ids,
                              const double* initial_temperature_k, shearbus_status* status) {
  shearbus_status own = SHEARBUS_STATUS_INIT;
  status = usable(status, &own);
  int code = start(ranks, comm, session, status);
  if (code != SHEARBUS_OK) return code;
  shearbus_mpi* all = *ranks;
  const int with_temperatures = initial_temperature_k != NULL, mine = n > INT_MAX ? INT_MAX : (int)n;
  int any[2] = {with_temperatures, !with_temperatures};
  long long rows = (long long)n, total = 0;
  block* held = NULL;
  if (n > 0 && node_ids == NULL)
    code = refuse(status, SHEARBUS_INVALID_VALUE, "node_ids", "Give one id per node.", "node_ids is NULL for %zu nodes",
                  n);
  mpi(all, MPI_Allreduce(MPI_IN_PLACE, any, 2, MPI_INT, MPI_MAX, all->comm));
  mpi(all, MPI_Allreduce(&rows, &total, 1, MPI_LONG_LONG, MPI_SUM, all->comm));
  if (code == SHEARBUS_OK && any[0] && any[1])
    code = refuse(status, SHEARBUS_SHAPE, "initial_temperature_k",
                  "Give one value per node on every rank, or NULL on every rank.",
                  "some ranks give initial_temperature_k, and others do not");
  if (code == SHEARBUS_OK && total > INT_MAX)
    code = refuse(status, SHEARBUS_LIMIT, "node_ids", "Use shearbus_mpi_open().",
                  "the ranks have %lld nodes, expected at most %d", total, INT_MAX);
  const size_t on_root = all->rank == 0 && total <= INT_MAX ? (size_t)total : 0;
  int* at = zeros(&held, (size_t)all->size, sizeof *at, &code, status);
  uint64_t* ids = zeros(&held, on_root, sizeof *ids, &code, status);
  double* temperatures = zeros(&held, on_root, sizeof *temperatures, &code, status);
  all->rows = zeros(&all->held, (size_t)all->size, sizeof *all->rows, &code, status);
  code = agree(all, code, status);
  const int ready = code == SHEARBUS_OK;
  if (ready) {
    mpi(all, MPI_Allgather(&mine, 1, MPI_INT, all->rows, 1, MPI_INT, all->comm));
    offsets(all->size, all->rows, at);
    mpi(all, MPI_Gatherv(node_ids, mine, MPI_UINT64_T, ids, all->rows, at, MPI_UINT64_T, 0, all->comm));
    if (any[0])
      mpi(all,
          MPI_Gatherv(initial_temperature_k, mine, MPI_DOUBLE, temperatures, all->rows, at, MPI_DOUBLE, 0, all->comm));
    if (all->rank == 0) code = shearbus_open(session, options, on_root, ids, any[0] ? temperatures : NULL, status);
  }
  release(held);
  return settle(ranks, session, code, status);
}

/* What all ranks must give alike. Compared by its bytes, which are all set. */
typedef struct plan {
  double dt_s, time_s;
  uint64_t step, n_inputs, n_outputs;
  uint32_t columns[2 * COLUMNS_AT_MOST][2];
  uint32_t attempt;
  int mode, commit_previous, all_or_nothing, open_absent, with_node_ids;
} plan;

static int make_plan(const shearbus_request* request, plan* to, shearbus_status* status) {
  memset(to, 0, sizeof *to);
  if (request == NULL || request->size != sizeof *request || request->n_inputs > COLUMNS_AT_MOST ||
      request->n_outputs > COLUMNS_AT_MOST || (request->inputs == NULL && request->n_inputs > 0) ||
      (request->outputs == NULL && request->n_outputs > 0))
    return refuse(
        status, SHEARBUS_INVALID_VALUE, "request", "Start the request from SHEARBUS_REQUEST_INIT.",
        "the request is NULL, has another size than that of this header, or has columns at NULL or more than %d",
        COLUMNS_AT_MOST);
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
    if (request->n > 0 && (is_input ? (const void*)in->values : out->values) == at_null)
      return refuse(status, SHEARBUS_INVALID_VALUE,
                    shearbus_field_name(to->columns[c][0]) == NULL ? "" : shearbus_field_name(to->columns[c][0]),
                    "Give one value per row.", "the values of column %u are NULL", to->columns[c][0]);
  }
  return SHEARBUS_OK;
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
static columns make_columns(block** held, size_t rows, const plan* of, int* code, shearbus_status* status) {
  columns made;
  made.ids = zeros(held, of->with_node_ids ? rows : 0, sizeof(uint64_t), code, status);
  made.in = zeros(held, rows * of->n_inputs, sizeof(double), code, status);
  made.out = zeros(held, rows * of->n_outputs, sizeof(double), code, status);
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
  shearbus_status own = SHEARBUS_STATUS_INIT;
  shearbus_result answer = SHEARBUS_RESULT_INIT;
  status = usable(status, &own);
  int code = missing(ranks, status);
  if (code != SHEARBUS_OK) return code;
  plan mine, root;
  code = make_plan(request, &mine, status);
  root = mine;
  mpi(ranks, MPI_Bcast(&root, (int)sizeof root, MPI_BYTE, 0, ranks->comm));
  if (code == SHEARBUS_OK && memcmp(&root, &mine, sizeof root) != 0)
    code = refuse(status, SHEARBUS_SHAPE, "", "Give the same columns in the same order, dt and mode on all ranks.",
                  "the step is another one than that of rank 0 (its dt is %g s, and that of rank 0 is %g s)", mine.dt_s,
                  root.dt_s);
  if (code == SHEARBUS_OK && ranks->rows == NULL)
    code = refuse(status, SHEARBUS_INVALID_VALUE, "", "Call shearbus_step() on every rank.",
                  "every rank has a session of its own");
  if (code == SHEARBUS_OK && !mine.with_node_ids && request->n != (size_t)ranks->rows[ranks->rank])
    code = refuse(status, SHEARBUS_SHAPE, "n",
                  "Give one row per node of the opening, or name the node of each row in node_ids.",
                  "n is %zu, and this rank has %d nodes", request->n, ranks->rows[ranks->rank]);
  if (code == SHEARBUS_OK && request->n > INT_MAX)
    code =
        refuse(status, SHEARBUS_LIMIT, "n", "Step fewer rows.", "n is %zu, expected at most %d", request->n, INT_MAX);
  block* held = NULL;
  int* rows = zeros(&held, (size_t)ranks->size, sizeof *rows, &code, status);
  int* at = zeros(&held, (size_t)ranks->size, sizeof *at, &code, status);
  code = agree(ranks, code, status);
  if (code != SHEARBUS_OK) {
    release(held);
    return code;
  }

  const int n = (int)request->n;
  const size_t size = request->n;
  mpi(ranks, MPI_Allgather(&n, 1, MPI_INT, rows, 1, MPI_INT, ranks->comm));
  long long total = 0;
  for (int r = 0; r < ranks->size; ++r) total += rows[r];
  if (total > INT_MAX)
    code = refuse(status, SHEARBUS_LIMIT, "n", "Step fewer rows.", "all ranks have %lld rows, expected at most %d",
                  total, INT_MAX);
  else
    offsets(ranks->size, rows, at);
  const size_t on_root = ranks->rank == 0 && total <= INT_MAX ? (size_t)total : 0;
  columns own_rows = make_columns(&held, size, &mine, &code, status),
          all = make_columns(&held, on_root, &mine, &code, status);
  code = agree(ranks, code, status);
  if (code == SHEARBUS_OK) {
    if (mine.with_node_ids)
      mpi(ranks, MPI_Gatherv(request->node_ids, n, MPI_UINT64_T, all.ids, rows, at, MPI_UINT64_T, 0, ranks->comm));
    for (size_t c = 0; c < mine.n_inputs; ++c) {
      const char* from = (const char*)request->inputs[c].values;
      const ptrdiff_t stride = stride_of(request->inputs[c].stride_bytes, sizeof(double));
      for (size_t i = 0; i < size; ++i)
        memcpy(own_rows.in + c * size + i, from + (ptrdiff_t)i * stride, sizeof(double));
      mpi(ranks, MPI_Gatherv(own_rows.in + c * size, n, MPI_DOUBLE, all.in + c * on_root, rows, at, MPI_DOUBLE, 0,
                             ranks->comm));
    }
    int whose = -1;
    if (ranks->rank == 0) {
      code = step_all(session, request, on_root, &all, &answer, status);
      if (code != SHEARBUS_OK)
        whose = rank_at_fault(ranks, session, mine.with_node_ids ? all.ids : NULL, on_root, at, status);
    }
    code = agree_on(ranks, code, status, whose);
  }
  if (code == SHEARBUS_OK) {
    for (size_t c = 0; c < mine.n_outputs; ++c) {
      const size_t bytes = bytes_of(request->outputs[c].field);
      const ptrdiff_t stride = stride_of(request->outputs[c].stride_bytes, bytes);
      const MPI_Datatype type = bytes == 1 ? MPI_UINT8_T : MPI_DOUBLE;
      char *values = own_rows.out + c * size * sizeof(double), *to = (char*)request->outputs[c].values;
      mpi(ranks, MPI_Scatterv(all.out + c * on_root * sizeof(double), rows, at, type, values, n, type, 0, ranks->comm));
      for (size_t i = 0; i < size; ++i) memcpy(to + (ptrdiff_t)i * stride, values + i * bytes, bytes);
    }
    mpi(ranks, MPI_Bcast(&answer, (int)sizeof answer, MPI_BYTE, 0, ranks->comm));
    if (result != NULL && result->size == sizeof answer) *result = answer;
    code = agree(ranks, code, status);
  }
  release(held);
  return code;
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
  shearbus_mpi now;
  memset(&now, 0, sizeof now);
  now.comm = MPI_Comm_f2c((MPI_Fint)comm);
  mpi(&now, MPI_Comm_rank(now.comm, &now.rank));
  mpi(&now, MPI_Comm_size(now.comm, &now.size));
  const int code = agree(&now, fault, status);
  if (code != SHEARBUS_OK) return code;
  return on_root
             ? shearbus_mpi_open_on_root(ranks, now.comm, session, options, n, node_ids, initial_temperature_k, status)
             : shearbus_mpi_open(ranks, now.comm, session, options, n, node_ids, initial_temperature_k, status);
}
int shearbus_mpi_restart_f(shearbus_mpi** ranks, int comm, shearbus_session** session, const shearbus_options* options,
                           const char* path, size_t n, const uint64_t* node_ids, shearbus_status* status) {
  return shearbus_mpi_restart(ranks, MPI_Comm_f2c((MPI_Fint)comm), session, options, path, n, node_ids, status);
}
int shearbus_mpi_step_f(shearbus_mpi* ranks, shearbus_session* session, int fault, const shearbus_request* request,
                        shearbus_result* result, shearbus_status* status) {
  const int code = agree(ranks, fault, status);
  return code != SHEARBUS_OK ? code : shearbus_mpi_step_on_root(ranks, session, request, result, status);
}
void shearbus_mpi_share_f(shearbus_mpi* ranks, void* from_root, int bytes) {
  mpi(ranks, MPI_Bcast(from_root, bytes, MPI_BYTE, 0, ranks->comm));
}
