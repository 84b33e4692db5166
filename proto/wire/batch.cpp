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

bool has_components(Field field) {
  return is_tangential(field) || field == Field::kParameter;
}

}  // namespace

// Writes columns_ and size_.
void Batch::lay_out(std::span<const Field> fields, std::size_t count, std::uint32_t components) {
  columns_.clear();
  columns_.reserve(fields.size() * components);
  size_ = 0;
  for (Field field : fields) {
    const Element element = element_of(field);
    for (std::uint32_t component = 0; component < (has_components(field) ? components : 1); ++component) {
      columns_.push_back({field, component, element, size_, count});
      size_ += padded(count * size_of(element));
    }
  }
}

Batch Batch::of(std::span<const Field> fields, std::size_t count, std::uint32_t components) {
  Batch batch;
  batch.lay_out(fields, count, components);
  batch.capacity_ = batch.size_ / 8;
  batch.owned_ = std::make_shared<std::uint64_t[]>(batch.capacity_);
  batch.data_ = reinterpret_cast<const std::byte*>(batch.owned_.get());
  return batch;
}

void Batch::reshape(std::span<const Field> fields, std::size_t count, std::uint32_t components) {
  lay_out(fields, count, components);
  const std::size_t words = size_ / 8;
  if (!owned_ || capacity_ < words || capacity_ - words > words / 4) {
    owned_.reset();
    owned_ = std::make_shared_for_overwrite<std::uint64_t[]>(words);
    capacity_ = words;
  }
  data_ = reinterpret_cast<const std::byte*>(owned_.get());
  // Only the columns of bytes have padding.
  for (const Column& column : columns_)
    if (const std::size_t end = column.offset_bytes + column.count * size_of(column.element); end % 8 != 0)
      std::memset(reinterpret_cast<std::byte*>(owned_.get()) + end, 0, padded(end) - end);
}

Batch Batch::view() const {
  Batch same;
  same.columns_ = columns_;
  same.viewed_ = keeper();
  same.data_ = data_;
  same.size_ = size_;
  return same;
}

Batch Batch::over(std::vector<Column> columns, std::span<const std::byte> bytes) {
  if (columns.size() > kMaxColumns)
    throw Error(
        {.code = Code::kShape, .text = fmt::format("{} columns, at most {} allowed", columns.size(), kMaxColumns)});
  std::array<std::pair<std::uint64_t, std::uint64_t>, kMaxColumns> extents;
  std::size_t filled = 0;  // number of columns that have values
  for (std::size_t i = 0; i < columns.size(); ++i) {
    const Column& column = columns[i];
    const ColumnRow* known = find_column(column.field);
    if (!known) refuse(column, "is not a field of this protocol");
    if (column.element != known->element) refuse(column, "has the wrong element type");
    if (const std::uint32_t last = column.field == Field::kParameter ? kMaxParameters - 1 : 1; column.component > last)
      refuse(column, fmt::format("has a component above {}", last));
    if (column.offset_bytes % 8 != 0)
      refuse(column, fmt::format("starts at byte {}, not a multiple of 8", column.offset_bytes));
    const std::size_t size = size_of(column.element);
    if (column.offset_bytes > bytes.size() || column.count > (bytes.size() - column.offset_bytes) / size)
      refuse(column, fmt::format("needs {} elements from byte {}, the frame has {} bytes", column.count,
                                 column.offset_bytes, bytes.size()));
    for (std::size_t j = 0; j < i; ++j)
      if (columns[j].field == column.field && columns[j].component == column.component)
        refuse(column, "is given twice");
    if (column.count > 0) extents[filled++] = {column.offset_bytes, column.offset_bytes + column.count * size};
  }
  std::sort(extents.begin(), extents.begin() + static_cast<std::ptrdiff_t>(filled));
  for (std::size_t i = 1; i < filled; ++i)
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
  capacity_ = padded(size_) / 8;
  owned_ = std::make_shared_for_overwrite<std::uint64_t[]>(capacity_);
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
std::span<const T> values_of(const Column* column, const std::byte* data) {
  if (!column || column->element != kElement) return {};
  return {reinterpret_cast<const T*>(data + column->offset_bytes), column->count};
}

template <typename T>
std::span<T> writable(std::span<const T> column) {
  return {const_cast<T*>(column.data()), column.size()};
}

}  // namespace

std::span<const double> Batch::f64(Field field, std::uint32_t component) const {
  return values_of<double, Element::kFloat64>(find(field, component), data_);
}
std::span<const std::uint64_t> Batch::u64(Field field, std::uint32_t component) const {
  return values_of<std::uint64_t, Element::kUint64>(find(field, component), data_);
}
std::span<const std::uint8_t> Batch::u8(Field field, std::uint32_t component) const {
  return values_of<std::uint8_t, Element::kUint8>(find(field, component), data_);
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
