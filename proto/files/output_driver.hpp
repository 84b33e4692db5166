// The file driver through which HDF5 writes files. HDF5 1.10 cannot close a file after a failed write: it frees half of
// the file object, and the process crashes when it ends. With this driver HDF5 never sees a failure. The driver keeps
// the errno of the first failure, writes nothing after it, and holds the remaining bytes in memory until the file is
// closed and can be removed. Private to the sources of this directory that write HDF5.
#pragma once

#include <hdf5.h>

namespace shearbus::files::hdf5 {

// Makes HDF5 use the driver for files opened with the property list `access`. Returns a negative value if HDF5 fails.
herr_t use_output_driver(hid_t access);

// Returns the errno of the first failed access to an open file; 0 if none has failed.
int fault_of(hid_t file);

// Returns the errno of the first failed access to the file that this thread last opened or closed; 0 if none failed.
int fault_of_last_file();

}  // namespace shearbus::files::hdf5
