// HDF5 1.10 trusts what it finds in the global heap of a file, which holds texts of variable length (as h5py writes
// them): damage there ends the process that reads them, or lets it go on for ever. Private to the sources of this directory that read HDF5.
#pragma once

#include <filesystem>

namespace shearbus::files::hdf5 {

// Whether a process can read all texts of variable length of an HDF5 file: a child process tries it. True if there can
// be no child. A fault that HDF5 reports is left to the reader of the file.
bool survives_its_texts(const std::filesystem::path& file);

}  // namespace shearbus::files::hdf5
