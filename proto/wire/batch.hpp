// A batch holds columns of numbers, one value per row (structure of arrays): the content of a payload frame.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "proto/wire/columns.hpp"

namespace shearbus::wire {

struct Column {
  Field field = Field::kUnspecified;
  std::uint32_t component = 0;
  Element element = Element::kUnspecified;
  std::uint64_t offset_bytes = 0;  // position from the start of the frame, a multiple of 8
  std::uint64_t count = 0;

  static void fields(auto&& v, auto& m) {
    v(1, "field", m.field);
    v(2, "component", m.component);
    v(3, "element", m.element);
    v(4, "offset_bytes", m.offset_bytes);
    v(5, "count", m.count);
  }
};

// Columns over one 8-byte aligned block. A batch can be moved cheaply, but not copied.
class Batch {
 public:
  Batch() = default;

  // Allocates zeroed columns of `count` values: one for each field, but `components` for each tangential field and for
  // kParameter. The non-const spans of the batch write the values.
  static Batch of(std::span<const Field> fields, std::size_t count, std::uint32_t components = 1);
  // Like of(), but uses the memory that this batch owns if it suffices and is not much larger, and the values of the
  // columns are undefined: the caller writes all of them. The bytes between the columns are zero.
  void reshape(std::span<const Field> fields, std::size_t count, std::uint32_t components = 1);
  // Returns the same columns over the same bytes, which belong to this batch or its caller.
  Batch view() const;

  // Lets others keep the memory that this batch owns. Whoever lends it must not write to it while they may read it.
  void lend() { lent_ = true; }
  // Keeps the memory of a batch that was lent, or of a view of it; null for any other.
  std::shared_ptr<const void> keeper() const { return lent_ ? owned_ : viewed_; }

  // Makes a batch of columns over received bytes. Aligned bytes are not copied and must outlive the batch; misaligned
  // bytes (ZeroMQ hands out such frames below 8 kB) are copied. Throws Error{kShape} if a column leaves the frame,
  // overlaps another, is misaligned, repeats a field and component or has the wrong element type, or if there are more
  // than kMaxColumns.
  static Batch over(std::vector<Column> columns, std::span<const std::byte> bytes);

  const std::vector<Column>& columns() const { return columns_; }
  std::span<const std::byte> bytes() const { return {data_, size_}; }

  bool has(Field field, std::uint32_t component = 0) const;
  // Return the values of a column; empty if the batch does not have the column.
  std::span<const double> f64(Field field, std::uint32_t component = 0) const;
  std::span<const std::uint64_t> u64(Field field, std::uint32_t component = 0) const;
  std::span<const std::uint8_t> u8(Field field, std::uint32_t component = 0) const;
  // Return the values of a column for writing. A batch over received bytes copies the bytes first, so the received
  // bytes do not change.
  std::span<double> f64(Field field, std::uint32_t component = 0);
  std::span<std::uint64_t> u64(Field field, std::uint32_t component = 0);
  std::span<std::uint8_t> u8(Field field, std::uint32_t component = 0);

 private:
  const Column* find(Field field, std::uint32_t component) const;
  void lay_out(std::span<const Field> fields, std::size_t count, std::uint32_t components);
  void own();

  std::vector<Column> columns_;
  std::shared_ptr<std::uint64_t[]> owned_;  // null if the bytes belong to the caller
  std::shared_ptr<const void> viewed_;      // of a view: the memory of a batch that was lent
  bool lent_ = false;
  std::size_t capacity_ = 0;  // number of words in owned_
  const std::byte* data_ = nullptr;
  std::size_t size_ = 0;
};

}  // namespace shearbus::wire
