#include "proto/wire/batch.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "proto/wire/limits.hpp"
#include "proto/wire/status.hpp"
#include "tests/support/refused.hpp"

namespace shearbus::wire {
namespace {

using ::testing::Each;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::SizeIs;

constexpr Column kJump{Field::kVelocityJump, 0, Element::kFloat64, 0, 2};
constexpr Column kPressure{Field::kPressure, 0, Element::kFloat64, 16, 2};
constexpr Column kRegime{Field::kRegime, 0, Element::kUint8, 32, 3};

std::string refusal(std::vector<Column> columns, std::size_t bytes) {
  std::vector<std::uint64_t> memory(bytes / 8 + 1);
  const Status fault =
      support::fault_of([&] { Batch::over(std::move(columns), std::as_bytes(std::span(memory)).first(bytes)); });
  EXPECT_TRUE(fault.ok() || fault.code == Code::kShape);
  return fault.ok() ? "" : describe(fault);
}

Column with(Column column, auto change) {
  change(column);
  return column;
}

TEST(Batch, VectorsHaveASecondColumnWhereAskedFor) {
  const Field fields[] = {Field::kVelocityJump, Field::kPressure, Field::kShearStress};
  const Batch line = Batch::of(fields, 3);
  EXPECT_EQ(line.columns().size(), 3U);
  EXPECT_FALSE(line.has(Field::kVelocityJump, 1));
  Batch plane = Batch::of(fields, 3, 2);
  EXPECT_EQ(plane.columns().size(), 5U);
  EXPECT_FALSE(plane.has(Field::kPressure, 1));
  plane.f64(Field::kVelocityJump, 1)[2] = 7.0;
  EXPECT_EQ(plane.f64(Field::kVelocityJump)[2], 0.0);
  EXPECT_EQ(plane.f64(Field::kVelocityJump, 1)[2], 7.0);
}

TEST(Batch, ColumnsOfItsOwnStartAtZeroAndApart) {
  const Field fields[] = {Field::kRegime, Field::kVelocityJump, Field::kOutcome, Field::kNodeId};
  Batch batch = Batch::of(fields, 5);
  EXPECT_EQ(batch.bytes().size(), 8U + 40U + 8U + 40U);
  EXPECT_THAT(batch.f64(Field::kVelocityJump), SizeIs(5));
  EXPECT_THAT(batch.f64(Field::kVelocityJump), Each(0.0));
  std::ranges::fill(batch.u8(Field::kRegime), std::uint8_t{4});
  std::ranges::fill(batch.f64(Field::kVelocityJump), -1.0);
  EXPECT_THAT(batch.u8(Field::kOutcome), Each(0));
  EXPECT_THAT(batch.u64(Field::kNodeId), Each(0U));
  EXPECT_THAT(batch.u8(Field::kRegime), ElementsAre(4, 4, 4, 4, 4));
}

TEST(Batch, AnswersOnlyToTheRightTypeAndComponent) {
  const Field fields[] = {Field::kVelocityJump};
  const Batch batch = Batch::of(fields, 2);
  EXPECT_TRUE(batch.has(Field::kVelocityJump));
  EXPECT_FALSE(batch.has(Field::kVelocityJump, 1));
  EXPECT_TRUE(batch.u64(Field::kVelocityJump).empty());
  EXPECT_TRUE(batch.u8(Field::kVelocityJump).empty());
  EXPECT_TRUE(batch.f64(Field::kPressure).empty());
}

TEST(Batch, OfNoNodesIsEmptyNotAbsent) {
  const Field fields[] = {Field::kVelocityJump, Field::kRegime};
  const Batch batch = Batch::of(fields, 0);
  EXPECT_TRUE(batch.has(Field::kRegime));
  EXPECT_TRUE(batch.bytes().empty());
  const Batch over = Batch::over(batch.columns(), {});
  EXPECT_TRUE(over.f64(Field::kVelocityJump).empty());
}

TEST(Batch, WritingToReceivedColumnsLeavesTheFrameAsItCame) {
  const std::vector<double> memory = {1.0, 2.0};
  Batch batch = Batch::over({kJump}, std::as_bytes(std::span(memory)));
  // f64() gives a view of the memory and no copy
  EXPECT_EQ(std::as_const(batch).f64(Field::kVelocityJump).data(), memory.data());
  batch.f64(Field::kVelocityJump)[1] = 7.0;
  EXPECT_THAT(std::as_const(batch).f64(Field::kVelocityJump), ElementsAre(1.0, 7.0));
  EXPECT_THAT(memory, ElementsAre(1.0, 2.0));
}

TEST(Batch, AViewHasTheSameColumnsOverTheSameBytes) {
  const Field fields[] = {Field::kVelocityJump, Field::kRegime};
  const Batch batch = Batch::of(fields, 3);
  const Batch view = batch.view();
  EXPECT_EQ(view.bytes().data(), batch.bytes().data());
  EXPECT_EQ(view.bytes().size(), batch.bytes().size());
  EXPECT_EQ(view.u8(Field::kRegime).data(), batch.u8(Field::kRegime).data());
}

TEST(Batch, AnotherShapeUsesTheMemoryAndLeavesNoOldByteBetweenTheColumns) {
  const Field fields[] = {Field::kVelocityJump, Field::kRegime, Field::kOutcome};
  Batch batch = Batch::of(fields, 16);
  const std::byte* memory = batch.bytes().data();
  std::ranges::fill(batch.f64(Field::kVelocityJump), -1.0);
  std::ranges::fill(batch.u8(Field::kRegime), 0xff);
  std::ranges::fill(batch.u8(Field::kOutcome), 0xff);
  batch.reshape(fields, 13);
  EXPECT_EQ(batch.bytes().data(), memory);
  const Batch fresh = Batch::of(fields, 13);
  ASSERT_EQ(batch.bytes().size(), fresh.bytes().size());
  std::ranges::fill(batch.f64(Field::kVelocityJump), 0.0);
  std::ranges::fill(batch.u8(Field::kRegime), 0);
  std::ranges::fill(batch.u8(Field::kOutcome), 0);
  EXPECT_TRUE(std::ranges::equal(batch.bytes(), fresh.bytes())) << "the columns were written, the rest must be zero";
  batch.reshape(fields, 4);
  EXPECT_NE(batch.bytes().data(), memory) << "a small reply keeps no large memory";
  batch.reshape(fields, 40);
  EXPECT_EQ(batch.f64(Field::kVelocityJump).size(), 40U);
}

TEST(Batch, SoundColumnsAreTaken) {
  EXPECT_EQ(refusal({kJump, kPressure, kRegime}, 35), "");
  // columns may come in any order, with spare bytes after the last
  EXPECT_EQ(refusal({kRegime, kPressure, kJump}, 40), "");
  EXPECT_EQ(refusal({kJump, with(kPressure, [](Column& c) { c.field = Field::kVelocityJump, c.component = 1; })}, 32),
            "");
  EXPECT_EQ(refusal({}, 0), "");
}

TEST(Batch, DamagedColumnsAreNamed) {
  EXPECT_THAT(refusal({kJump, kPressure}, 31),
              HasSubstr("pressure_pa (field 11, component 0) needs 2 elements from byte 16"));
  EXPECT_THAT(refusal({kJump, kJump}, 32), HasSubstr("is given twice"));
  EXPECT_THAT(refusal({with(kJump, [](Column& c) { c.offset_bytes = 4; })}, 32), HasSubstr("not a multiple of 8"));
  EXPECT_THAT(refusal({with(kJump, [](Column& c) { c.element = Element::kUint64; })}, 32),
              HasSubstr("wrong element type"));
  EXPECT_THAT(refusal({with(kJump, [](Column& c) { c.element = Element::kUnspecified; })}, 32),
              HasSubstr("wrong element type"));
  EXPECT_THAT(refusal({with(kJump, [](Column& c) { c.field = static_cast<Field>(99); })}, 32),
              HasSubstr("is not a field"));
  EXPECT_THAT(refusal({with(kJump, [](Column& c) { c.component = 2; })}, 32), HasSubstr("component above 1"));
  EXPECT_THAT(refusal({kJump, with(kPressure, [](Column& c) { c.offset_bytes = 8; })}, 32),
              HasSubstr("overlap at byte 8"));
  EXPECT_THAT(refusal(std::vector<Column>(kMaxColumns + 1, kJump), 32), HasSubstr("33 columns, at most 32"));
}

// Sums of counts and offsets that overflow 64 bits must not pass as small numbers.
TEST(Batch, EnormousCountsAndOffsetsAreOutside) {
  for (std::uint64_t huge : {~0ULL, ~0ULL / 8, ~0ULL / 8 + 1, 1ULL << 61, 1ULL << 63, 3ULL}) {
    EXPECT_THAT(refusal({with(kJump, [&](Column& c) { c.count = huge; })}, 16), HasSubstr("needs")) << huge;
    EXPECT_NE(refusal({with(kJump, [&](Column& c) { c.offset_bytes = huge & ~7ULL, c.count = huge; })}, 16), "")
        << huge;
  }
  EXPECT_THAT(refusal({with(kJump, [](Column& c) { c.offset_bytes = ~0ULL & ~7ULL; })}, 16), HasSubstr("needs"));
}

}  // namespace
}  // namespace shearbus::wire
