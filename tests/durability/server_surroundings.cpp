// The server program in hostile surroundings: a cut network, a full disk, a clock that jumps, memory that runs out.
// A test that needs more rights than this machine grants is skipped with the reason.
#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <filesystem>
#include <fstream>
#include <iostream>
#include <memory>
#include <set>
#include <string>
#include <thread>
#include <vector>

#include "tests/support/raw_peer.hpp"
#include "tests/support/refused.hpp"
#include "tests/support/scenes.hpp"
#include "tests/support/server_process.hpp"
#include "tests/support/twin_session.hpp"

namespace shearbus {
namespace {

using namespace std::chrono_literals;
using support::Process;
using support::ScratchDirectory;
using support::ServerProcess;
using wire::Strategy;
using Command = std::vector<std::string>;

const std::vector<std::uint64_t> kNodes = support::node_ids(12);

// Returns an empty text if the command succeeds, otherwise the reason of its failure.
std::string failure_of(const Command& command) {
  const ScratchDirectory scratch;
  const std::string log = (scratch.path() / "log").string();
  if (!std::filesystem::exists(command[0])) return command[0] + " is not installed";
  if (Process(command, log).exit_code(10s) == 0) return {};
  std::string said = command[0] + " failed: " + support::text_of(log);
  while (said.ends_with('\n')) said.pop_back();
  return said;
}

class Host : public support::TwinSession {
 public:
  explicit Host(ClientOptions options) : TwinSession(std::move(options), Strategy::kVelocityDriven, kNodes) {}
};

// A server in a network namespace of its own, connected by a virtual cable that can be pulled.
class Cable {
 public:
  Cable() {
    const std::string number = std::to_string(::getpid() % 100000);
    space_ = "shearbus" + number;
    here_ = "shb" + number;
    fault_ = failure_of({kIp, "netns", "add", space_});
    for (const Command& command :
         {Command{kIp, "link", "add", here_, "type", "veth", "peer", "name", "there", "netns", space_},
          Command{kIp, "addr", "add", kAddressHere, "dev", here_}, Command{kIp, "link", "set", here_, "up"},
          Command{kIp, "-n", space_, "addr", "add", kAddressThere + std::string("/30"), "dev", "there"},
          Command{kIp, "-n", space_, "link", "set", "there", "up"},
          Command{kIp, "-n", space_, "link", "set", "lo", "up"}})
      if (fault_.empty()) fault_ = failure_of(command);
  }
  ~Cable() {
    failure_of({kIp, "link", "del", here_});
    failure_of({kIp, "netns", "del", space_});
  }
  const std::string& fault() const { return fault_; }
  Command launcher() const { return {kIp, "netns", "exec", space_}; }
  void pull() const { failure_of({kIp, "link", "set", here_, "down"}); }
  void plug() const { failure_of({kIp, "link", "set", here_, "up"}); }

  // An address from the block that RFC 2544 reserves for tests of networks.
  static constexpr const char* kAddressThere = "198.18.77.2";

 private:
  static constexpr const char* kIp = "/usr/sbin/ip";
  static constexpr const char* kAddressHere = "198.18.77.1/30";
  std::string space_, here_, fault_;
};

TEST(Surroundings, ANetworkThatIsCutAndComesBackLosesNothingAndRunsNothingTwice) {
  const Cable cable;
  if (!cable.fault().empty()) GTEST_SKIP() << "no network of its own: " << cable.fault();
  const std::string endpoint = std::string("tcp://") + Cable::kAddressThere + ":5599";
  ServerProcess server({"--bind", endpoint, "--insecure-plaintext", "--threads", "1"}, cable.launcher());
  ASSERT_TRUE(server.ready()) << server.log();
  Host host({.endpoint = endpoint, .reply_deadline = 60s, .retry_after = 300ms});
  host.steps(20);

  // The network is interrupted many times, each time briefly, while the host continues to make steps.
  std::atomic<bool> over = false;
  int cuts = 0;
  std::thread hand([&] {
    while (!over) {
      cable.pull();
      std::this_thread::sleep_for(std::chrono::milliseconds(50 + 130 * (cuts % 4)));
      cable.plug();
      ++cuts;
      std::this_thread::sleep_for(150ms);
    }
  });
  const auto flapping = std::chrono::steady_clock::now();
  while (std::chrono::steady_clock::now() - flapping < 6s && !testing::Test::HasFailure()) host.step();
  over = true;
  hand.join();
  const int flapped = host.steps_done();

  // The network is interrupted for so long that the heartbeat ends the connection.
  cable.pull();
  std::thread later([&] {
    std::this_thread::sleep_for(8s);
    cable.plug();
  });
  const auto cut = std::chrono::steady_clock::now();
  host.step();
  EXPECT_GE(std::chrono::steady_clock::now() - cut, 7s);
  later.join();
  host.steps(20);
  host.expect_each_step_once();
  EXPECT_GT(cuts, 5);
  std::cout << cuts + 1 << " cuts, " << host.steps_done() << " steps (" << flapped
            << " while it flapped), lost: 0, run twice: 0\n";
}

// A disk of 512 kB, mounted in a mount namespace of its own. A helper process, `holder_`, keeps the namespace alive;
// servers are started inside the namespace. The test writes files to the disk through /proc/PID/root of the helper
// process.
class SmallDisk {
 public:
  explicit SmallDisk(const ScratchDirectory& scratch) : path_(scratch.path() / "disk") {
    std::filesystem::create_directory(path_);
    const std::string log = (scratch.path() / "mount.log").string();
    const std::string script =
        "mount -t tmpfs -o size=512k,mode=0700 tmpfs " + path_.string() + " && echo mounted && exec sleep 600";
    holder_ = std::make_unique<Process>(Command{"/usr/bin/unshare", "-m", "/bin/sh", "-c", script}, log);
    for (const auto end = std::chrono::steady_clock::now() + 10s; std::chrono::steady_clock::now() < end;) {
      if (support::text_of(log) == "mounted\n") return;
      if (holder_->exit_code(5ms)) break;
    }
    fault_ = "no disk of its own: " + support::text_of(log);
  }
  const std::string& fault() const { return fault_; }
  Command launcher() const { return {"/usr/bin/nsenter", "-t", std::to_string(holder_->id()), "-m"}; }
  std::string state_directory() const { return (path_ / "state").string(); }
  void fill() const {
    std::ofstream file(filler(), std::ios::binary);
    const std::string block(4096, 'x');
    while (file.write(block.data(), static_cast<std::streamsize>(block.size())).flush()) {
    }
  }
  void make_room() const { std::filesystem::remove(filler()); }

 private:
  std::string filler() const { return "/proc/" + std::to_string(holder_->id()) + "/root" + path_.string() + "/filler"; }
  std::filesystem::path path_;
  std::unique_ptr<Process> holder_;
  std::string fault_;
};

class FullDisk : public testing::TestWithParam<std::string> {};

TEST_P(FullDisk, NothingIsAcknowledgedUntilThereIsRoomAndTheSameStepGoesOn) {
  const ScratchDirectory scratch;
  const SmallDisk disk(scratch);
  if (!disk.fault().empty()) GTEST_SKIP() << disk.fault();
  const Command arguments = {"--bind",      scratch.ipc(),          "--threads",    "1",
                             "--state-dir", disk.state_directory(), "--durability", GetParam()};
  auto server = std::make_unique<ServerProcess>(arguments, disk.launcher());
  ASSERT_TRUE(server->ready()) << server->log();
  Host host({.endpoint = scratch.ipc(), .reply_deadline = 30s, .retry_after = 500ms});
  int refused = 0;
  for (int round = 0; round < 4; ++round) {
    host.steps(5);
    disk.fill();
    // Some steps still succeed, because the last page of the journal has free space for their records.
    for (int again = 0; again < 3; ++again) {
      ASSERT_EQ(support::code_of([&] { host.steps(100); }), Code::kNoSpace) << "a full disk took 100 steps";
      ++refused;
      EXPECT_EQ(host.client().server_status().sessions, 1u) << "what needs no disk is answered";
    }
    if (round == 2) {  // stops the server while the disk is full: without a checkpoint the journal must suffice
      server->process().signal(SIGTERM);
      EXPECT_EQ(server->process().exit_code(20s), 0) << server->log();
      EXPECT_NE(server->log().find("the checkpoint could not be written"), std::string::npos) << server->log();
      disk.make_room();
      server = std::make_unique<ServerProcess>(arguments, disk.launcher());
      ASSERT_TRUE(server->ready()) << server->log();
    } else {
      disk.make_room();
    }
  }
  host.steps(5);
  server->process().signal(SIGTERM);
  EXPECT_EQ(server->process().exit_code(20s), 0) << server->log();
  std::cout << "durability " << GetParam() << ": " << host.steps_done() << " steps, " << refused
            << " refused for want of room\n";
}

INSTANTIATE_TEST_SUITE_P(Durability, FullDisk, testing::Values("process", "power"),
                         [](const auto& test) { return test.param; });

TEST(Surroundings, AClockThatJumpsByAnHourMovesNothingButTheStampsOfTheLog) {
  constexpr const char* kLibrary = "/usr/$LIB/faketime/libfaketimeMT.so.1";
  const ScratchDirectory scratch;
  const std::string clock = (scratch.path() / "clock").string();
  const auto jump = [&](const std::string& offset) { std::ofstream(clock) << offset << "\n"; };
  const Command launcher = {"/usr/bin/env", std::string("LD_PRELOAD=") + kLibrary, "FAKETIME_TIMESTAMP_FILE=" + clock,
                            "FAKETIME_NO_CACHE=1", "FAKETIME_DONT_FAKE_MONOTONIC=1"};
  if (!std::filesystem::exists("/usr/bin/faketime")) GTEST_SKIP() << "faketime is not installed";
  jump("+0");
  const Command arguments = {
      "--bind",       scratch.ipc(), "--threads", "1", "--state-dir", (scratch.path() / "state").string(),
      "--durability", "process"};
  auto server = std::make_unique<ServerProcess>(arguments, launcher);
  const auto says = [&](const char* words) { return server->log().find(words) != std::string::npos; };
  if (!server->ready() && (says("cannot be preloaded") || says("ASan runtime does not come first")))
    GTEST_SKIP() << "libfaketime cannot be loaded: " << server->log();
  ASSERT_TRUE(server->ready()) << server->log();
  Host host({.endpoint = scratch.ipc(), .reply_deadline = 30s, .retry_after = 500ms});
  const auto started = std::chrono::steady_clock::now();
  for (const char* offset : {"+3600", "-3600", "+7200", "+0"}) {
    jump(offset);
    host.steps(20);
    host.client()
        .open(support::text_of(support::velocity_scene()), "scene", kNodes)
        .close();  // open and close make the server log a line with a time stamp
  }
  host.expect_each_step_once();
  EXPECT_LT(std::chrono::steady_clock::now() - started, 20s) << "no deadline was waited for";

  std::set<std::string> hours;  // date and hour of the lines of the log, such as "2026-11-21T14"
  std::istringstream lines(server->log());
  for (std::string line; std::getline(lines, line);)
    if (line.size() > 13 && line[10] == 'T') hours.insert(line.substr(0, 13));
  EXPECT_GE(hours.size(), 4u) << "the clock did jump: " << server->log();

  // The clock of the next server is one hour behind the times at which its files were written.
  server->process().signal(SIGKILL);
  ASSERT_EQ(server->process().exit_code(10s), 128 + SIGKILL);
  jump("-3600");
  server = std::make_unique<ServerProcess>(arguments, launcher);
  ASSERT_TRUE(server->ready()) << server->log();
  host.steps(5);
}

#if !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__)
std::size_t resident_kb(pid_t process) {
  std::ifstream status("/proc/" + std::to_string(process) + "/status");
  for (std::string line; std::getline(status, line);)
    if (line.starts_with("VmRSS:")) return std::stoul(line.substr(6));
  return 0;
}

// libzmq keeps the parts of a message in memory until the last part has arrived, without a limit. A peer that may
// connect can therefore use up the memory of the server. The server then dies, but no answered request may be lost.
TEST(Surroundings, AMessageWithoutAnEndCostsTheServerItsLifeAtMost) {
  constexpr std::size_t kLimit = std::size_t{512} << 20;
  const ScratchDirectory scratch;
  const Command arguments = {"--bind",
                             scratch.ipc(),
                             "--threads",
                             "1",
                             "--state-memory-mb",
                             "64",
                             "--state-dir",
                             (scratch.path() / "state").string()};
  auto server = std::make_unique<ServerProcess>(
      arguments, Command{"/usr/bin/prlimit", "--as=" + std::to_string(kLimit), "--core=0"});
  ASSERT_TRUE(server->ready()) << server->log();
  Host host({.endpoint = scratch.ipc(), .reply_deadline = 60s, .retry_after = 500ms});
  host.steps(10);
  const std::size_t before = resident_kb(server->process().id());

  // The test writes the bytes of the ZMTP protocol itself, because libzmq sends no part of a message before it has the
  // last part.
  std::size_t sent = 0, most = before;
  {
    support::RawStream peer(scratch.ipc());
    const std::string greeting =
        "\xff" + std::string(8, '\0') + "\x7f\x03" + std::string(1, '\0') + "NULL" + std::string(48, '\0');
    const std::string ready = std::string(
        "\x04\x1c\x05READY\x0bSocket-Type\0\0\0\x06"
        "DEALER",
        30);
    const std::string part =
        // flags of a ZMTP frame: more parts follow, size in 8 bytes
        std::string("\x03\0\0\0\0\0\x01\0\0", 9) + std::string(64 * 1024, 'x');
    ASSERT_TRUE(peer.send(greeting) && peer.send(ready));
    ASSERT_FALSE(peer.closed_within(500ms)) << "its side of the handshake, which must be over before the first part";
    while (sent < 2 * kLimit && peer.send(part)) {
      sent += part.size();
      if (sent / part.size() % 64 == 0) most = std::max(most, resident_kb(server->process().id()));
    }
    server->process().exit_code(2s);
  }
  const auto died = server->process().exit_code(0ms);
  std::cout << "parts of " << (sent >> 20) << " MB sent; server from " << before / 1024 << " to " << most / 1024
            << " MB, limit " << (kLimit >> 20) << " MB; "
            << (died ? "it died with " + std::to_string(*died) : "it lives") << "\n";
  EXPECT_GT(most, before + 100'000) << "the parts did arrive";
  if (died) {
    server = std::make_unique<ServerProcess>(arguments);
    ASSERT_TRUE(server->ready()) << server->log();
  }
  host.steps(10);
}
#endif

TEST(Surroundings, ARestartWithOtherOptionsGivesTheSameAnswers) {
  const ScratchDirectory scratch;
  const std::string state = (scratch.path() / "state").string();
  std::unique_ptr<ServerProcess> server;
  std::unique_ptr<Host> host;
  for (const Command& options : {Command{"--threads", "1"}, Command{"--threads", "3", "--nodes-per-task", "2"},
                                 Command{"--durability", "power", "--checkpoint-every", "1"},
                                 Command{"--durability", "process", "--threads", "2", "--checkpoint-after", "1"}}) {
    if (server) {
      server->process().signal(SIGKILL);
      server->process().exit_code(10s);
    }
    Command arguments = {"--bind", scratch.ipc(), "--state-dir", state};
    arguments.insert(arguments.end(), options.begin(), options.end());
    server = std::make_unique<ServerProcess>(arguments);
    ASSERT_TRUE(server->ready()) << server->log();
    if (!host)
      host =
          std::make_unique<Host>(ClientOptions{.endpoint = scratch.ipc(), .reply_deadline = 30s, .retry_after = 500ms});
    host->steps(10);
  }
  host.reset();
}

std::set<std::string> checkpoints_in(const std::filesystem::path& state_dir) {
  std::set<std::string> names;
  for (const auto& file : std::filesystem::directory_iterator(state_dir))
    if (const std::string name = file.path().filename(); name.starts_with("checkpoint-")) names.insert(name);
  return names;
}

// When a host stops sending requests, the server must write a checkpoint that contains its steps, so that they are not
// in the journal only.
TEST(Surroundings, AServerWithoutRequestsCheckpointsInTimeAndOnlyOnce) {
  const ScratchDirectory scratch;
  const std::filesystem::path state = scratch.path() / "state";
  ServerProcess server({"--bind", scratch.ipc(), "--state-dir", state.string(), "--checkpoint-every", "1"});
  ASSERT_TRUE(server.ready()) << server.log();
  Host host({.endpoint = scratch.ipc()});
  host.steps(3);
  const auto until = std::chrono::steady_clock::now() + 20s;
  while (checkpoints_in(state).empty() && std::chrono::steady_clock::now() < until) std::this_thread::sleep_for(50ms);
  EXPECT_FALSE(checkpoints_in(state).empty()) << server.log();
  std::this_thread::sleep_for(2500ms);  // a second checkpoint, due if the first preceded the last step
  const std::set<std::string> idle = checkpoints_in(state);
  std::this_thread::sleep_for(2500ms);
  EXPECT_EQ(checkpoints_in(state), idle) << "nothing has changed since";
}

}  // namespace
}  // namespace shearbus
