// Converts a snapshot to the bytes of a checkpoint file and back: an HDF5 image built in memory, and a footer with its
// hash. HDF5 never writes to a disk and never reads a checkpoint whose hash is wrong. FORMAT.md describes the layout.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "server/store/format.hpp"
#include "server/store/snapshot.hpp"
#include "server/store/storage.hpp"

namespace shearbus::store {

std::vector<std::byte> checkpoint_bytes(const Snapshot& snapshot, std::uint64_t generation);

// Checks footer, lengths and hashes of the file and returns the bytes of its HDF5 image. Throws DamagedFile.
Bytes verified_image(Bytes file, const std::string& name, std::uint64_t generation);

// Converts a capsule to an HDF5 file and back. Reading throws DamagedFile.
std::vector<std::byte> capsule_bytes(const Capsule& capsule);
Capsule read_capsule(Bytes file, const std::string& name);

// Checks the file as verified_image() does and reads its snapshot. Throws DamagedFile.
Snapshot read_checkpoint(Bytes file, const std::string& name, std::uint64_t generation);

}  // namespace shearbus::store
