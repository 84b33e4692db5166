"""The host's own law, which the library calls for steps while the server is gone (shearbus_set_fallback)."""
import ctypes

import numpy

from . import _library
from .columns import BY_NUMBER, DTYPE


def _view(column, rows):
    """Returns the values of a column of a request where they lie."""
    dtype = DTYPE[BY_NUMBER[column.field].element]
    stride = column.stride_bytes or dtype.itemsize
    memory = (ctypes.c_char * (stride * (rows - 1) + dtype.itemsize)).from_address(column.values)
    return numpy.ndarray((rows,), dtype, memory, strides=(stride,))


def _columns(columns, count, rows):
    """Returns {name: array}; the second component of a tangential column has the name with "2" behind."""
    return {BY_NUMBER[column.field].name + ("2" if column.component else ""): _view(column, rows) for column in columns[:count]}


def callback(law, raised):
    """Returns the C function of a law(inputs, outputs). What it raises goes to the list `raised`, and the step fails."""
    def answer(_, request):
        try:
            asked = ctypes.cast(request, ctypes.POINTER(_library.Request)).contents
            if asked.n:
                outputs = _columns(asked.outputs, asked.n_outputs, asked.n)
                for values in outputs.values():
                    values.fill(numpy.nan if values.dtype.kind == "f" else 0)
                law(_columns(asked.inputs, asked.n_inputs, asked.n), outputs)
            return 0
        except BaseException as fault:
            raised.append(fault)
            return 1
    return _library.Fallback(answer)
