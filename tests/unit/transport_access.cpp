// Tests the access control of the transport: only messages of admitted users may pass, also if the function that admits
// users throws, blocks or ends its thread.
#include "server/transport/access.hpp"

#include <gtest/gtest.h>
#include <pthread.h>
#include <sys/eventfd.h>
#include <sys/stat.h>
#include <unistd.h>

#include <atomic>
#include <chrono>
#include <condition_variable>
#include <filesystem>
#include <mutex>
#include <thread>

#include "server/transport/router.hpp"
#include "tests/support/raw_peer.hpp"
#include "tests/support/refused.hpp"
#include "tests/support/scratch.hpp"

namespace shearbus::transport {
namespace {

using namespace std::chrono_literals;
using support::RawDealer;
using test::Scratch;

// A router that answers every message with the name of the user who sent it.
class Echo {
 public:
  explicit Echo(Authorise authorise) : router_({.authorise = std::move(authorise), .insecure_plaintext = true}) {
    endpoint_ = router_.bind(scratch_.ipc());
    plain_endpoint_ = router_.bind("tcp://127.0.0.1:*");
    thread_ = std::thread([this] {
      router_.run(
          [this](Frames, std::string_view user) {
            ++messages;
            auto text = std::make_shared<std::string>(user);
            return Answer(OutFrame{std::as_bytes(std::span(*text)), text});
          },
          stop_);
    });
  }
  Echo(const Echo&) = delete;
  Echo& operator=(const Echo&) = delete;
  ~Echo() {
    const std::uint64_t one = 1;
    if (::write(stop_, &one, sizeof one) != sizeof one) std::abort();
    thread_.join();
    ::close(stop_);
  }

  const std::string& ipc() const { return endpoint_; }
  const std::string& tcp() const { return plain_endpoint_; }
  const AccessHandler& access() const { return *router_.access(); }
  std::atomic<int> messages{0};

 private:
  Scratch scratch_;
  int stop_ = ::eventfd(0, EFD_CLOEXEC);
  Router router_;
  std::string endpoint_;
  std::string plain_endpoint_;
  std::thread thread_;
};

std::string asked(RawDealer& dealer, std::chrono::milliseconds time = 2s) {
  dealer.send(std::vector<std::string>{"who am I"});
  const auto frames = dealer.receive(time);
  return frames.empty() ? "" : frames[0].to_string();
}

Admission named(const Peer& peer) {
  return {.admitted = true, .user = peer.way == Peer::Way::kIpc ? "uid " + std::to_string(peer.uid) : "stranger"};
}

TEST(AccessHandler, TellsEachMessagesUserAsTheKernelKnowsHim) {
  Echo echo(named);
  RawDealer local(echo.ipc());
  RawDealer remote(echo.tcp());
  for (int i = 0; i < 3; ++i) {
    EXPECT_EQ(asked(local), "uid " + std::to_string(::geteuid()));
    EXPECT_EQ(asked(remote), "stranger");
  }
  EXPECT_EQ(echo.access().admitted(), 2u);
}

TEST(AccessHandler, RefusesWhomTheJudgeRefusesAndWhomItCannotJudge) {
  // Three functions that decide on a peer: the first refuses it, the second throws, the third admits it without naming
  // a user.
  const std::vector<Authorise> judges = {[](const Peer&) -> Admission { return {.reason = "no"}; },
                                         [](const Peer&) -> Admission { throw std::runtime_error("the list is lost"); },
                                         [](const Peer&) -> Admission { return {.admitted = true}; }};
  for (const Authorise& judge : judges) {
    Echo echo(judge);
    RawDealer local(echo.ipc());
    RawDealer remote(echo.tcp());
    EXPECT_EQ(asked(local, 200ms), "");
    EXPECT_EQ(asked(remote, 200ms), "");
    EXPECT_EQ(echo.messages, 0);
    EXPECT_GE(echo.access().refused(), 2u);
    EXPECT_TRUE(echo.access().alive());
  }
}

TEST(AccessHandler, StrangersCannotFillTheLog) {
  zmq::context_t context;
  std::atomic<int> lines{0};
  {
    AccessHandler handler(
        context, [](const Peer&) -> Admission { return {.reason = "no"}; }, [&](const std::string&) { ++lines; });
    zmq::socket_t asker(context, zmq::socket_type::req);
    asker.connect("inproc://zeromq.zap.01");
    for (int i = 0; i < 500; ++i) {
      for (const char* frame : {"1.0", "1", "plaintext", "10.0.0.1", ""})
        asker.send(zmq::message_t(std::string(frame)), zmq::send_flags::sndmore);
      asker.send(zmq::message_t(std::string("NULL")), zmq::send_flags::none);
      std::vector<std::string> reply;
      for (zmq::message_t frame; static_cast<void>(asker.recv(frame)), true;) {
        reply.push_back(frame.to_string());
        if (!frame.more()) break;
      }
      ASSERT_EQ(reply.at(2), "400");
    }
    EXPECT_EQ(handler.refused(), 500u);
  }
  EXPECT_GE(lines, 20);
  EXPECT_LT(lines, 100);
}

// The thread of the access handler is really ended and its stack unwound, as a fault would end it.
TEST(AccessHandler, WhenItsThreadDiesNobodyNewIsLetInAndTheOthersStay) {
  std::atomic<bool> dying{false};
  Echo echo([&](const Peer& peer) {
    if (dying) ::pthread_exit(nullptr);
    return named(peer);
  });
  RawDealer early(echo.ipc());
  ASSERT_NE(asked(early), "");
  dying = true;
  RawDealer killer(echo.ipc());
  EXPECT_EQ(asked(killer, 300ms), "");
  EXPECT_FALSE(echo.access().alive());
  RawDealer late(echo.ipc());
  RawDealer late_remote(echo.tcp());
  EXPECT_EQ(asked(late, 300ms), "");
  EXPECT_EQ(asked(late_remote, 300ms), "");
  EXPECT_EQ(echo.messages, 1);
  EXPECT_NE(asked(early), "");
}

TEST(AccessHandler, WhileItDoesNotAnswerNobodyNewIsLetIn) {
  std::mutex mutex;
  std::condition_variable released;
  bool asleep = false;
  Echo echo([&](const Peer& peer) {
    std::unique_lock lock(mutex);
    released.wait(lock, [&] { return !asleep; });
    return named(peer);
  });
  RawDealer early(echo.ipc());
  ASSERT_NE(asked(early), "");
  {
    const std::lock_guard lock(mutex);
    asleep = true;
  }
  RawDealer late(echo.ipc());
  EXPECT_EQ(asked(late, 300ms), "");
  EXPECT_NE(asked(early), "");
  EXPECT_EQ(echo.messages, 2);
  {
    const std::lock_guard lock(mutex);
    asleep = false;
  }
  released.notify_all();
  EXPECT_FALSE(late.receive(2s).empty()) << "judged late, but judged";
}

// Why a socket is not made at the path; empty if it is.
std::string fault_of_path(const std::filesystem::path& path, bool private_to_owner) {
  return support::said_by<std::runtime_error>([&] { const SocketPath made(path.string(), private_to_owner); });
}

TEST(SocketPath, TheDirectoryIsMadeForItsOwnerAlone) {
  const Scratch scratch;
  { const SocketPath path((scratch / "bus" / "s").string(), true); }
  EXPECT_EQ(std::filesystem::status(scratch / "bus").permissions(), std::filesystem::perms::owner_all);
}

TEST(SocketPath, ADirectoryThatOthersEnterIsRefusedWithItsModeAndARemedy) {
  const Scratch scratch;
  const struct {
    mode_t mode;
    bool private_to_owner;
    const char* fault;  // part of the expected error message; null: no error
  } cases[] = {{0700, true, nullptr},  {0710, true, "0710"},  {0755, true, "chmod 700"},  {0711, false, nullptr},
               {0750, false, nullptr}, {0770, false, "0770"}, {0777, false, "chmod go-w"}};
  for (const auto& c : cases) {
    ASSERT_EQ(::chmod(scratch.path().c_str(), c.mode), 0);
    const std::string fault = fault_of_path(scratch / "s", c.private_to_owner);
    if (c.fault == nullptr)
      EXPECT_EQ(fault, "") << c.mode;
    else
      EXPECT_NE(fault.find(c.fault), std::string::npos) << c.mode << ": " << fault;
  }
  ASSERT_EQ(::chmod(scratch.path().c_str(), 0700), 0);
}

TEST(SocketPath, NobodyIsToldToCloseADirectoryThatEverybodyUses) {
  const Scratch scratch;
  for (const bool private_to_owner : {true, false}) {
    ASSERT_EQ(::chmod(scratch.path().c_str(), 01777), 0);
    const std::string fault = fault_of_path(scratch / "s", private_to_owner);
    EXPECT_NE(fault.find("1777"), std::string::npos) << fault;
    EXPECT_EQ(fault.find("chmod"), std::string::npos) << fault;
    EXPECT_NE(fault.find("Choose"), std::string::npos) << fault;
  }
  ASSERT_EQ(::chmod(scratch.path().c_str(), 0700), 0);
}

TEST(SocketPath, ADirectoryOfAnotherUserIsRefused) {
  if (::geteuid() != 0) GTEST_SKIP() << "only root can make one";
  const Scratch scratch;
  ASSERT_EQ(::chown(scratch.path().c_str(), 65534, 65534), 0);
  const std::string fault = fault_of_path(scratch / "s", true);
  EXPECT_NE(fault.find("belongs to uid 65534"), std::string::npos) << fault;
}

}  // namespace
}  // namespace shearbus::transport
