"""XXH3-64 of a buffer, by the package xxhash or by the system's libxxhash."""
import ctypes

import numpy

try:
    import xxhash

    xxh3 = xxhash.xxh3_64_intdigest

except ImportError:
    try:
        _sum = ctypes.CDLL("libxxhash.so.0").XXH3_64bits_withSeed
    except (OSError, AttributeError):
        raise ImportError(
            "shearbus needs XXH3: install the Python package xxhash (pip install xxhash, Debian: python3-xxhash) "
            "or libxxhash of version 0.8 or newer (Debian: libxxhash0)") from None
    _sum.restype = ctypes.c_uint64
    _sum.argtypes = [ctypes.c_void_p, ctypes.c_size_t, ctypes.c_uint64]

    def xxh3(buffer, seed=0):
        if type(buffer) is bytes:
            return _sum(buffer, len(buffer), seed)
        view = numpy.frombuffer(buffer, numpy.uint8) if len(buffer) else numpy.empty(0, numpy.uint8)
        return _sum(view.ctypes.data, view.size, seed)
