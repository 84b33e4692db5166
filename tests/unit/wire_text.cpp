// Text of the wire: validity and cutting of UTF-8.
#include "proto/wire/text.hpp"

#include <gtest/gtest.h>

#include <random>
#include <string>

namespace shearbus::wire {
namespace {

TEST(Utf8, AcceptsCharactersAndNothingElse) {
  for (const char* valid :
       {"", "a", "\xC2\xB5s", "\xE2\x82\xAC", "\xF0\x9F\x94\xA5", "\xEF\xBF\xBF", "\xF4\x8F\xBF\xBF"})
    EXPECT_TRUE(is_utf8(valid)) << valid;
  for (const char* invalid : {"\x80", "\xC2", "\xC0\x80", "\xE0\x9F\xBF", "\xED\xA0\x80", "\xF0\x8F\xBF\xBF",
                              "\xF4\x90\x80\x80", "\xF8\x88\x80\x80\x80", "a\xFF"})
    EXPECT_FALSE(is_utf8(invalid));
  EXPECT_TRUE(is_utf8(std::string(1, '\0')));
}

TEST(Utf8, ReplacesEveryInvalidByte) {
  EXPECT_EQ(as_utf8("a\xFF\xC2z", 10), "a??z");
  EXPECT_EQ(as_utf8("\xE2\x82", 10), "??");
  EXPECT_EQ(as_utf8("\xED\xA0\x80", 10), "???");  // the UTF-8 bytes of a surrogate are no character
}

TEST(Utf8, CutsBetweenCharacters) {
  EXPECT_EQ(as_utf8("12345", 5), "12345");
  EXPECT_EQ(as_utf8("123456", 5), "12...");
  EXPECT_EQ(as_utf8("\xE2\x82\xAC\xE2\x82\xAC", 6), "\xE2\x82\xAC\xE2\x82\xAC");
  EXPECT_EQ(as_utf8("\xE2\x82\xAC\xE2\x82\xAC.", 6), "\xE2\x82\xAC...");
  EXPECT_EQ(as_utf8("\xE2\x82\xAC\xE2\x82\xAC", 5), "...");
  EXPECT_EQ(as_utf8("123456", 2), "..");
  EXPECT_EQ(as_utf8("123456", 0), "");
}

TEST(Utf8, AnyBytesBecomeValidTextOfAtMostTheLengthAsked) {
  std::mt19937_64 random(1);
  for (int n = 0; n < 20000; ++n) {
    std::string bytes(random() % 12, '\0');
    for (char& byte : bytes) byte = static_cast<char>(random() % 2 == 0 ? random() % 256 : 0xE0 + random() % 32);
    const std::size_t most = random() % 14;
    const std::string text = as_utf8(bytes, most);
    ASSERT_TRUE(is_utf8(text)) << n;
    ASSERT_LE(text.size(), most) << n;
    if (is_utf8(bytes) && bytes.size() <= most) {
      ASSERT_EQ(text, bytes) << n;
    }
  }
}

}  // namespace
}  // namespace shearbus::wire
