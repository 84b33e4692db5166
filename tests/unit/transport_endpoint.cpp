#include "server/transport/endpoint.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <stdexcept>

#include "tests/support/refused.hpp"

namespace shearbus::transport {
namespace {

TEST(Endpoint, OtherTransportsOfTheLibraryAreRefused) {
  for (const char* text : {"pgm://eth0;239.0.0.1:5555", "ws://127.0.0.1:80", "tipc://{5560,0,0}", "udp://127.0.0.1:1",
                           "norm://1:1", "vmci://*:1", "127.0.0.1:5555", "", "tcp://", "ipc://", "ipc://*",
                           "ipc://@name", "ipc://~/bus", "tcp://127.0.0.1", "tcp://:5555", "tcp://127.0.0.1:65536",
                           "tcp://127.0.0.1:port", "tcp://127.0.0.1:", "TCP://127.0.0.1:1"})
    EXPECT_THROW(Endpoint::parse(text), std::invalid_argument) << text;
}

TEST(Endpoint, PartsAreFound) {
  const Endpoint tcp = Endpoint::parse("tcp://[::1]:5555");
  EXPECT_EQ(tcp.host, "::1");
  EXPECT_EQ(tcp.port, "5555");
  EXPECT_EQ(Endpoint::parse("ipc:///run/bus").path, "/run/bus");
}

TEST(Endpoint, NamesTheLongestPathOfASocket) {
  EXPECT_EQ(Endpoint::parse("ipc:///" + std::string(106, 'd')).path.size(), 107U);
  EXPECT_THAT(support::said_by<std::invalid_argument>([] { Endpoint::parse("ipc:///" + std::string(107, 'd')); }),
              testing::AllOf(testing::HasSubstr("has a path of 108 bytes"), testing::HasSubstr("at most 107")));
}

}  // namespace
}  // namespace shearbus::transport
