// Handles that close themselves: of files, and of the objects of HDF5.
#pragma once

#include <unistd.h>

#include <utility>

namespace shearbus::wire {

// The number of an open object, which kClose closes; negative: none.
template <typename Number, int (*kClose)(Number)>
class Handle {
 public:
  Handle() = default;
  explicit Handle(Number number) : number_(number) {}
  Handle(Handle&& other) noexcept : number_(other.release()) {}
  Handle& operator=(Handle&& other) noexcept {
    std::swap(number_, other.number_);
    return *this;
  }
  ~Handle() { close(); }

  operator Number() const { return number_; }
  Number release() { return std::exchange(number_, -1); }
  int close() { return number_ >= 0 ? kClose(release()) : 0; }

 private:
  Number number_ = -1;
};

using Descriptor = Handle<int, ::close>;  // of an open file

}  // namespace shearbus::wire
