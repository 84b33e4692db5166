// Text of the wire: validity and cutting of UTF-8.
#include "proto/wire/text.hpp"

#include <gtest/gtest.h>

#include <random>
#include <string>

#include "proto/wire/status.hpp"

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

TEST(DomainOfRun, IsOfTheNameAloneOrOfOneOfItsServers) {
  for (const char* domain : {"run", "run#0/2", "run#12/15"})
    EXPECT_TRUE(wire::is_domain_of_run(domain, "run")) << domain;
  for (const char* domain : {"", "ru", "runs", "run#", "run#1", "run#/2", "run#1/", "run#a/2", "run#1/2x", "a#0/2"})
    EXPECT_FALSE(wire::is_domain_of_run(domain, "run")) << domain;
}

TEST(Printable, EscapesCommandsAndInvalidBytesAndNothingElse) {
  constexpr std::size_t kMost = 200;
  EXPECT_EQ(printable("Stra\xC3\x9F"
                      "e \xE2\x82\xAC \\ \"",
                      kMost),
            "Stra\xC3\x9F"
            "e \xE2\x82\xAC \\ \"");
  EXPECT_EQ(printable("a\x1b[2J\nb\tc\rd\x7f", kMost), "a\\x1b[2J\\nb\\tc\\rd\\x7f");
  EXPECT_EQ(printable("\xC2\x9B"
                      "31m\xE2\x80\xAE\xE2\x80\xA8",
                      kMost),
            "\\x9b31m\\u{202e}\\u{2028}");
  EXPECT_EQ(printable("\xFF"
                      "a\xE2\x82",
                      kMost),
            "\\xffa\\xe2\\x82");
  EXPECT_EQ(printable(std::string(1, '\0'), kMost), "\\x00");
  EXPECT_EQ(printable_lines("a\n\x1b\r\nb"), "a\n\\x1b\\r\nb");
}

TEST(Printable, CutsBetweenWhatItShows) {
  EXPECT_EQ(printable("123456", 6), "123456");
  EXPECT_EQ(printable("123456", 5), "12...");
  EXPECT_EQ(printable("12\x1b"
                      "456",
                      8),
            "12...");
  EXPECT_EQ(printable("12\x1b"
                      "456",
                      9),
            "12\\x1b456");
  EXPECT_EQ(printable("12345", 2), "..");
  EXPECT_EQ(printable("\n\n\n", 0), "");
}

TEST(Printable, AnyBytesBecomeOneLineOfAtMostTheLengthAsked) {
  std::mt19937_64 random(2);
  for (int n = 0; n < 20000; ++n) {
    std::string bytes(random() % 12, '\0');
    for (char& byte : bytes) byte = static_cast<char>(random() % 256);
    const std::size_t most = random() % 40;
    const std::string text = printable(bytes, most);
    ASSERT_TRUE(is_utf8(text)) << n;
    ASSERT_FALSE(has_control_character(text)) << n;
    ASSERT_LE(text.size(), most) << n;
  }
}

TEST(Printable, AFaultIsPrintableWhateverItQuotes) {
  const Error fault({.code = Code::kInvalidScene, .text = "a\x1b[2J\nb", .remedy = "c\x07", .field = "d\x1b"});
  EXPECT_EQ(fault.status().text, "a\\x1b[2J\nb");
  EXPECT_EQ(fault.status().remedy, "c\\x07");
  EXPECT_EQ(fault.status().field, "d\\x1b");
  EXPECT_EQ(std::string(fault.what()).find('\x1b'), std::string::npos);
}

TEST(Printable, AFaultIsOneLineButForTheFaultsOfAScene) {
  const auto text_of = [](Code code) {
    return Error({.code = code, .text = "a\nb", .remedy = "c\nd", .field = "e\nf"});
  };
  for (const Code code : {Code::kInvalidValue, Code::kUnknownMark, Code::kInternal, Code::kUnreachable}) {
    EXPECT_EQ(text_of(code).status().text, "a\\nb");
    EXPECT_EQ(std::string(text_of(code).what()).find('\n'), std::string::npos);
  }
  const Error scene = text_of(Code::kInvalidScene);
  EXPECT_EQ(scene.status().text, "a\nb");
  EXPECT_EQ(scene.status().remedy, "c\\nd");
  EXPECT_EQ(scene.status().field, "e\\nf");
}

}  // namespace
}  // namespace shearbus::wire
