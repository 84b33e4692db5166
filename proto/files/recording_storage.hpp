// Where HDF5 finds the values of a dataset: a history is read from its own file, and only as it was written. Private to
// the sources of this directory that read HDF5.
#pragma once

#include <hdf5.h>

#include <string>

namespace shearbus::files::hdf5 {

// Whether a link of this path exists. Groups in the path are entered only if they are in the file itself.
bool has_link(hid_t file, const std::string& path);

// Returns what is wrong with the way to an object, such as "is a link to another file"; "" if it lies in this file.
std::string fault_of_link(hid_t file, const std::string& path);

// What is wrong with the storage of a dataset.
struct StorageFault {
  std::string fault;  // empty: nothing
  std::string remedy;
};
// Values in other files: asked before anything else of a dataset, since its size may be in them, too.
StorageFault fault_of_place(hid_t dataset);
// A filter that is not installed, chunks too large to read, or values that were never written.
StorageFault fault_of_storage(hid_t dataset);

}  // namespace shearbus::files::hdf5
