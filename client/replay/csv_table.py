"""Reads a table of text as a history: names and units in its first line or in an option; commas, semicolons or tabs between
the values; decimal points or, where commas separate nothing, decimal commas. numpy reads all rows at once; where it cannot,
the rows are read one by one, which finds the line of a fault."""
import array
import contextlib
import difflib
import itertools
import math
import os
import warnings

import numpy as np
from terminal import REAL, open_regular, printable
from units import READ, factor_to_si, is_per_node, known_units, unit_of

BLANK = " \t\r\""
MOST_BYTES, MOST_LINE, MOST_ROWS, MOST_NODES = 2 << 30, 1 << 20, 10**8, 2_000_000
MOST_EXACT = 2.0**53  # up to here a number has every whole one


class Refused(ValueError):
    """A table that is not read: its text has the place, what was found, and the remedy."""

    def __init__(self, text, remedy=""):
        super().__init__(f"INVALID_VALUE: {text}{'' if text.endswith('.') or not remedy else '.'} {remedy}".rstrip())


def plain(value):
    """Returns a number as all programs print it: no digit more than tells it from others."""
    return repr(float(value)).removesuffix(".0")


def quoted(text):
    return f'"{printable(text[:60] + "..." * (len(text) > 60))}"'


def _number(text, decimal_comma):
    if decimal_comma and text.count(",") == 1 and "." not in text:
        text = text.replace(",", ".")
    text = text.replace("D", "e").replace("d", "e")  # Fortran's exponents of double precision
    value = float(text) if REAL.fullmatch(text) else math.nan
    return value if math.isfinite(value) else None


def _id(text, decimal_comma):
    if text.isascii() and text.isdigit():
        return int(text) if len(text) <= 20 and int(text) < 2**64 else None
    value = _number(text, decimal_comma)
    return int(value) if value is not None and 0 <= value <= MOST_EXACT and value == int(value) else None


def _near(name):
    """Returns the name that was meant by one that no table has, "" where none is near."""
    lower = name.lower().replace(" ", "_")
    if len(lower) < 5:  # most short words are near to each other
        return lower if lower in READ else ""
    return next(iter(difflib.get_close_matches(lower, READ, 1, 0.8)), "")


def _name_and_unit(cell, mark):
    """Returns both parts of "pressure [GPa]", "pressure (GPa)", "pressure_GPa" or, with the mark ":", of "pressure:GPa"."""
    at = min((cell.index(c) for c in (":" if mark == ":" else "[(") if c in cell), default=-1)
    if at >= 0:
        unit = cell[at + 1:].strip(BLANK)
        return cell[:at].strip(BLANK), (unit if mark == ":" else unit[:-1].strip(BLANK))
    name, line, unit = cell.rpartition("_")
    if unit_of(cell) is None and line and (unit_of(name) is not None or _near(name)):
        return name, unit
    return cell, ""


def _option(cells):
    """Returns a ready option for the columns of a first line, with what their names and units are near to."""
    words = []
    for cell in cells:
        name, unit = _name_and_unit(cell, "[")
        meant = name if unit_of(name) is not None else _near(name)
        si = unit_of(meant) if meant else None
        words.append("-" if si is None else f"{meant}:{unit if factor_to_si(unit, si) else si}" if si else meant)
    return f"--columns {','.join(words)}"


class CsvTable:
    """times (T,), dts (T,) or None, start: of the first step, None for points; ids (N,); texts {name: N texts}; values {name: array},
    (N,) for what does not change in time, else (T, N). SI units."""

    def __init__(self, path, columns="", points=False):
        self.path, self.points, self._line = path, points, 0
        try:
            self._file = open_regular(path, MOST_BYTES)
        except OSError as fault:
            self._refuse(f"cannot be opened: {fault.strerror}")
        except ValueError as fault:
            self._refuse(str(fault))
        self._encoding = "utf-16" if self._file.peek(2)[:2] in (b"\xff\xfe", b"\xfe\xff") else "utf-8-sig"
        with self._file:
            try:
                self._read_head(columns)
                self._read_rows()
                self._arrange()
            except UnicodeDecodeError as fault:
                self._line = 0
                self._refuse(f"is UTF-16 by its first bytes, but has {'an odd number of bytes' if fault.reason == 'truncated data' else 'a unit that is half a pair'}")

    def rows(self, name, begin, end):
        return np.ascontiguousarray(self.values[name][None] if is_per_node(name) else self.values[name][begin:end])

    def _refuse(self, what, remedy="", row=None):
        if row is not None:
            self._line = next(itertools.islice(self._rows(), row, None))[0]
        raise Refused(f"{self.path}{f', line {self._line}' if self._line else ''}: {what}", remedy)

    def _text(self):
        """Returns the file as text from its beginning on, with LF for all ends of lines."""
        os.lseek(self._file.fileno(), 0, os.SEEK_SET)
        return open(self._file.fileno(), encoding=self._encoding, closefd=False,
                    errors="strict" if self._encoding == "utf-16" else "surrogateescape")

    def _lines(self):
        """Yields the number and the text of each line that is no comment and not empty."""
        text = self._text()
        for number in itertools.count(1):
            line = text.readline(MOST_LINE + 2)
            if not line:
                return
            self._line = number
            if len(line) > MOST_LINE + 1:
                self._refuse(f"has more than {MOST_LINE} characters, which no row of a table has",
                             "Is it a table? Lines end in LF, CR LF or CR.")
            if "\0" in line:
                self._refuse("has a zero byte", "Save the table as UTF-8, or as UTF-16 with its byte order mark.")
            line = line.rstrip("\n")
            if (found := line.strip(BLANK)) and found[0] != "#":
                yield number, line

    def _rows(self):
        return ((number, line) for number, line in self._lines() if number > self._head)

    def _cells(self, line):
        return [cell.strip(BLANK) for cell in line.split(self._separator)]

    def _read_head(self, columns):
        lines = self._lines()
        self._head, line = next(lines, (0, ""))
        self._separator = line[4] if len(line) == 5 and line.startswith("sep=") else ""  # as Excel writes it
        if self._separator:
            self._head, line = next(lines, (0, ""))
        if not self._head:
            self._refuse("holds no table")
        self._separator = self._separator or ("\t" if "\t" in line else ";" if ";" in line else ",")
        self._comma = self._separator != ","
        cells = self._cells(line)
        has_names = _number(cells[0], self._comma) is None
        if not columns and not has_names:
            self._refuse("the first line has no names", "Name the columns: --columns time:us,pressure:GPa,velocity_jump:m/s")
        self.columns = [self._column(cell.strip(BLANK), ":") for cell in columns.split(",")] if columns else [self._column(cell, "[") for cell in cells]
        self._check_columns([] if columns else cells)
        if not has_names:
            self._head -= 1
        elif next(lines, None) is None:
            self._refuse("has no rows")

    def _column(self, cell, mark):
        """Returns the name of a column, "" for one that is left out, and its factor to SI."""
        name, unit = _name_and_unit(cell, mark)
        si = unit_of(name)
        if si is None and mark == ":" and name != "-":
            near = _near(name)
            self._refuse(f"--columns names {quoted(name)}, which no step has{f'; did you mean {near}?' * bool(near)}",
                         "Use names such as time, pressure, velocity_jump, node; - leaves a column out.")
        if si is None or name in ("node", "node_id"):
            return ("node_id" if si is not None else ""), 1.0
        if si == "" and unit:
            self._refuse(f"{name} has the unit {quoted(unit)}", "A pair is a name." if name == "pair" else
                         "A parameter has the unit of its key in the scene, and is written without.")
        factor = 1.0 if si in ("", "1") else factor_to_si(unit, si) if unit else None
        if factor is None:
            self._refuse(f"{name} has the unit {quoted(unit)}" if unit else f"{name} has no unit",
                         f"Write the unit as {name} [{si}], or give it with --columns {name}:{si}; known are {known_units(si)}.")
        return name, factor

    def _check_columns(self, cells):
        names = [name for name, _ in self.columns]
        for name in names:
            if name and names.count(name) > 1:
                self._refuse(f"{name} stands in two columns")
        found = ", ".join([quoted(cell) for cell in cells[:40]] + [f"and {len(cells) - 40} more"] * (len(cells) > 40))
        found = f"The first line has {found}" if cells else ""
        for cell, name in zip(cells, names):
            head = _name_and_unit(cell, "[")[0]
            near = _near(head) if not name else ""
            if near and {"node": "node_id"}.get(near, near) not in names:
                self._refuse(f"no step has {quoted(head)}; did you mean {near}? {found}",
                             f"Rename the column, or say {_option(cells)}, with the units that they have; - leaves a column out.")
        if "time" not in names:
            self._refuse(f"there is no column of the time. {found}", f'Name it "time [s]", or put time:s in its place in {_option(cells)}.'
                         if cells else "Put time:s in its place in --columns.")

    def _read_rows(self):
        """Reads the values of the rows, by the names of their columns."""
        for decimal_comma in (False, True)[:1 + self._comma]:
            with warnings.catch_warnings(), contextlib.suppress(ValueError, TypeError, DeprecationWarning):
                warnings.simplefilter("error", DeprecationWarning)
                return self._read_all(decimal_comma)
        self._read_one_by_one()

    def _read_all(self, decimal_comma):
        """Reads all rows by numpy. Raises ValueError or another error where a row is not plain."""
        kept = [i for i, (name, _) in enumerate(self.columns) if name and name != "pair"]
        values = self._load(decimal_comma, usecols=kept if len(kept) < len(self.columns) else None, ndmin=2)
        if values.shape[1] != len(kept) or not np.isfinite(values).all() or len(values) > MOST_ROWS:
            raise ValueError
        self.values = {self.columns[i][0]: values[:, at] for at, i in enumerate(kept)}
        ids = self.values.get("node_id")
        if ids is not None:
            if (ids < 0).any() or (ids != np.floor(ids)).any():
                raise ValueError
            at = self.columns.index(("node_id", 1.0))
            self.values["node_id"] = ids.astype(np.uint64) if ids.max() < MOST_EXACT else self._load(decimal_comma, dtype=np.uint64, usecols=[at], ndmin=1)
        if len(kept) < len(self.columns):  # numpy does not count the values of these rows
            pair = self.columns.index(("pair", 1.0)) if ("pair", 1.0) in self.columns else None
            pairs, count = [], 0
            for count, (_, line) in enumerate(self._rows(), 1):
                cells = line.split(self._separator)
                if len(cells) != len(self.columns):
                    raise ValueError
                if pair is not None:
                    pairs.append(cells[pair].strip(BLANK))
            if count != len(values):  # numpy takes a row for data that is a comment
                raise ValueError
            if pair is not None:
                self.values["pair"] = pairs

    def _load(self, decimal_comma, **options):
        lines = f"/proc/self/fd/{self._file.fileno()}"  # numpy reads a name faster than lines
        if decimal_comma:
            lines, options["skiprows"] = self._with_points(), 0
        return np.loadtxt(lines, **{"delimiter": self._separator, "comments": None, "quotechar": '"', "skiprows": self._head,
                                    "encoding": "utf-16" if self._encoding == "utf-16" else "latin-1", **options})

    def _with_points(self):
        for line in itertools.islice(self._text(), self._head, None):
            if "." in line:
                raise ValueError
            yield line.replace(",", ".")

    def _read_one_by_one(self):
        rows = {name: array.array("d") for name, _ in self.columns if name} | {"pair": [], "node_id": []}
        sign, sign_line = "", 0
        for count, (number, line) in enumerate(self._rows()):
            cells = self._cells(line)
            if len(cells) != len(self.columns):
                self._refuse(f"{len(cells)} values, expected {len(self.columns)} as there are columns",
                             "" if self._comma else "With a decimal comma the values are separated by ; or tabs.")
            if count == MOST_ROWS:
                self._refuse(f"more than {MOST_ROWS} rows", "Write the table as HDF5, which is read row by row.")
            for (name, _), cell in zip(self.columns, cells):
                if not name:
                    continue
                value = cell if name == "pair" else _id(cell, self._comma) if name == "node_id" else _number(cell, self._comma)
                if value is None and name == "node_id":
                    self._refuse(f"node {quoted(cell)} is no whole number from 0 to {2**64 - 1}")
                if value is None:
                    self._refuse(f"{name} is {quoted(cell)}, expected a finite number")
                rows[name].append(value)
                found = next((c for c in cell if c in ".,"), "") if self._comma and name not in ("pair", "node_id") else ""
                if found and sign and found != sign:
                    words = {".": "point", ",": "comma"}
                    self._refuse(f"{quoted(cell)} has a decimal {words[found]}, line {sign_line} a decimal {words[sign]}",
                                 "Write all numbers with one decimal sign, and none with a sign between thousands.")
                if found and not sign:
                    sign, sign_line = found, number
        self.values = {name: values if name == "pair" else np.array(values, np.uint64 if name == "node_id" else float)
                       for name, values in rows.items() if len(values)}

    def _arrange(self):
        """Sorts the rows by step and node, converts them to SI, and checks what a history needs."""
        values = {name: self._in_si(name, factor) for name, factor in self.columns if name}
        times, ids, pairs = values.pop("time"), values.pop("node_id", None), values.pop("pair", None)
        nodes = 1 if ids is None else self._nodes(times, ids)
        self.ids = np.zeros(1, np.uint64) if ids is None else ids[:nodes]
        for name, rows in values.items():
            if is_per_node(name):
                self._check_constant(name, rows, times, nodes, plain, "; it is one value per node")
        if pairs is not None:
            self._check_constant("pair", np.array(pairs, object), times, nodes, quoted, "; a node keeps its pair")
            for row, pair in enumerate(pairs[:nodes]):
                if any("\udc80" <= character <= "\udcff" for character in pair):
                    self._refuse(f"pair is {quoted(pair)}, which is no UTF-8", "Save the table as UTF-8.", row)
        self.texts = {} if pairs is None else {"pair": pairs[:nodes]}
        self.times = times[::nodes]
        dts = values.pop("dt", np.zeros(0))[::nodes]
        self.values = {name: rows[:nodes] if is_per_node(name) else rows.reshape(-1, nodes) for name, rows in values.items()}
        self._check_times(dts, nodes)
        self.dts = dts if len(dts) and not self.points else None

    def _in_si(self, name, factor):
        given = self.values[name]
        if factor == 1.0:
            return given
        with np.errstate(over="ignore"):
            values = given * factor
        for row in np.flatnonzero(~np.isfinite(values))[:1]:
            self._refuse(f"{name} is {plain(given[row])} in its unit, which is no finite number in {unit_of(name)}", row=int(row))
        return values

    def _nodes(self, times, ids):
        """Checks that each time has a row of each node, in one order. Returns the number of nodes."""
        nodes = int(np.argmax(times != times[0])) or len(times)
        if nodes > MOST_NODES:
            self._line = 0
            self._refuse(f"{nodes} nodes, more than a session takes")
        first, places = np.unique(ids[:nodes], return_index=True)
        if len(first) < nodes:
            row = int(np.setdiff1d(np.arange(nodes), places)[0])
            earlier = next(itertools.islice(self._rows(), int(np.argmax(ids == ids[row])), None))[0]
            self._refuse(f"node {ids[row]} has a second row at {plain(times[row])} s, after that of line {earlier}", row=row)
        expected, at = np.resize(ids[:nodes], len(ids)), np.repeat(times[::nodes], nodes)[:len(ids)]
        wrong = np.flatnonzero((ids != expected) | (times != at))
        if len(wrong):
            row = int(wrong[0])
            self._refuse(f"the row is of node {ids[row]} at {plain(times[row])} s; expected node {expected[row]} at {plain(at[row])} s",
                         "Each time has a row for each node, always in the same order.", row)
        if rest := len(ids) % nodes:
            self._refuse(f"the last time, {plain(times[-1])} s, has rows of {rest} of {nodes} nodes; that of node {ids[rest]} is the first missing",
                         row=len(ids) - 1)
        return nodes

    def _check_constant(self, name, rows, times, nodes, shown, why):
        wrong = np.flatnonzero((rows.reshape(-1, nodes) != rows[:nodes]).ravel())
        if len(wrong):
            row = int(wrong[0])
            self._refuse(f"{name} of node {self.ids[row % nodes]} changes from {shown(rows[row % nodes])} to {shown(rows[row])} at "
                         f"{plain(times[row])} s{why}", row=row)

    def _check_times(self, dts, nodes):
        times, lengths = self.times, np.diff(self.times)
        for i in np.flatnonzero(~(dts > 0))[:1]:
            self._refuse(f"dt is {plain(dts[i])} s, expected a length above 0", row=int(i) * nodes)
        for i in np.flatnonzero(lengths <= 0)[:1] + 1:
            self._refuse(f"time {plain(times[i])} s is not after {plain(times[i - 1])} s of the row before", row=int(i) * nodes)
        if self.points:
            if len(times) < 2:
                self._refuse("one point is no history; expected two or more", row=0)
            self.start = times[0] - lengths[0]  # a point has no start; that of a history is before its first time
            return
        self.start = times[0] - dts[0] if len(dts) else 0.0
        if not len(dts) and times[0] <= 0:
            self._refuse(f"the first step ends at {plain(times[0])} s, not after its start at 0 s",
                         "With --steps a time is the end of its row's step. Are the rows --points?", 0)
        if not len(dts) and len(times) > 1 and times[0] > 10 * lengths.max():
            self._refuse(f"the first step would last from 0 to {plain(times[0])} s, {times[0] / lengths.max():.3g} times as long as the longest "
                         f"other one, {lengths.max():.6g} s; does the clock begin later?",
                         'Give the lengths of the steps in a column "dt [s]", or say --points if the rows are values at instants.', 0)
        taken = np.diff(times, prepend=self.start)
        for i in np.flatnonzero(abs(dts - taken[:len(dts)]) > 1e-6 * (taken[:len(dts)] + abs(times[:len(dts)])))[:1]:
            self._refuse(f"dt is {plain(dts[i])} s; the step from {plain(times[i] - taken[i])} to {plain(times[i])} s takes {plain(taken[i])} s",
                         "Leave the column dt out to use the differences of the times.", int(i) * nodes)
