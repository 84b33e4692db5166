// A batch: columns of numbers, one value per node and field (structure of arrays). It is what a payload frame holds.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

namespace shearbus::wire {

// Same numbers as shearbus.v1.Field, which gives the meaning of each.
enum class Field : std::uint32_t {
  kUnspecified = 0,
  kNodeId = 1,
  kInitialTemperature = 2,
  kVelocityJump = 10,
  kPressure = 11,
  kStressMinus = 12,
  kStressPlus = 13,
  kMassMinus = 14,
  kMassPlus = 15,
  kSoftShearRate = 16,
  kSoftPlasticStrainRate = 17,
  kShearStress = 30,
  kSlidingVelocity = 31,
  kInterfaceTemperature = 32,
  kVelocityJumpNew = 33,
  kRegime = 34,
  kOutcome = 35,
  kFrictionHeat = 36,
  kInterfaceWork = 40,
  kHeatToSoft = 41,
  kHeatToHard = 42,
  kPlasticWork = 43,
  kStoredHeatSoft = 44,
  kStoredHeatHard = 45,
  kElasticEnergy = 46,
  kHeatResidual = 47,
  kEnergyResidual = 48,
  kErrorEstimate = 60,
};

enum class Element : std::uint32_t { kUnspecified = 0, kFloat64 = 1, kUint64 = 2, kUint8 = 3 };

std::size_t size_of(Element element);
Element element_of(Field field);  // every field has one element type
bool is_tangential(Field field);  // a vector along the interface: has a second component where the scene's slip has one
const char* name(Field field);    // with unit: "pressure_pa"; "?" for a number that is no field

struct Column {
  Field field = Field::kUnspecified;
  std::uint32_t component = 0;
  Element element = Element::kUnspecified;
  std::uint64_t offset_bytes = 0;  // a multiple of 8
  std::uint64_t count = 0;
};

// Columns over one 8-byte aligned block. Cheap to move, not copyable.
class Batch {
 public:
  Batch() = default;

  // A block of its own, zeroed, with one column of `count` values for each field, and with `components` = 2 a second
  // one for each that is tangential. Write through the spans below.
  static Batch of(std::span<const Field> fields, std::size_t count, std::uint32_t components = 1);

  // Columns over received bytes, which must outlive the batch if they are aligned; misaligned bytes (ZeroMQ hands out
  // such frames below 8 kB) are copied. Throws Error{kShape} where a column leaves the frame, overlaps another, is
  // misaligned, repeats a field, has the wrong element type, or where there are more than kMaxColumns.
  static Batch over(std::vector<Column> columns, std::span<const std::byte> bytes);

  const std::vector<Column>& columns() const { return columns_; }
  std::span<const std::byte> bytes() const { return {data_, size_}; }

  bool has(Field field, std::uint32_t component = 0) const;
  // Empty span where the column is absent.
  std::span<const double> f64(Field field, std::uint32_t component = 0) const;
  std::span<const std::uint64_t> u64(Field field, std::uint32_t component = 0) const;
  std::span<const std::uint8_t> u8(Field field, std::uint32_t component = 0) const;
  // To write through. A batch over received bytes copies them first: they stay as they came.
  std::span<double> f64(Field field, std::uint32_t component = 0);
  std::span<std::uint64_t> u64(Field field, std::uint32_t component = 0);
  std::span<std::uint8_t> u8(Field field, std::uint32_t component = 0);

 private:
  const Column* find(Field field, std::uint32_t component) const;
  void own();

  std::vector<Column> columns_;
  std::unique_ptr<std::uint64_t[]> owned_;  // null while over() needed no copy
  const std::byte* data_ = nullptr;
  std::size_t size_ = 0;
};

}  // namespace shearbus::wire
