// Which numbers a message may carry, and their names. That the enums are those of the schema is print_contract.py's.
#include <gtest/gtest.h>

#include "proto/wire/enum_names.hpp"
#include "proto/wire/status.hpp"

namespace shearbus::wire {
namespace {

TEST(Names, OfCodesOfTheClientsSideAreNotSent) {
  EXPECT_TRUE(may_be_sent(Code{}, static_cast<std::uint64_t>(Code::kRecovering)));
  EXPECT_FALSE(may_be_sent(Code{}, static_cast<std::uint64_t>(Code::kUnreachable)));
  EXPECT_STREQ(name(Code::kUnreachable), "UNREACHABLE");
  EXPECT_STREQ(name(Code::kOtherProcess), "OTHER_PROCESS");
  EXPECT_STREQ(name(static_cast<Code>(7)), "?");
  EXPECT_EQ(names_of(Mode{}).choices(), "ADVANCE or TRIAL");
}

}  // namespace
}  // namespace shearbus::wire
