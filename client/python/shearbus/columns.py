"""The columns of the protocol (_contract.py, which is printed from columns.inc). Which of them a step needs, and which its reply
brings, is what the server answers when a session is opened."""
from typing import NamedTuple

import numpy

from ._contract import COLUMNS as _ROWS, FAR_FIELD_FORM  # noqa: F401

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


_ELEMENT = {"Float64": FLOAT64, "Uint64": UINT64, "Uint8": UINT8}
COLUMNS = tuple(Column(number, wire_name, quantity, unit, _ELEMENT[element], tangential, short_name)
                for number, wire_name, quantity, unit, element, _, tangential, short_name in _ROWS)
BY_NUMBER = {column.number: column for column in COLUMNS}
BY_NAME = {column.name: column for column in COLUMNS}
# The stick form of a force-driven request has the columns STICK_FORM in place of FAR_FIELD_FORM.
STICK_FORM = tuple(BY_NUMBER[number].name for number, *_, kind, _, _ in _ROWS if kind == "Stick")
LEDGER = tuple(number for number, *_, kind, _, _ in _ROWS if kind == "Ledger")  # numbers of the energy ledger
PROFILE = tuple(number for number, *_, kind, _, _ in _ROWS if kind == "Profile")  # numbers of the columns of a profile
NODE_ID, INITIAL_TEMPERATURE, PAIR, PARAMETER = (BY_NUMBER[number] for number in (1, 2, 3, 4))
