"""Steps prepared for the library: the structs of all steps that have the same columns and rows."""
import ctypes

import numpy

from . import _library
from ._values import FLOAT, fill
from .columns import BY_NAME, DTYPE

SMALL = 2048  # up to so many rows the copy of a column is cheaper than its address


class Plan:
    """The request of steps with given keywords, whose structs fit() prepares for some number of rows. A step of few rows
    copies its columns into `frame` and its answer out of `block`; with more rows the library reads the host's arrays and
    writes the answer's."""

    def __init__(self, places, components, wanted, whole):
        """places: (name, first column, components) of each keyword; wanted: names of the columns of the answer; whole: the
        columns are always copied into `frame`."""
        self.places, self.whole = places, whole
        self.columns = tuple((BY_NAME[name].number, component) for name, _, width in places for component in range(width))
        self.wanted = [(name, DTYPE[BY_NAME[name].element], components if BY_NAME[name].tangential else 1) for name in wanted]
        outputs = [(BY_NAME[name].number, component) for name, _, width in self.wanted for component in range(width)]
        self.inputs = (_library.Column * len(self.columns))(*self.columns)
        self.outputs = (_library.Column * len(outputs))(*outputs)
        self.request = _library.Request(inputs=self.inputs, n_inputs=len(self.inputs), outputs=self.outputs,
                                        n_outputs=len(self.outputs))
        self.result = _library.Result()
        self.by_request, self.by_result = ctypes.byref(self.request), ctypes.byref(self.result)
        self.count = None
        self.said = None  # the options that the request has

    def fit(self, rows):
        """Prepares steps of so many rows."""
        self.count, self.shape, self.request.n = rows, (rows,), rows
        begin, size = {}, 0
        for name, dtype, width in sorted(self.wanted, key=lambda column: -column[1].itemsize):  # doubles at multiples of 8
            begin[name] = size
            size += dtype.itemsize * width * rows
        self.layout = {name: (dtype, (rows,) if width == 1 else (rows, width), begin[name]) for name, dtype, width in self.wanted}
        self.copies = self.whole or rows <= SMALL
        if self.copies:
            self.frame = numpy.empty((len(self.columns), rows))
            self._read(0, self.frame)
            self.rows = [(name, memoryview(self.frame[at]) if width == 1 else None, at, width) for name, at, width in self.places]
            self.block = numpy.empty(size, numpy.uint8)
            self._write(self.block)
        self.size = size

    def _read(self, first, columns):
        """Points the inputs from `first` on to the rows of an array."""
        base, (step, stride) = _library.address(columns), columns.strides
        for i in range(len(columns)):
            self.inputs[first + i].values, self.inputs[first + i].stride_bytes = base + step * i, stride

    def _write(self, block):
        """Points the outputs to their places in a block of bytes."""
        base, at = _library.address(block), iter(self.outputs)
        for dtype, shape, begin in self.layout.values():
            width = shape[1] if len(shape) > 1 else 1
            for component in range(width):
                output = next(at)
                output.values = base + begin + dtype.itemsize * component
                output.stride_bytes = dtype.itemsize * width

    def take(self, values):
        """Takes the values of a step, {keyword: value}. Returns what must live until the library has read them."""
        if not self.copies:
            return [self._take_large(name, values[name], at, width) for name, at, width in self.places]
        for name, view, at, width in self.rows:
            value = values[name]
            if view is not None and type(value) is numpy.ndarray:
                try:
                    view[:] = value  # the usual case: float64 of the right shape
                    continue
                except (TypeError, ValueError):
                    pass
            fill(self.frame[at:at + width], name, value)
        return None

    def _take_large(self, name, value, at, width):
        expected = self.shape if width == 1 else (self.count, width)
        if type(value) is numpy.ndarray and value.dtype == FLOAT and value.shape == expected and value.strides[0]:
            columns = value[None] if width == 1 else value.T
        else:
            columns = numpy.empty((width, self.count))
            fill(columns, name, value)
        self._read(at, columns)
        return columns

    def room(self):
        """Returns the bytes that the answer will have, if the library writes it where it stays."""
        if self.copies:
            return None
        block = numpy.empty(self.size, numpy.uint8)
        self._write(block)
        return block
