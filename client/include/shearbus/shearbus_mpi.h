/* MPI helpers of the C interface: sessions of all ranks of a run, nodes that move between ranks with their states,
 * restart on another number of ranks, and one session of rank 0 for all ranks.
 *
 *   shearbus_mpi* ranks = NULL;
 *   if (shearbus_mpi_open(&ranks, MPI_COMM_WORLD, &bus, &options, n, node_ids, NULL, &status)) ...
 *   if (shearbus_step(bus, &step, NULL, &status)) ...                     of this rank's nodes, as without MPI
 *   if (shearbus_mpi_redistribute(ranks, bus, new_owner, &status)) ...    bus has other nodes now
 *   if (shearbus_mpi_dump(ranks, bus, "dump_0042", "dump_0042.tickets", &status)) ...
 *   if (shearbus_mpi_close(&ranks, &bus, &status)) ...
 *
 * MPI has no common binary interface, so these functions are no part of libshearbus.so: the host compiles
 * client/mpi/shearbus_mpi.c (installed in share/shearbus) with its own MPI, as C99. The CMake target is
 * shearbus::mpi.
 *
 * Every function but shearbus_mpi_leave(), shearbus_mpi_domain() and shearbus_mpi_rank() is collective: all ranks of
 * the communicator call it, and all return the same code and status. That is the status of the lowest rank that was
 * refused, with "rank 3: " before its text; a rank whose own call succeeded has its part undone where this page says
 * so. No rank waits for another one that was refused. The answers of the server do not depend on the number of ranks,
 * to the bit. A fault of MPI itself goes to the error handler of the communicator; where that returns, the code is
 * SHEARBUS_LIBRARY_FAULT. All ranks must be of one executable and one byte order. */
#ifndef SHEARBUS_MPI_H
#define SHEARBUS_MPI_H

#include <mpi.h>

#include "shearbus/shearbus.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct shearbus_mpi shearbus_mpi; /* the ranks of a run; opaque */

/* Opens a session on every rank, all in one domain, in which nodes can move; a rank may have n = 0. options->domain,
 * if given, names the domain, else the job does: "slurm-ID-RESTARTS-STEP" from SLURM_JOB_ID, SLURM_RESTART_COUNT and
 * SLURM_STEP_ID, "pbs-ID-RANDOM" from PBS_JOBID, "mpi-RANDOM" otherwise, so that a job that was killed does not block
 * its successor. (`shearbus-ctl close --domain NAME` frees what it has left.) *ranks and *session are NULL before.
 * After a fault all sessions are closed and both are NULL again, except after SHEARBUS_UNKNOWN_OUTCOME and
 * SHEARBUS_NO_MEMORY: then the same call again opens the same sessions, or shearbus_mpi_leave() gives up. A server
 * inside a process serves no other rank: it is refused, and shearbus_mpi_open_on_root() has a use for it. */
int shearbus_mpi_open(shearbus_mpi** ranks, MPI_Comm comm, shearbus_session** session, const shearbus_options* options,
                      size_t n, const uint64_t* node_ids, const double* initial_temperature_k, shearbus_status* status);

/* Gives all ranks the code and status of the lowest rank that has a fault. For the host's own calls: where
 * one rank may be refused and the others would wait for it, as after a step. */
int shearbus_mpi_agree(shearbus_mpi* ranks, int code, shearbus_status* status);

/* Moves nodes with their states to their new owners. new_owner: the rank of each node of the session, in the order of
 * shearbus_node_ids(). Afterwards the session has the nodes that stay, in their order, and then those that came, in
 * the order of the ranks they came from; the columns of a step follow that order. No trial may stand. After a refusal
 * each node is still in one session, which shearbus_node_ids() tells, and the move can be repeated from there; after
 * a lost connection nodes may wait on the server, and shearbus_rollback_to() on all ranks brings them back.
 * A mark from before a move in both directions is reached by shearbus_mpi_restart() alone: until then each of two
 * sessions has nodes that the other's mark names. */
int shearbus_mpi_redistribute(shearbus_mpi* ranks, shearbus_session* session, const int* new_owner,
                              shearbus_status* status);

/* Marks the states of all sessions under the name of the host's own restart dump, and writes the manifest for
 * shearbus_mpi_restart() beside it: a text file with the tickets of all sessions. The file is written under another
 * name, brought to the disk and renamed, so that it is either complete or the earlier one, and only its owner may
 * read it: a ticket is a secret. The server keeps the newest two marks; an older manifest is of no use. */
int shearbus_mpi_dump(shearbus_mpi* ranks, shearbus_session* session, const char* mark, const char* manifest,
                      shearbus_status* status);

/* Goes on from a dump, on any number of ranks, after the processes that wrote it have ended (a session that is still
 * in use is taken from its process): resumes its sessions, rolls them back to the mark, and gives each rank the nodes
 * it asks for. All ranks together ask for each node of the dump once; nodes are retired and registered afterwards.
 * The order is that of shearbus_node_ids(). The domain and the scene are those of the dump. Rank 0 reads the
 * manifest, and writes it again if there are more ranks than sessions. Sessions that have no nodes any more are kept
 * until the second dump from now, so that a restart from this manifest can be repeated; so an idle limit must be
 * longer than that. After a fault *ranks and *session are NULL, the sessions stay on the server, and the call can be
 * repeated. */
int shearbus_mpi_restart(shearbus_mpi** ranks, MPI_Comm comm, shearbus_session** session,
                         const shearbus_options* options, const char* manifest, size_t n, const uint64_t* node_ids,
                         shearbus_status* status);

/* The other way: rank 0 alone has a session, with the nodes of all ranks in the order of the ranks, and *session
 * stays NULL on the others. One request of 10,000 nodes takes less time than 100 of 100 nodes, and endpoint
 * "embedded" serves all ranks; but all ranks wait for each other in every step. shearbus_mpi_step_on_root() is
 * shearbus_step() of each rank's own rows, with the same columns, dt and mode on all ranks; node_ids is given on all
 * ranks or on none. The rows of a request without node_ids are the nodes of the opening. result is that of all rows.
 * Rank 0 alone calls commit, rollback and the like, and tells the others by shearbus_mpi_agree(). */
int shearbus_mpi_open_on_root(shearbus_mpi** ranks, MPI_Comm comm, shearbus_session** session,
                              const shearbus_options* options, size_t n, const uint64_t* node_ids,
                              const double* initial_temperature_k, shearbus_status* status);
int shearbus_mpi_step_on_root(shearbus_mpi* ranks, shearbus_session* session, const shearbus_request* request,
                              shearbus_result* result, shearbus_status* status);

/* Ends all sessions on the server. *ranks and *session are NULL afterwards, whatever the code is. */
int shearbus_mpi_close(shearbus_mpi** ranks, shearbus_session** session, shearbus_status* status);

/* Not collective: frees what this rank has, and leaves the sessions on the server. For the way out after a fault. */
void shearbus_mpi_leave(shearbus_mpi** ranks, shearbus_session** session);

/* Not collective. The domain of the sessions, "" on root alone; and the number of this rank. */
const char* shearbus_mpi_domain(const shearbus_mpi* ranks);
int shearbus_mpi_rank(const shearbus_mpi* ranks);

#ifdef __cplusplus
}
#endif
#endif
