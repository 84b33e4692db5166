// The functions of checkpoint.hpp as a table, by which libshearbus-embedded.so calls libshearbus-checkpoint.so: a host
// that keeps no states on disk loads no HDF5. The table is private to the libraries of this project, and the number in
// its name rises with any change.
#pragma once

#include "server/store/checkpoint.hpp"

namespace shearbus::store {

struct CheckpointLibrary {
  std::string (*fault)();  // why the library cannot be used in this process; empty: it can
  decltype(&store::checkpoint_bytes) checkpoint_bytes;
  decltype(&store::verified_image) verified_image;
  decltype(&store::capsule_bytes) capsule_bytes;
  decltype(&store::read_capsule) read_capsule;
  decltype(&store::read_checkpoint) read_checkpoint;
};

// In libshearbus-embedded.so: loads the library if it is not loaded yet. Throws std::runtime_error if there is none, or
// if it cannot be used.
const CheckpointLibrary& checkpoint_library();

}  // namespace shearbus::store

extern "C" __attribute__((visibility("default"))) const shearbus::store::CheckpointLibrary shearbus_checkpoint_1;
