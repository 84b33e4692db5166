"""Numbers of a scene's text, by keys with their table, such as interface.friction_coefficient."""
import re
import tomllib


def value_of(text, key):
    """Returns the value of a key, None where the scene has none."""
    found = tomllib.loads(text)
    for name in key.split("."):
        found = found.get(name) if isinstance(found, dict) else None
    return found


def with_value(text, key, value):
    """Returns the text of a scene in which a key has a number, at its place where the text has it."""
    table, _, name = key.rpartition(".")
    lines, at, begin = text.splitlines(), None, 0 if not table else None
    current = ""
    for i, line in enumerate(lines):
        if header := re.match(r"\s*\[\s*([\w.]+)\s*\]", line):
            current = header[1]
            begin = i + 1 if current == table else begin
        elif current == table and re.match(rf"\s*{re.escape(name)}\s*=", line):
            at = i
    row = f"{name} = {value!r}"
    if at is not None:
        lines[at] = row
    elif begin is not None:
        lines.insert(begin, row)
    else:
        lines += ["", f"[{table}]", row]
    return "\n".join(lines) + "\n"
