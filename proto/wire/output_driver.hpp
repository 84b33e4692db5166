// HDF5's access to a file that is written. HDF5 1.10 cannot close a file after a failed write: it frees half of the
// file and the process dies at its end. Behind this driver HDF5 never sees a failure. The driver keeps the errno of
// the first one, writes nothing after it, and holds the remaining bytes in memory until the file is closed and can be
// removed. Private to the sources of this directory that write HDF5.
#pragma once

#include <hdf5.h>

namespace shearbus::wire::hdf5 {

// Makes a property list of file access use the driver. Returns a negative value if HDF5 fails.
herr_t use_output_driver(hid_t access);

// The errno of the first failed write to an open file; 0 if there was none.
int fault_of(hid_t file);

// The errno of the file that this thread opened or closed last with the driver.
int fault_of_last_file();

}  // namespace shearbus::wire::hdf5
