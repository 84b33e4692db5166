#include "proto/wire/numbers.hpp"

#include <gtest/gtest.h>

#include <cstdint>
#include <string>

#include "proto/wire/units.hpp"

namespace shearbus::wire {
namespace {

TEST(Numbers, RealsAreFiniteDecimals) {
  EXPECT_EQ(real_of("1.5"), 1.5);
  EXPECT_EQ(real_of("+1e-3"), 1e-3);
  EXPECT_EQ(real_of("-0.25E2"), -25.0);
  for (const char* text : {"", "+", "-", "+-1", "nan", "inf", "-inf", "1e309", "-1e309", "0x10", "1 ", " 1", "1,5",
                           "1e", "1d3", "1e99999999999999999999"})
    EXPECT_FALSE(real_of(text)) << text;
  EXPECT_FALSE(real_of(std::string(kMostNumberDigits + 1, '1')));
  EXPECT_TRUE(real_of(std::string(kMostNumberDigits, '1')));
}

TEST(Numbers, WhatIsTooSmallForADoubleIsZero) {
  for (const char* text : {"1e-400", "-1e-400", "0.0001e-330", "123456e-400", "1e-99999999999999999999"})
    EXPECT_EQ(real_of(text), 0.0) << text;
  EXPECT_GT(real_of("1e-310").value(), 0.0);
  EXPECT_FALSE(real_of("123456e400"));
}

TEST(Numbers, CountsAreDigits) {
  EXPECT_EQ(count_of("18446744073709551615"), UINT64_MAX);
  EXPECT_EQ(count_of("010"), 10u);
  EXPECT_EQ(count_of("7", 7), 7u);
  for (const char* text : {"", "-1", "+1", " 1", "1 ", "1e3", "0x10", "1.0", "18446744073709551616"})
    EXPECT_FALSE(count_of(text)) << text;
  EXPECT_FALSE(count_of("8", 7));
}

TEST(Units, AllWaysToWriteOneAreRead) {
  for (const char* unit : {"kg/m2", "kg/m^2", "kg m-2", "kg.m-2", "kg m**-2", "kg*m^-2", "kg/m\u00b2", "m-2 kg"})
    EXPECT_EQ(factor_to_si(unit, "kg/m2"), 1.0) << unit;
  for (const char* unit : {"us", "\u00b5s", "\u03bcs", "microseconds"})
    EXPECT_EQ(factor_to_si(unit, "s"), 1e-6) << unit;
  EXPECT_EQ(factor_to_si("mm/us", "m/s"), 1e3);
  EXPECT_EQ(factor_to_si("s-1", "1/s"), 1.0);
  EXPECT_EQ(factor_to_si("MPa s m-1", "Pa s/m"), 1e6);
}

TEST(Units, OthersAreNot) {
  for (const char* unit : {"psi", "mpa", "s", "Pa/s", "", "Pa2"}) EXPECT_FALSE(factor_to_si(unit, "Pa")) << unit;
  EXPECT_FALSE(factor_to_si(std::string(1000, 'm'), "m"));
}

}  // namespace
}  // namespace shearbus::wire
