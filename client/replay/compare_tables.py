"""Compares two tables of steps and nodes, histories or results in HDF5 or text: the first step, quantity and node that
differ, or with a tolerance the largest difference of each quantity."""
import pathlib

import h5py
import numpy as np
from csv_table import CsvTable, Refused, plain
from terminal import printable
from units import QUANTITIES, factor_to_si, is_per_node

BLOCK = 131_072  # values of a quantity that are compared at once


class Hdf5Table:
    """A history in HDF5 that shearbus-replay has checked but for NaN."""

    def __init__(self, path):
        self.path, self._file = path, h5py.File(path)
        self.times, self.ids = self._file["time"][:] * self._factor("time", "s"), self._file["node_id"][:]
        self.values = {name: (self._file[name], self._factor(name, si)) for name, si in QUANTITIES.items() if name in self._file}

    def _factor(self, name, si):
        unit = self._file[name].attrs.get("units", "")
        return factor_to_si(unit.decode() if isinstance(unit, bytes) else unit, si) or 1.0

    def rows(self, name, begin, end):
        data, factor = self.values[name]
        found = np.array(data[begin:end] if data.ndim == 2 else [data[:]], np.float64)
        if factor != 1.0:
            found *= factor
        if not np.isfinite(found).all():
            step, node = np.argwhere(~np.isfinite(found))[0]
            raise Refused(f"{self.path}: /{name}[{begin + step}, {node}] (time {plain(self.times[begin + step])} s, node {self.ids[node]}) is "
                          f"{found[step, node]}; expected a finite number")
        return found


def differing(a, b, rtol):
    """Returns where numbers differ, in their bits and by more than the tolerance."""
    found = a.view(np.uint64) != b.view(np.uint64)
    if rtol and found.any():
        found &= ~(np.abs(a - b) <= rtol * np.maximum(np.abs(a), np.abs(b)))
    return found


class Largest:
    """The largest difference of a quantity among the values that differ, and where it is."""

    def __init__(self):
        self.difference, self.differing, self.values = -1.0, 0, 0

    def add(self, a, b, begin, wrong):
        self.values += a.size
        if not wrong.any():
            return
        self.differing += int(wrong.sum())
        with np.errstate(over="ignore"):
            found = np.where(wrong, np.abs(a - b), -1.0)
        place = np.unravel_index(found.argmax(), found.shape)
        if found[place] > self.difference:
            self.difference, self.a, self.b, self.step, self.node = found[place], a[place], b[place], begin + place[0], place[-1]


def blocks(a, b, common):
    """Yields, for the steps of both tables, the first of a block and {quantity: values of a, values of b}; "time" among them.
    What does not change in time is in the first step alone."""
    size, steps = max(1, BLOCK // len(a.ids)), min(len(a.times), len(b.times))
    for begin in range(0, steps, size):
        end = min(begin + size, steps)
        pairs = {"time": (a.times[begin:end, None].copy(), b.times[begin:end, None].copy())}
        yield begin, pairs | {name: (a.rows(name, begin, end), b.rows(name, begin, end)) for name in common
                              if begin == 0 or not is_per_node(name)}


def compare_to_the_bit(a, b, common, names):
    """Prints the first step that differs. Returns whether there is none."""
    for begin, pairs in blocks(a, b, common):
        wrong = {name: differing(*pair, 0.0) for name, pair in pairs.items()}
        step = min((int(found.any(axis=1).argmax()) for found in wrong.values() if found.any()), default=None)
        if step is None:
            continue
        at_a, at_b = (plain(values[step, 0]) for values in pairs["time"])
        if wrong.pop("time")[step, 0]:
            print(f"step {begin + step}: it ends at {at_a} s in {names[0]}, at {at_b} s in {names[1]}")
            return False
        rows = {name: found[step] for name, found in wrong.items() if step < len(found)}
        name = next(name for name, row in rows.items() if row.any())
        node = int(rows[name].argmax())
        value_a, value_b = (plain(values[step, node]) for values in pairs[name])
        print(f"step {begin + step} (ends at {at_a} s): {name} of node {a.ids[node]} is {value_a} in {names[0]}, {value_b} in {names[1]} "
              f"({sum(int(row.sum()) for row in rows.values())} of {sum(row.size for row in rows.values())} values of the step differ)")
        return False
    return True


def compare_within(a, b, common, names, rtol):
    """Prints the largest difference of each quantity that has one. Returns whether there is none."""
    largest = {name: Largest() for name in ["time", *common]}
    for begin, pairs in blocks(a, b, common):
        for name, (of_a, of_b) in pairs.items():
            largest[name].add(of_a, of_b, begin, differing(of_a, of_b, rtol))
    found = {name: one for name, one in largest.items() if one.differing}
    for name, one in found.items():
        in_a, in_b = (f"{plain(value)}{' s' if name == 'time' else ''} in {where}" for value, where in zip((one.a, one.b), names))
        if name == "time":
            print(f"{one.differing} of {one.values} steps end at other times, the largest difference at step {one.step}: {in_a}, {in_b}")
            continue
        size = max(abs(one.a), abs(one.b))
        share = f" ({one.difference / size:.2g} of the larger)" if np.isfinite(one.difference) else ""
        print(f"{name}: {one.differing} of {one.values} values differ; largest difference {one.difference:.6g}{share}, at node {a.ids[one.node]}, "
              f"step {one.step} (ends at {plain(a.times[one.step])} s): {in_a}, {in_b}")
    return not found


def compare(path_a, path_b, kinds, rtol):
    """Compares two tables, each of kind "text" or "hdf5", and prints what is found. Returns whether they are equal. Raises
    Refused or OSError."""
    a, b = ((CsvTable if kind == "text" else Hdf5Table)(path) for kind, path in zip(kinds, (path_a, path_b)))
    names = [pathlib.Path(path).name for path in (path_a, path_b)]
    names = [printable(name) for name in (names if names[0] != names[1] else (path_a, path_b))]
    if not np.array_equal(a.ids, b.ids):
        print(f"the nodes differ: {len(a.ids)} in {names[0]}, {len(b.ids)} in {names[1]}")
        return False
    common = [name for name in QUANTITIES if name in a.values and name in b.values]
    if not common:
        raise Refused(f"{path_a} and {path_b} have no quantity in common")
    single = [f"{name} in {where}" for one, other, where in ((b, a, names[1]), (a, b, names[0]))
              for name in QUANTITIES if name in one.values and name not in other.values]
    if single:
        print(f"not compared, since only one has it: {', '.join(single)}")
    equal = compare_within(a, b, common, names, rtol) if rtol else compare_to_the_bit(a, b, common, names)
    counts = len(a.times), len(b.times)
    if counts[0] != counts[1] and (equal or rtol):
        print(f"{names[0]} has {counts[0]} steps, {names[1]} has {counts[1]}{'' if rtol else '; equal until there'}")
        return False
    if equal or rtol:
        print(f"{'equal' if equal else 'different'}{f' within {plain(rtol)}' if rtol else ''}: {counts[0]} steps of {len(a.ids)} nodes, {', '.join(common)}")
    return equal
