"""From a host's arguments to the arrays, numbers and texts that the library takes. What cannot be taken is refused by name,
before anything is sent; the values of columns are the server's to refuse."""
import difflib
import operator
import os

import numpy

from . import _library
from .errors import Code, ContentError, MessageError, WrongType, WrongValue

FLOAT = numpy.dtype(float)
LONGEST_S = 1e7
IDS = "a list of whole numbers from 0 to 2**64 - 1"


def node_ids(values):
    """Returns node ids as an array of uint64. Raises ContentError or MessageError where they are not distinct whole
    numbers from 0 on."""
    if isinstance(values, numpy.ma.MaskedArray):
        raise MessageError(Code.SHAPE, "nodes is a masked array", "Pass the ids that are meant, as a plain array.",
                           "nodes")
    if not isinstance(values, numpy.ndarray):
        array = _whole_numbers(values)
    else:
        array = values if values.size or values.ndim != 1 else values.astype(numpy.uint64)
    if array.ndim != 1 or array.dtype.kind not in "iu":
        raise MessageError(
            Code.SHAPE,
            f"nodes has the type {array.dtype} and the shape {array.shape}, expected {IDS}", "Make the ids of an integer type.", "nodes")
    if array.dtype.kind == "i" and (array < 0).any():
        raise ContentError(Code.INVALID_VALUE, f"nodes has the id {array[array < 0][0]}, expected 0 or more",
                           "Number the nodes from 0 on.", "nodes")
    array = array.astype(numpy.uint64)
    ordered = numpy.sort(array)
    twice = ordered[1:][ordered[1:] == ordered[:-1]]
    if twice.size:
        raise ContentError(Code.DUPLICATE_NODE, f"nodes has the id {twice[0]} twice", "Name each node once.", "nodes",
                           [int(twice[0])])
    return array


def _whole_numbers(values):
    """Returns a sequence of Python's whole numbers as an array; numpy itself would make floats of [1, 2**64 - 1]."""
    found, at = [], -1
    try:
        for at, value in enumerate(values):
            if isinstance(value, (bool, numpy.bool_)) or not -2**63 <= operator.index(value) < 2**64:
                raise TypeError
            found.append(value)
    except TypeError:
        odd = f"is {_shown(values)}" if at < 0 else f"has {_shown(value)} at [{at}]"
        raise MessageError(Code.SHAPE, f"nodes {odd}, expected {IDS}", "Number the nodes by whole numbers.", "nodes") from None
    return numpy.array(found, numpy.int64 if min(found, default=0) < 0 else numpy.uint64)


def fill(rows, name, value):
    """Writes the values of a column into `rows`, of shape (components, N). A number stands for all rows; anything else
    has the shape (N,), or (N, 2) with two components. Raises MessageError or ContentError, which name the column,
    before anything is sent."""
    if value is None:
        raise MessageError(Code.SHAPE, f"{name} is None, expected numbers of float64", "Give it, or leave it out where it is optional.", name)
    if isinstance(value, numpy.ma.MaskedArray):
        raise MessageError(Code.SHAPE, f"{name} is a masked array",
                           f"Pass {name}.filled(value), or only the nodes in contact (nodes=).", name)
    try:
        array = numpy.asarray(value)
    except ValueError as fault:
        raise MessageError(Code.SHAPE, f"{name} is no array of numbers: {fault}", field=name) from None
    if array.dtype.kind not in "iuf" or (array.dtype.kind == "f" and array.dtype.itemsize != 8):
        raise MessageError(Code.SHAPE, f"{name} has the type {array.dtype}, expected float64",
                           f"Compute it in double precision, or convert it explicitly: numpy.asarray({name}, float).",
                           name)
    components, count = rows.shape
    expected = (count,) if components == 1 else (count, components)
    if array.ndim == 0 and (components == 1 or array == 0):
        rows[...] = array
    elif array.shape == expected:
        rows[...] = array if components == 1 else array.T
    else:
        raise MessageError(
            Code.SHAPE, f"{name} has the shape {array.shape}, expected {expected}" +
            (" or a number" if components == 1 else ": one row per node, one column per tangential direction"),
            "Pass one value per node of the step, in the order of its rows.", name)


def pairs_of(pair, count):
    """Returns (names, places) of the pairs of `count` nodes: a name for all, or a list of one name per node; ([], None)
    for None."""
    if pair is None or not count:
        return [], None
    each = [pair] * count if isinstance(pair, str) else [text("pair", name).decode() for name in pair]
    if len(each) != count:
        raise MessageError(Code.SHAPE, f"pair has {len(each)} names, expected {count}", "Give one name per node.", "pair")
    names = list(dict.fromkeys(each))
    place = {name: i for i, name in enumerate(names)}
    return names, [place[name] for name in each]


def given_nodes(ids, initial_temperature=None, pair=None, parameters=None):
    """Returns a shearbus_nodes of nodes and what they differ by, as shearbus.open() takes it. The struct keeps the arrays
    that it points to."""
    names, places = pairs_of(pair, len(ids))
    columns = {} if initial_temperature is None else {"initial_temperature": initial_temperature}
    columns |= parameters or {}
    frame = numpy.empty((len(columns), len(ids)))
    for row, (name, values) in enumerate(columns.items()):
        fill(frame[row:row + 1], name, values)
    at = [_library.address(row) for row in frame]
    first = initial_temperature is not None
    places = numpy.array([] if places is None else places, numpy.uint64)
    keys = list(parameters or {})
    nodes = _library.Nodes(
        n=len(ids), node_ids=_library.address(ids), initial_temperature_k=at[0] if first else None,
        n_pairs=len(names), pairs=_library.texts(names), pair=_library.address(places), n_parameters=len(keys),
        parameters=_library.texts(keys), values=(_library.Address * len(keys))(*at[first:]))
    nodes.kept = ids, frame, places
    return nodes


def number(name, value):
    """Returns a number of seconds of a step."""
    if isinstance(value, (bool, numpy.bool_)) or isinstance(value, (str, bytes)):
        _refuse_number(name, value)
    try:
        return float(value)
    except (TypeError, ValueError):
        _refuse_number(name, value)


def _refuse_number(name, value):
    raise WrongType(Code.SHAPE, f"{name} is {value!r}, expected a number of seconds", f"Pass {name} as a float.", name)


def deadline(name, value):
    """Returns a number of seconds that a call may wait."""
    found = number(name, value)
    if not (0 < found <= LONGEST_S):
        raise WrongValue(Code.INVALID_VALUE, f"{name} is {found:g} s, expected a time above 0 and at most {LONGEST_S:g} s",
                         "Leave it out for the default.", name)
    return found


def count(name, value, bits=64):
    """Returns a whole number from 0 on, of so many bits."""
    try:
        found = operator.index(value)
    except TypeError:
        found = None
    if found is None or isinstance(value, (bool, numpy.bool_)):
        raise WrongType(Code.SHAPE, f"{name} is {value!r}, expected a whole number from 0 on", f"Pass {name} as an int.", name)
    if not 0 <= found < 2**bits:
        raise WrongValue(Code.SHAPE, f"{name} is {found}, expected a whole number from 0 to 2**{bits} - 1", field=name)
    return found


def text(name, value, path=False):
    """Returns the bytes of a text, or of the path of a file; None for None."""
    if value is None:
        return None
    if path and isinstance(value, os.PathLike):
        value = os.fspath(value)
    if not isinstance(value, str):
        raise WrongType(Code.SHAPE, f"{name} is {_shown(value)}, expected a text" + (" or a path" if path else ""),
                        f"Decode it: {name}.decode()." if isinstance(value, bytes) else f"Pass {name} as a str.", name)
    if "\0" in value:
        raise WrongValue(Code.SHAPE, f"{name} has a NUL character in it: {value!r}", "Remove it.", name)
    return value.encode()


def _shown(value):
    return f"{repr(value)[:60]} of type {type(value).__name__}"


def word(name, value, known):
    """Returns the number of a word in a dict of known ones."""
    if not isinstance(value, str) or value not in known:
        words = [f'"{one}"' for one in known]
        kind = WrongValue if isinstance(value, str) else WrongType
        raise kind(Code.SHAPE, f"{name} is {value!r}", f"Use {', '.join(words[:-1])} or {words[-1]}.", name)
    return known[value]


def similar(name, known):
    own = _library.in_python(name)  # of a name as recordings and the protocol have it
    found = [own] if own in known else difflib.get_close_matches(name, known, 1)
    return f'; did you mean "{found[0]}"?' if found else ""


def frozen(array):
    array.setflags(write=False)
    return array
