// Scenes and inputs that make no sense must be refused with a reason.
#include <gtest/gtest.h>

#include "tests/campaign/refusals.hpp"

namespace shearbus::study::stability {
namespace {

TEST(Refused, WhatMakesNoSenseIsRefusedAndNamed) {
  for (const Refusal& refusal : run_refusals()) {
    EXPECT_TRUE(refusal.seen()) << refusal.name << ": expected " << refusal.field << ", named \"" << refusal.named
                                << "\": " << refusal.text;
  }
}

}  // namespace
}  // namespace shearbus::study::stability
