// A snapshot as the bytes of a checkpoint file and back: an HDF5 image built in memory, and a footer with its hash.
// HDF5 is never asked to write to a disk, and never shown bytes whose hash is wrong. FORMAT.md tells the layout.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "server/store/format.hpp"
#include "server/store/snapshot.hpp"
#include "server/store/storage.hpp"

namespace shearbus::store {

std::vector<std::byte> checkpoint_bytes(const Snapshot& snapshot, std::uint64_t generation);

// The bytes of the image, after everything about the file was checked. Throws DamagedFile.
Bytes verified_image(Bytes file, const std::string& name, std::uint64_t generation);

// A capsule as an HDF5 file, and back; throws DamagedFile.
std::vector<std::byte> capsule_bytes(const Capsule& capsule);
Capsule read_capsule(Bytes file, const std::string& name);

// Throws DamagedFile.
Snapshot read_checkpoint(Bytes file, const std::string& name, std::uint64_t generation);

}  // namespace shearbus::store
