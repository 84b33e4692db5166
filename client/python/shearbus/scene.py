"""A scene as a dict, written as the TOML text that the server reads."""
import json

import numpy

from .errors import Code, ContentError


def _value(key, value):
    if isinstance(value, numpy.generic):
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
