#include "proto/files/key_file.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>

#include "client/src/client.hpp"
#include "tests/support/refused.hpp"
#include "tests/support/scratch.hpp"

namespace shearbus::files {
namespace {

using ::testing::HasSubstr;
namespace fs = std::filesystem;

// A valid key that begins with "#". A line of a key file is a comment only if it begins with "# " or is "#" alone.
const std::string kKey = "#bcdefghijklmnopqrstuvwxyz0123456789.-:+";

class KeyFiles : public testing::Test {
 protected:
  fs::path write(const std::string& text, fs::perms mode = fs::perms::owner_read | fs::perms::owner_write) {
    fs::path file = scratch_ / ("keys" + std::to_string(count_++));
    std::ofstream(file) << text;
    fs::permissions(file, mode);
    return file;
  }
  static std::string fault_of(const auto& call) { return support::said_by<std::runtime_error>(call); }
  test::Scratch scratch_;
  int count_ = 0;
};

TEST_F(KeyFiles, EachLineIsAKeyAndWords) {
  const auto lines = read_keys(write("# clients\n\n" + kKey + "  operator rank 0 \r\n#\n" + kKey + "\n"));
  ASSERT_EQ(lines.size(), 2u);
  EXPECT_EQ(lines[0].key, kKey);
  EXPECT_EQ(lines[0].words, "operator rank 0");
  EXPECT_EQ(lines[1].words, "");
}

TEST_F(KeyFiles, WhatIsNoKeyIsRefusedByLineAndNeverShownWhereItIsSecret) {
  for (const std::string& bad : {kKey.substr(1), kKey + "x", kKey.substr(1) + "\"", std::string("word = 5")}) {
    const auto file = write("# clients\n" + bad + "\n");
    EXPECT_THAT(fault_of([&] { read_keys(file); }), HasSubstr("line 2: expected a key of 40 characters")) << bad;
    const std::string fault = fault_of([&] { read_secret_key(file); });
    EXPECT_THAT(fault, HasSubstr("line 2"));
    EXPECT_EQ(fault.find(bad.substr(0, bad.find(' '))), std::string::npos) << fault;
  }
  EXPECT_THAT(fault_of([&] { read_public_key(write(kKey + "\n" + kKey + "\n")); }), HasSubstr("2 keys, expected one"));
  EXPECT_THAT(fault_of([&] { read_secret_key(write("")); }), HasSubstr("0 keys, expected one"));
  EXPECT_THAT(fault_of([&] { read_keys(scratch_ / "absent"); }), HasSubstr("No such file"));
  EXPECT_THAT(fault_of([&] { read_keys(write(std::string((std::size_t{4} << 20) + 1, '\n'))); }),
              HasSubstr("no file of keys"));
}

TEST_F(KeyFiles, ASecretThatOthersCanReadIsRefused) {
  using fs::perms;
  for (const perms more : {perms::group_read, perms::others_read, perms::group_write}) {
    const auto file = write(kKey, perms::owner_read | more);
    EXPECT_THAT(fault_of([&] { read_secret_key(file); }), HasSubstr("expected 0600"));
    EXPECT_EQ(read_public_key(file), kKey);
  }
  EXPECT_EQ(read_secret_key(write(kKey, perms::owner_read)), kKey);
}

TEST_F(KeyFiles, AreWrittenOnceAndTheSecretOneIsItsOwnersAlone) {
  const KeyPair pair = make_key_pair();
  EXPECT_TRUE(is_key(pair.public_key));
  EXPECT_NE(pair.public_key, make_key_pair().public_key);
  write_secret_key(scratch_ / "a.secret", pair.secret_key);
  write_public_key(scratch_ / "a.public", {.key = pair.public_key, .words = "operator a"});
  EXPECT_EQ(fs::status(scratch_ / "a.secret").permissions(), fs::perms::owner_read | fs::perms::owner_write);
  EXPECT_EQ(read_secret_key(scratch_ / "a.secret"), pair.secret_key);
  EXPECT_EQ(read_public_key(scratch_ / "a.public"), pair.public_key);
  EXPECT_THAT(fault_of([&] { write_secret_key(scratch_ / "a.secret", kKey); }), HasSubstr("never written over"));
  EXPECT_THAT(fault_of([&] { write_public_key(scratch_ / "a.public", {kKey, ""}); }), HasSubstr("never written over"));
  EXPECT_EQ(read_secret_key(scratch_ / "a.secret"), pair.secret_key);
  // Each file in place of the other one.
  EXPECT_THAT(fault_of([&] { read_secret_key(scratch_ / "a.public"); }), HasSubstr("public key, expected the secret"));
  EXPECT_THAT(fault_of([&] { read_public_key(scratch_ / "a.secret"); }), HasSubstr("secret key, expected public"));
  EXPECT_THAT(fault_of([&] { read_keys(scratch_ / "a.secret"); }), HasSubstr("secret key, expected public"));
  ServerAddress address{.endpoint = "tcp://127.0.0.1:1"};
  EXPECT_THAT(fault_of([&] { read_keys_into(address, scratch_ / "a.public", ""); }), HasSubstr("go together"));
  read_keys_into(address, scratch_ / "a.public", scratch_ / "a.secret");
  EXPECT_EQ(address.server_key, pair.public_key);
  EXPECT_EQ(address.secret_key, pair.secret_key);
}

}  // namespace
}  // namespace shearbus::files
