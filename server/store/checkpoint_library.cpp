#include "server/store/checkpoint_library.hpp"

#include <H5public.h>

namespace {

// Returns the reason why HDF5 cannot be used, else an empty text. If the host has loaded an HDF5 of another version,
// this library is linked to it, too, and HDF5 would end the process.
std::string fault() {
  unsigned major = 0, minor = 0, release = 0;
  H5get_libversion(&major, &minor, &release);
  if (major == H5_VERS_MAJOR && minor == H5_VERS_MINOR && release == H5_VERS_RELEASE) return {};
  const auto text = [](unsigned a, unsigned b, unsigned c) {
    return std::to_string(a) + '.' + std::to_string(b) + '.' + std::to_string(c);
  };
  return "the host has loaded HDF5 " + text(major, minor, release) + ", and the state directory needs HDF5 " +
         text(H5_VERS_MAJOR, H5_VERS_MINOR, H5_VERS_RELEASE) +
         ": run shearbus-server --state-dir as a process of its own";
}

}  // namespace

const shearbus::store::CheckpointLibrary shearbus_checkpoint_1 = {
    .fault = fault,
    .checkpoint_bytes = shearbus::store::checkpoint_bytes,
    .verified_image = shearbus::store::verified_image,
    .capsule_bytes = shearbus::store::capsule_bytes,
    .read_capsule = shearbus::store::read_capsule,
    .read_checkpoint = shearbus::store::read_checkpoint,
};
