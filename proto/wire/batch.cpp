#include "proto/wire/batch.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cstring>
#include <utility>

#include "proto/wire/limits.hpp"
#include "proto/wire/status.hpp"

namespace shearbus::wire {
namespace {

struct FieldInfo {
  Field field;
  Element element;
  const char* name;
};

// The one table of columns; names carry their units.
constexpr std::array kFields = {
    FieldInfo{Field::kNodeId, Element::kUint64, "node_id"},
    FieldInfo{Field::kInitialTemperature, Element::kFloat64, "initial_temperature_k"},
    FieldInfo{Field::kVelocityJump, Element::kFloat64, "velocity_jump_m_per_s"},
    FieldInfo{Field::kPressure, Element::kFloat64, "pressure_pa"},
    FieldInfo{Field::kStressMinus, Element::kFloat64, "stress_minus_pa"},
    FieldInfo{Field::kStressPlus, Element::kFloat64, "stress_plus_pa"},
    FieldInfo{Field::kMassMinus, Element::kFloat64, "mass_minus_kg_per_m2"},
    FieldInfo{Field::kMassPlus, Element::kFloat64, "mass_plus_kg_per_m2"},
    FieldInfo{Field::kSoftShearRate, Element::kFloat64, "soft_shear_rate_per_s"},
    FieldInfo{Field::kSoftPlasticStrainRate, Element::kFloat64, "soft_plastic_strain_rate_per_s"},
    FieldInfo{Field::kShearStress, Element::kFloat64, "shear_stress_pa"},
    FieldInfo{Field::kSlidingVelocity, Element::kFloat64, "sliding_velocity_m_per_s"},
    FieldInfo{Field::kInterfaceTemperature, Element::kFloat64, "interface_temperature_k"},
    FieldInfo{Field::kVelocityJumpNew, Element::kFloat64, "velocity_jump_new_m_per_s"},
    FieldInfo{Field::kRegime, Element::kUint8, "regime"},
    FieldInfo{Field::kOutcome, Element::kUint8, "outcome"},
    FieldInfo{Field::kFrictionHeat, Element::kFloat64, "friction_heat_j_per_m2"},
    FieldInfo{Field::kInterfaceWork, Element::kFloat64, "interface_work_j_per_m2"},
    FieldInfo{Field::kHeatToSoft, Element::kFloat64, "heat_to_soft_j_per_m2"},
    FieldInfo{Field::kHeatToHard, Element::kFloat64, "heat_to_hard_j_per_m2"},
    FieldInfo{Field::kPlasticWork, Element::kFloat64, "plastic_work_j_per_m2"},
    FieldInfo{Field::kStoredHeatSoft, Element::kFloat64, "stored_heat_soft_j_per_m2"},
    FieldInfo{Field::kStoredHeatHard, Element::kFloat64, "stored_heat_hard_j_per_m2"},
    FieldInfo{Field::kElasticEnergy, Element::kFloat64, "elastic_energy_j_per_m2"},
    FieldInfo{Field::kHeatResidual, Element::kFloat64, "heat_residual_j_per_m2"},
    FieldInfo{Field::kEnergyResidual, Element::kFloat64, "energy_residual_j_per_m2"},
    FieldInfo{Field::kErrorEstimate, Element::kFloat64, "error_estimate"},
};

const FieldInfo* info(Field field) {
  const auto found = std::find_if(kFields.begin(), kFields.end(), [&](const FieldInfo& f) { return f.field == field; });
  return found == kFields.end() ? nullptr : &*found;
}

std::size_t padded(std::size_t bytes) {
  return (bytes + 7) / 8 * 8;
}

[[noreturn]] void refuse(const Column& column, const std::string& what) {
  throw Error({.code = Code::kShape,
               .text = fmt::format("column {} (field {}, component {}) {}", name(column.field),
                                   static_cast<std::uint32_t>(column.field), column.component, what),
               .remedy = "See WIRE.md, payload frame.",
               .field = name(column.field)});
}

}  // namespace

std::size_t size_of(Element element) {
  switch (element) {
    case Element::kFloat64:
    case Element::kUint64:
      return 8;
    case Element::kUint8:
      return 1;
    case Element::kUnspecified:
      break;
  }
  return 0;
}

Element element_of(Field field) {
  const FieldInfo* found = info(field);
  return found ? found->element : Element::kUnspecified;
}

const char* name(Field field) {
  const FieldInfo* found = info(field);
  return found ? found->name : "?";
}

bool is_tangential(Field field) {
  switch (field) {
    case Field::kVelocityJump:
    case Field::kStressMinus:
    case Field::kStressPlus:
    case Field::kShearStress:
    case Field::kSlidingVelocity:
    case Field::kVelocityJumpNew:
      return true;
    default:
      return false;
  }
}

Batch Batch::of(std::span<const Field> fields, std::size_t count, std::uint32_t components) {
  Batch batch;
  for (Field field : fields) {
    const Element element = element_of(field);
    for (std::uint32_t component = 0; component < (is_tangential(field) ? components : 1); ++component) {
      batch.columns_.push_back({field, component, element, batch.size_, count});
      batch.size_ += padded(count * size_of(element));
    }
  }
  batch.owned_ = std::make_unique<std::uint64_t[]>(batch.size_ / 8);
  batch.data_ = reinterpret_cast<const std::byte*>(batch.owned_.get());
  return batch;
}

Batch Batch::over(std::vector<Column> columns, std::span<const std::byte> bytes) {
  if (columns.size() > kMaxColumns)
    throw Error(
        {.code = Code::kShape, .text = fmt::format("{} columns, at most {} allowed", columns.size(), kMaxColumns)});
  std::vector<std::pair<std::uint64_t, std::uint64_t>> extents;
  for (std::size_t i = 0; i < columns.size(); ++i) {
    const Column& column = columns[i];
    const FieldInfo* known = info(column.field);
    if (!known) refuse(column, "is not a field of this protocol");
    if (column.element != known->element) refuse(column, "has the wrong element type");
    if (column.component > 1) refuse(column, "has a component above 1");
    if (column.offset_bytes % 8 != 0)
      refuse(column, fmt::format("starts at byte {}, not a multiple of 8", column.offset_bytes));
    const std::size_t size = size_of(column.element);
    if (column.offset_bytes > bytes.size() || column.count > (bytes.size() - column.offset_bytes) / size)
      refuse(column, fmt::format("needs {} elements from byte {}, the frame has {} bytes", column.count,
                                 column.offset_bytes, bytes.size()));
    for (std::size_t j = 0; j < i; ++j)
      if (columns[j].field == column.field && columns[j].component == column.component)
        refuse(column, "is given twice");
    if (column.count > 0) extents.emplace_back(column.offset_bytes, column.offset_bytes + column.count * size);
  }
  std::sort(extents.begin(), extents.end());
  for (std::size_t i = 1; i < extents.size(); ++i)
    if (extents[i].first < extents[i - 1].second)
      throw Error({.code = Code::kShape, .text = fmt::format("two columns overlap at byte {}", extents[i].first)});

  Batch batch;
  batch.columns_ = std::move(columns);
  batch.size_ = bytes.size();
  batch.data_ = bytes.data();
  if (reinterpret_cast<std::uintptr_t>(bytes.data()) % 8 != 0) batch.own();
  return batch;
}

void Batch::own() {
  if (owned_) return;
  owned_ = std::make_unique<std::uint64_t[]>(padded(size_) / 8);
  if (size_ > 0) std::memcpy(owned_.get(), data_, size_);
  data_ = reinterpret_cast<const std::byte*>(owned_.get());
}

const Column* Batch::find(Field field, std::uint32_t component) const {
  for (const Column& column : columns_)
    if (column.field == field && column.component == component) return &column;
  return nullptr;
}

bool Batch::has(Field field, std::uint32_t component) const {
  return find(field, component) != nullptr;
}

namespace {

template <typename T, Element kElement>
std::span<const T> view(const Column* column, const std::byte* data) {
  if (!column || column->element != kElement) return {};
  return {reinterpret_cast<const T*>(data + column->offset_bytes), column->count};
}

template <typename T>
std::span<T> writable(std::span<const T> column) {
  return {const_cast<T*>(column.data()), column.size()};
}

}  // namespace

std::span<const double> Batch::f64(Field field, std::uint32_t component) const {
  return view<double, Element::kFloat64>(find(field, component), data_);
}
std::span<const std::uint64_t> Batch::u64(Field field, std::uint32_t component) const {
  return view<std::uint64_t, Element::kUint64>(find(field, component), data_);
}
std::span<const std::uint8_t> Batch::u8(Field field, std::uint32_t component) const {
  return view<std::uint8_t, Element::kUint8>(find(field, component), data_);
}
std::span<double> Batch::f64(Field field, std::uint32_t component) {
  own();
  return writable(std::as_const(*this).f64(field, component));
}
std::span<std::uint64_t> Batch::u64(Field field, std::uint32_t component) {
  own();
  return writable(std::as_const(*this).u64(field, component));
}
std::span<std::uint8_t> Batch::u8(Field field, std::uint32_t component) {
  own();
  return writable(std::as_const(*this).u8(field, component));
}

}  // namespace shearbus::wire
