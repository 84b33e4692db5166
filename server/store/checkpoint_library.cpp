#include "server/store/checkpoint_library.hpp"

#include <H5public.h>

namespace {

// A host may have brought an HDF5 of its own, which the linker then takes for this library, too. HDF5 ends a process
// whose version is not that of the headers.
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
