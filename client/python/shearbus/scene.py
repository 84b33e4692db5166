"""A scene as a dict: edited, and written as the TOML text that the server reads."""
import collections.abc
import copy
import json
import os
import pathlib
import tomllib

import numpy

from ._values import text
from .errors import Code, ContentError

__all__ = ["Scene", "toml_of"]


def _value(key, value):
    if isinstance(value, numpy.generic) or (isinstance(value, numpy.ndarray) and value.ndim == 0):
        value = value.item()
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, (int, float)):
        return repr(value)
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    if isinstance(value, (list, tuple, numpy.ndarray)):
        return f"[{', '.join(_value(key, item) for item in value)}]"
    raise ContentError(Code.INVALID_SCENE, f"{key} has the type {type(value).__name__}, which TOML does not have",
                       "Use numbers, texts, bools, lists and dicts.", key)


def toml_of(scene, path=""):
    """Returns the TOML text of nested dicts: values first, then tables."""
    lines = [
        f"{_value('', str(key))} = {_value(path + str(key), value)}" for key, value in scene.items()
        if not isinstance(value, dict)
    ]
    for key, value in scene.items():
        if isinstance(value, dict):
            table = f"{path}{_value('', str(key))}"
            lines += [f"[{table}]", toml_of(value, table + ".")]
    return "\n".join(lines) + "\n"


def scene_of(scene):
    """Returns the members of shearbus_options that give a scene."""
    if isinstance(scene, dict):
        return {"scene_text": toml_of(scene).encode()}
    if isinstance(scene, str) and "\n" in scene:
        return {"scene_text": text("scene", scene)}
    if not isinstance(scene, (str, os.PathLike)):
        raise ContentError(Code.INVALID_SCENE,
                           f"the scene is {type(scene).__name__}, expected a path, TOML text or a dict",
                           field="scene")
    return {"scene_file": text("scene", scene, path=True)}


class Scene(collections.abc.MutableMapping, dict):
    """A scene to be edited, as nested dicts; for all methods a key with dots names a value in a table:
    scene["interface.friction_coefficient"] = 0.2. shearbus.open() takes it as it takes any dict.

    scene: path of a TOML file, TOML text (anything with a line break), or a dict. Raises tomllib.TOMLDecodeError or
    OSError; what the keys mean is checked by the server when the scene is opened."""

    def __init__(self, scene):
        if not isinstance(scene, dict):
            text = scene if isinstance(scene, str) and "\n" in scene else pathlib.Path(scene).read_text()
            scene = tomllib.loads(text)
        super().__init__(copy.deepcopy(dict(scene)))

    def _table(self, key, make):
        *tables, last = key.split(".")
        at = self
        for table in tables:
            at = dict.setdefault(at, table, {}) if make else dict.__getitem__(at, table)
            if not isinstance(at, dict):
                raise KeyError(f"{key}: {table} is a value, no table")
        return at, last

    __iter__, __len__ = dict.__iter__, dict.__len__

    def __delitem__(self, key):
        table, last = self._table(key, False)
        dict.__delitem__(table, last)

    def __getitem__(self, key):
        table, last = self._table(key, False)
        return dict.__getitem__(table, last)

    def __setitem__(self, key, value):
        table, last = self._table(key, True)
        dict.__setitem__(table, last, value)
