# shellcheck shell=bash disable=SC2154 # variables of the scripts
# Sourced by the job scripts in this directory. A job script says how its servers and its host are launched; run_job starts both, starts
# a server again that has died, and ends within 30 s after the host, however the host ended.
#
# A job script defines
#   launch_server I         becomes server number I (by exec); its endpoint file is $directory/endpoints/I
#   launch_host COMMAND...  becomes the host (by exec)
#   stop_host               asks the host, whose process is $host, to write its dump and to end
# and sets servers, the number of servers. The environment of a job may set
#   SHEARBUS_JOB_DIR        directory of the job, which all its nodes reach: endpoint files, keys, states, logs of the servers
#   SHEARBUS_SERVER_OPTIONS more options of the servers
#   SHEARBUS_BIND           where servers of several nodes listen, for instance tcp://ib0:0; default: all interfaces
#   SHEARBUS_ONE_HOST       several_nodes.sbatch: not empty: one host with a session over all servers
#   SHEARBUS_CONTINUE       not empty: a job that was stopped by SIGUSR1 is put in the queue again
set -uo pipefail
umask 077
directory=${SHEARBUS_JOB_DIR:-$SLURM_SUBMIT_DIR/shearbus-$SLURM_JOB_ID}
mkdir -p "$directory/endpoints"
rm -f "$directory"/endpoints/*  # of servers that were killed before the job was queued again
key=()
server_options=()

say() { echo "shearbus job $SLURM_JOB_ID: $*" >&2; }

# make_keys: a key for the servers and a key for the host, which is an operator's so that this script can end the servers.
make_keys() {
  cd "$directory" || exit 1
  [ -f server.public ] || shearbus-ctl keygen server >/dev/null || exit 1
  [ -f job.public ] || shearbus-ctl keygen --operator job >/dev/null || exit 1
  cd - >/dev/null || exit 1
  key=(--key "$directory/job.secret")
  server_options=(--curve-secret "$directory/server.secret" --authorized-keys "$directory/job.public")
  export SHEARBUS_SECRET_KEY_FILE=$directory/job.secret
}

# serve I BIND: becomes server number I. Its states are those of server I before the job was queued again, on whatever node.
serve() {
  # shellcheck disable=SC2086  # the user's options are words
  exec "${server_command[@]}" shearbus-server --bind "$2" --endpoint-file "$directory/endpoints/$1" --state-dir "$directory/states-$1" \
    "${server_options[@]}" ${SHEARBUS_SERVER_OPTIONS:-}
}
server_command=()

start_server() {
  launch_server "$1" >>"$directory/server-$1.log" 2>&1 &
  number_of[$!]=$1
}

ctl() { shearbus-ctl "$1" --server "file://$directory/endpoints/$2" "${key[@]}" "${@:3}"; }

# server_ended PID CODE: 0 and 3 are ends that were asked for. Another server takes up the states of one that has died.
server_ended() {
  local number=${number_of[$1]}
  unset "number_of[$1]"
  [ "$2" -eq 0 ] && return
  [ "$2" -eq 3 ] && say "sessions of server $number were open at its end; its states are kept in $directory/states-$number" && return
  if [ -n "$ending" ] || [ $((restarts += 1)) -gt 5 ]; then
    say "server $number has ended with code $2 after $restarts restarts; see $directory/server-$number.log"
    return 1
  fi
  say "server $number has ended with code $2; it is started again"
  sleep 1
  start_server "$number"
}

# wait_for_servers: until all answer. Fails at once if a server ends.
wait_for_servers() {
  local i waiter ended code
  for ((i = 0; i < servers; i++)); do
    ctl wait "$i" --timeout "${SHEARBUS_START_SECONDS:-120}" >/dev/null &
    waiter=$!
    wait -n -p ended "$waiter" "${!number_of[@]}"
    code=$?
    [ "$ended" = "$waiter" ] && [ $code -eq 0 ] && continue
    [ "$ended" = "$waiter" ] || unset "number_of[$ended]"
    say "server $i does not start; see $directory/server-$i.log"
    kill "$waiter" 2>/dev/null
    return 1
  done
}

# end_servers SECONDS: drains all servers; those with sessions end after so many seconds. What lives on after 15 s more is killed, which
# costs no committed step: the journal has them.
end_servers() {
  local i ended code killer asked=()
  for ((i = 0; i < servers; i++)); do
    ctl drain "$i" --exit --within "$1" --timeout 5 >/dev/null &
    asked+=($!)
  done
  wait "${asked[@]}"
  [ ${#number_of[@]} -eq 0 ] && return
  { sleep $(($1 + 15)) && kill -KILL "${!number_of[@]}"; } 2>/dev/null &
  killer=$!
  ending=1
  while [ ${#number_of[@]} -gt 0 ]; do
    ended=
    wait -n -p ended "${!number_of[@]}"
    code=$?
    [ -n "${ended:-}" ] || break
    server_ended "$ended" $code
  done
  kill "$killer" 2>/dev/null
}

run_job() {
  local ended code
  declare -gA number_of=()
  restarts=0 stopped='' ending=''
  [ $# -gt 0 ] || { say "expected the command of the host: sbatch SCRIPT COMMAND [ARGUMENT...]"; exit 2; }
  for ((i = 0; i < servers; i++)); do start_server "$i"; done
  if ! wait_for_servers; then
    end_servers 1
    exit 1
  fi
  launch_host "$@" &
  host=$!
  # Slurm sends SIGUSR1 before the time limit (--signal) and SIGTERM at the end of the job.
  trap 'stopped=1; say "the host is asked to write its dump and to end"; stop_host' USR1 TERM
  host_code=
  while [ -z "$host_code" ]; do
    ended=
    wait -n -p ended "$host" "${!number_of[@]}"
    code=$?
    if [ "${ended:-}" = "$host" ]; then
      host_code=$code
    elif [ -n "${ended:-}" ] && ! server_ended "$ended" $code; then
      stop_host
      sleep 5 && kill -KILL "$host" 2>/dev/null
      host_code=1
    fi
  done
  trap '' USR1 TERM
  say "the host has ended with code $host_code"
  if [ "$host_code" -eq 0 ]; then end_servers 10; else end_servers 1; fi
  if [ -n "$stopped" ] && [ -n "${SHEARBUS_CONTINUE:-}" ] && [ "$host_code" -ne 0 ]; then scontrol requeue "$SLURM_JOB_ID"; fi
  exit "$host_code"
}
