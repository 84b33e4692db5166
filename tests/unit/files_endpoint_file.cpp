#include "proto/files/endpoint_file.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/stat.h>

#include <fstream>

#include "proto/files/key_file.hpp"
#include "tests/support/refused.hpp"
#include "tests/support/scratch.hpp"

namespace shearbus::files {
namespace {

using ::testing::HasSubstr;

const EndpointFile kContents = {.version = "0.1.0",
                                .host = "n1",
                                .server_key = "#bcdefghijklmnopqrstuvwxyz0123456789.-:+",
                                .endpoint = "tcp://n1:40123",
                                .epoch = "5f0d2c1b9a887766"};

class EndpointFiles : public testing::Test {
 protected:
  EndpointFile read(const std::string& text) {
    std::ofstream(file_, std::ios::trunc) << text;
    return read_endpoint_file(file_);
  }
  std::string fault_of(const std::string& text) {
    return support::said_by<std::runtime_error>([&] { read(text); });
  }
  test::Scratch scratch_;
  std::filesystem::path file_ = scratch_ / "server";
};

TEST_F(EndpointFiles, AFileGivesWhatWasWritten) {
  const EndpointFile found = read(text_of(kContents) + "# of a later version\n\nlater = \"unknown\"\n");
  EXPECT_EQ(found.version, kContents.version);
  EXPECT_EQ(found.host, kContents.host);
  EXPECT_EQ(found.server_key, kContents.server_key);
  EXPECT_EQ(found.endpoint, kContents.endpoint);
  EXPECT_EQ(found.epoch, kContents.epoch);
}

TEST_F(EndpointFiles, NoBeginningOfAFileIsTakenForAWholeOne) {
  const std::string text = text_of(kContents);
  for (std::size_t size = 0; size < text.size(); ++size)
    EXPECT_NE(fault_of(text.substr(0, size)), "") << "the first " << size << " bytes of " << text.size();
  EXPECT_THAT(fault_of(text.substr(0, text.size() - 3)), HasSubstr("written only in part"));
  EXPECT_THAT(fault_of(text.substr(0, text.rfind("epoch"))), HasSubstr("has no epoch"));
}

TEST_F(EndpointFiles, WhatIsNoEndpointFileIsRefusedWithTheReason) {
  EXPECT_THAT(fault_of("endpoint: tcp://n1:1\n"), HasSubstr("line 1: expected key = \"value\""));
  EndpointFile wrong = kContents;
  wrong.endpoint = "http://n1";
  EXPECT_THAT(fault_of(text_of(wrong)), HasSubstr("endpoint = \"http://n1\", expected tcp://HOST:PORT"));
  wrong = kContents;
  wrong.server_key = "short";
  EXPECT_THAT(fault_of(text_of(wrong)), HasSubstr("server_key is not a key of 40"));
  EXPECT_THAT(fault_of(std::string(5000, '#')), HasSubstr("more than 4096 bytes"));
  const auto fault_of_path = [](const std::filesystem::path& path) {
    return support::said_by<std::runtime_error>([&] { read_endpoint_file(path); });
  };
  EXPECT_THAT(fault_of_path(scratch_ / "absent"), HasSubstr("No such file"));
  EXPECT_THAT(fault_of_path(scratch_.path()), HasSubstr("expected a regular file"));
  ASSERT_EQ(::mkfifo((scratch_ / "fifo").c_str(), 0600), 0);
  EXPECT_THAT(fault_of_path(scratch_ / "fifo"), HasSubstr("expected a regular file"));
}

TEST_F(EndpointFiles, AValueThatWouldNotBeReadBackIsNotWritten) {
  for (const char* endpoint : {"ipc:///a\"b", "ipc:///a\\b", "ipc:///a\nb"}) {
    EndpointFile wrong = kContents;
    wrong.endpoint = endpoint;
    EXPECT_THROW(text_of(wrong), std::runtime_error) << endpoint;
  }
}

TEST_F(EndpointFiles, ClientsGetAnAddressThatTheyCanConnectTo) {
  EXPECT_EQ(address_for_clients("tcp://0.0.0.0:40123", "n1"), "tcp://n1:40123");
  EXPECT_EQ(address_for_clients("tcp://[::]:40123", "n1"), "tcp://n1:40123");
  EXPECT_EQ(address_for_clients("tcp://10.0.0.1:40123", "n1"), "tcp://10.0.0.1:40123");
  EXPECT_EQ(address_for_clients("ipc:///run/bus", "n1"), "ipc:///run/bus");
  EXPECT_EQ(address_for_clients("ipc://bus/s", "n1"), "ipc://" + (std::filesystem::current_path() / "bus/s").string());
}

TEST_F(EndpointFiles, AClientOfAnEndpointFileNeedsNoServerKey) {
  write_secret_key(scratch_ / "own.secret", kContents.server_key);
  ServerAddress address;
  address.endpoint = "file:///tmp/server";
  read_keys_into(address, "", scratch_ / "own.secret");
  EXPECT_EQ(address.secret_key, kContents.server_key);
  address.endpoint = "tcp://n1:40123";
  EXPECT_THROW(read_keys_into(address, "", scratch_ / "own.secret"), std::runtime_error);
}

}  // namespace
}  // namespace shearbus::files
