"""Names and units of the quantities of a history, as proto/wire/units.hpp has them for files in HDF5."""
import re

from contract import COLUMNS, UNIT_WORDS, UNITS

SPELLINGS = str.maketrans({"µ": "u", "μ": "u", "·": " ", "⋅": " ", "²": "2", "⁻": "-", "¹": "1", "^": "", ".": " ", "*": " "})
PARAMETER = re.compile(r"parameter/(?!\.{1,2}$)[^/]+")

# Quantities of steps, each component of its own, and their SI units: in the order of the columns.
QUANTITIES = {quantity + suffix: unit for _, _, quantity, unit, _, kind, tangential, _ in COLUMNS if kind != "Node"
              for suffix in ("", "_second")[:1 + tangential]}
INPUTS = [quantity + suffix for _, _, quantity, _, _, kind, tangential, _ in COLUMNS if kind in ("Input", "Stick")
          for suffix in ("", "_second")[:1 + tangential]]
JUMPS = ("initial_velocity_jump", "initial_velocity_jump_second")
_OTHERS = {"time": "s", "dt": "s", "node": "", "node_id": "", "pair": "", "initial_temperature": "K", **dict.fromkeys(JUMPS, "m/s")}
_UNIT = {**QUANTITIES, **_OTHERS}
READ = [*_OTHERS, *INPUTS]  # names that a replay reads


def unit_of(name):
    """Returns the SI unit of a quantity, "" for one without a unit, None if no history has a quantity of this name."""
    return "" if PARAMETER.fullmatch(name) else _UNIT.get(name)


def is_per_node(name):
    """Whether a quantity has one value per node that does not change in time."""
    return name in ("mass_soft", "mass_hard", "initial_temperature", *JUMPS) or name.startswith("parameter/")


def _normal(unit):
    """Returns a unit as its parts with powers, in alphabetical order: "kg/m2" is "kg m-2"."""
    parts = []
    for strokes, part in re.findall("([ /]*)([^ /]+)", unit.replace("**", "").translate(SPELLINGS)):
        part = UNIT_WORDS.get(part, part)
        if part != "1" and "/" in strokes:  # only the part behind the stroke is below it, as everybody reads "Pa s/m"
            name, power = re.match("([^0-9]*)(.*)", part).groups()
            part = f"{name}-{power or 1}"
        parts += [part] * (part != "1")
    return " ".join(sorted(parts))


def factor_to_si(unit, si):
    """Returns the factor from a unit, in any usual spelling, to an SI unit; None for one that is unknown or of another
    quantity."""
    return {_normal(si): 1.0, **{_normal(name): factor for name, of, factor in UNITS if of == si}}.get(_normal(unit[:65]))


def known_units(si):
    return ", ".join(name for name, of, _ in UNITS if of == si)
