// Tests of the server program on a failing disk: strace makes system calls of the server fail. The tests are skipped if
// strace is not allowed to trace.
#include <gtest/gtest.h>

#include <chrono>
#include <filesystem>
#include <iostream>
#include <string>
#include <thread>
#include <vector>

#include "shearbus_places.hpp"
#include "tests/support/scenes.hpp"
#include "tests/support/server_process.hpp"

namespace shearbus {
namespace {

using namespace std::chrono_literals;
using support::Process;
using support::ScratchDirectory;
using wire::Strategy;

const std::vector<std::uint64_t> kNodes = support::node_ids(12);

bool can_trace() {
  const ScratchDirectory scratch;
  if (!std::filesystem::exists("/usr/bin/strace")) return false;
  Process probe({"/usr/bin/strace", "-o", "/dev/null", "/bin/true"}, (scratch.path() / "log").string());
  return probe.exit_code(10s) == 0;
}

// A server on a state directory; strace injects `fault` into its system calls unless `fault` is empty.
class Server : public support::ServerProcess {
 public:
  Server(const ScratchDirectory& scratch, const std::string& durability, const std::string& fault = {})
      : ServerProcess({"--bind", scratch.ipc(), "--threads", "1", "--durability", durability, "--state-dir",
                       (scratch.path() / "state").string()},
                      launcher(fault)),
        endpoint_(scratch.ipc()) {}
  ClientOptions client(std::chrono::milliseconds deadline) const {
    return {.endpoint = endpoint_, .connect_deadline = 5s, .reply_deadline = deadline, .retry_after = 100ms};
  }

 private:
  static std::vector<std::string> launcher(const std::string& fault) {
    if (fault.empty()) return {};
    return {"/usr/bin/strace", "-D", "-f", "-o", "/dev/null", "-e", "trace=writev,fdatasync,fsync,renameat", "-e",
            "inject=" + fault};
  }

  std::string endpoint_;
};

struct Host {
  std::optional<Client> client;
  std::optional<Session> session;
  int answered = 0;
};

// Makes steps of the host until `steps` steps are answered or a step fails. Then stops the server.
void run(Server& server, Host& host, int steps) {
  try {
    if (!host.session) {
      host.client.emplace(server.client(700ms));
      host.session.emplace(host.client->open(support::text_of(support::velocity_scene()), "scene", kNodes));
    }
    while (host.answered < steps) {
      host.session->advance(support::step_columns(Strategy::kVelocityDriven, kNodes, host.answered), {.dt_s = 1e-9});
      ++host.answered;
    }
  } catch (const Error&) {
    // A failed step ends the loop; host.answered counts the steps that were answered.
  }
  server.process().signal(SIGTERM);
  if (server.process().exit_code(10s)) return;
  server.process().signal(SIGKILL);
  server.process().exit_code(10s);
}

// Starts another server on the same disk. It must know every answered request. It may also know one request more: the
// one that was running and was not answered.
void expect_nothing_lost(const ScratchDirectory& scratch, Host& host, const std::string& when) {
  Server next(scratch, "power");
  ASSERT_TRUE(next.ready()) << when << ": " << next.log();
  if (!host.session) return;
  Client client(next.client(5s));
  const Session::Ticket ticket = host.session->ticket();
  host.session->leave();
  Session session = client.resume(ticket);
  const auto answered = static_cast<std::uint64_t>(host.answered);
  EXPECT_GE(session.last_sequence, answered) << when;
  EXPECT_LE(session.last_sequence, answered + 1) << when;
  session.close();
}

TEST(DiskFaults, EveryFailingOrFatalSystemCallLosesNothingThatWasAnswered) {
  if (!can_trace()) GTEST_SKIP() << "strace is not installed or may not trace";
  int faults = 0;
  // SIGTERM makes the server write a checkpoint; the calls counted by n include those of this checkpoint.
  for (const std::string call : {"writev", "fdatasync", "fsync", "renameat"})
    for (const std::string kind : {"signal=SIGKILL", "error=EIO", "error=ENOSPC"})
      for (int n = 1; n <= (call == "writev" ? 7 : call == "fdatasync" ? 6 : 2); ++n) {
        const ScratchDirectory scratch;
        const std::string when = call + " " + std::to_string(n) + " " + kind;
        Host host;
        Server server(scratch, "power", call + ":" + kind + ":when=" + std::to_string(n));
        if (server.ready()) run(server, host, 3);
        expect_nothing_lost(scratch, host, when);
        ++faults;
        if (HasFatalFailure()) return;
      }
  std::cout << "system calls that failed or killed: " << faults << ", answers lost: " << (HasFailure() ? "SOME" : "0")
            << "\n";
}

TEST(DiskFaults, AFailedSyncOfTheJournalEndsTheServerWithoutAnAnswer) {
  if (!can_trace()) GTEST_SKIP() << "strace is not installed or may not trace";
  const ScratchDirectory scratch;
  Host host;
  // Of the calls of fdatasync, number 1 syncs the first file `store`, 2 the new journal segment, 3 the file `store`
  // that names this segment, 4 the record of the opening, 5 that of the first step, 6 that of the second step.
  Server server(scratch, "power", "fdatasync:error=EIO:when=6");
  ASSERT_TRUE(server.ready()) << server.log();
  host.client.emplace(server.client(500ms));
  host.session.emplace(host.client->open(support::text_of(support::velocity_scene()), "scene", kNodes));
  const auto step = [&](int number) {
    host.session->advance(support::step_columns(Strategy::kVelocityDriven, kNodes, number), {.dt_s = 1e-9});
  };
  step(0);
  EXPECT_THROW(step(1), Error);
  EXPECT_EQ(server.process().exit_code(10s), 1) << server.log();
  EXPECT_NE(server.log().find(" error FAILED: "), std::string::npos) << server.log();
  host.session->leave();
}

}  // namespace
}  // namespace shearbus
