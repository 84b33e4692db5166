"""The columns of the protocol, read from columns.inc, which the server and the library are built from. Nothing else in
the package lists columns: which of them a step needs, and which its reply brings, is what the server answers when a
session is opened."""
import pathlib
import re
from typing import NamedTuple

import numpy

__all__ = ["BY_NAME", "BY_NUMBER", "COLUMNS", "Column"]

FLOAT64, UINT64, UINT8 = 1, 2, 3
DTYPE = {FLOAT64: numpy.dtype("<f8"), UINT64: numpy.dtype("<u8"), UINT8: numpy.dtype("u1")}


class Column(NamedTuple):
    number: int  # shearbus.v1.Field
    wire_name: str  # name in messages of the server
    quantity: str  # name in recordings
    unit: str
    element: int = FLOAT64
    tangential: bool = False  # a vector along the interface, with two components where the scene has two
    short_name: str = ""

    @property
    def name(self):
        """Name of the column as keyword of a step and as attribute of an answer."""
        return self.short_name or self.quantity


SHORT_NAME = {"velocity_jump": "jump", "shear_stress": "stress", "sliding_velocity": "slip",
              "interface_temperature": "temperature", "velocity_jump_new": "jump_new"}
ELEMENT = {"Float64": FLOAT64, "Uint64": UINT64, "Uint8": UINT8}


def _rows(text):
    """Yields the columns of the rows of columns.inc, each a macro call whose arguments the head of the file names."""
    for macro, call in re.findall(r"^(NODE|INPUT|STICK|OUTPUT|EXCHANGE|LEDGER|PROFILE)\((.*?)\)$", text, re.M | re.S):
        arguments = [a.strip().strip('"') for a in re.findall(r'(?:"[^"]*"|[^,"])+', call)]
        if macro == "LEDGER":
            del arguments[1]  # the term of the ledger
        number, wire_name, quantity, unit = arguments[1:5]
        yield Column(int(number), wire_name, quantity, unit, ELEMENT.get(arguments[5], FLOAT64),
                     macro == "EXCHANGE" or "Tangential" in arguments[5:7], SHORT_NAME.get(quantity, ""))


COLUMNS = tuple(_rows(pathlib.Path(__file__).with_name("columns.inc").read_text(encoding="utf-8")))
# The stick form of a force-driven request has the columns of the second row in place of those of the first.
FAR_FIELD_FORM = ("stress_soft", "stress_hard", "mass_soft", "mass_hard")
STICK_FORM = ("stick_stress", "impedance")
LEDGER = range(40, 49)  # numbers of the energy ledger
PROFILE = range(50, 56)  # numbers of the columns of a profile

BY_NUMBER = {column.number: column for column in COLUMNS}
BY_NAME = {column.name: column for column in COLUMNS}
NODE_ID, INITIAL_TEMPERATURE, PAIR, PARAMETER = (BY_NUMBER[number] for number in (1, 2, 3, 4))
