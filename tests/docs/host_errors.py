#!/usr/bin/python3
"""Holds the page of errors for authors of hosts (deploy/docs/pages/howto/host_errors.toml) to the sources: each message on it is one that the
code prints, each code on it exists, each diagnosis has a row, and no message of the client library names an identifier of C++, which most of
its callers do not have.

host_errors.py --source ROOT [--self-test]"""
import argparse
import pathlib
import re
import sys
import tomllib

PAGE = "deploy/docs/pages/howto/host_errors.toml"
PRINTS = ("client/src", "server/service", "server/session", "server/physics/solver", "proto/scene", "proto/wire")
EVERY_TEXT = {"client/src/diagnosis.cpp": 12, "client/src/input_check.cpp": 70}  # file: length from which a text has a row
IDENTIFIER = re.compile(r"\w\(\)|::|\bk[A-Z]\w+")
LITERAL = r'"(?:[^"\\\n]|\\.)*"'
CHARACTER = r"(?<![\w])'(?:[^'\\\n]|\\.[^'\n]*)'"  # not the ' of 1'000


def literals(text):
    """Returns the string literals of a source: adjacent ones as one, with a NUL for each {} of a format."""
    text = re.sub(r"^\s*#.*$|(?<![\"':])//.*$", "", text, flags=re.M)
    text = re.sub(rf"({LITERAL})|{CHARACTER}", lambda found: found[1] or "' '", text)
    found = []
    for run in re.finditer(rf"{LITERAL}(?:\s*{LITERAL})*", text):
        joined = "".join(part[1:-1] for part in re.findall(LITERAL, run[0]))
        found.append(re.sub(r"\{[^{}]*\}", "\0", joined.replace('\\"', '"').replace("\\\\", "\\")))
    return found


def pattern(message):
    """Returns the pattern of a message of the page, whose "..." stands for anything."""
    return re.compile(".*?".join(re.escape(part) for part in message.split("...")), re.S)


def faults(page, sources, codes):
    """Yields what is wrong. sources: {file: text}; codes: {(name, number)}."""
    printed = [text for source in sources.values() for text in literals(source)]
    rows = [dict(zip(part["head"], row)) for part in tomllib.loads(page)["part"] for row in part["rows"]]
    messages = [message for row in rows for message in re.findall(r"`([^`]+)`", row["as printed"])]
    for message in messages:
        if not any(pattern(message).search(text) for text in printed):
            yield f"`{message}` is printed by nothing"
    rows_of_codes = {(name, int(number)) for row in rows for name, number in re.findall(r"^([A-Z_]+) \((\d+)\)$", row.get("code", ""))}
    yield from (f"{name} ({number}) is no code" for name, number in sorted(rows_of_codes - codes))
    for file, length in EVERY_TEXT.items():
        for text in literals(sources[file]):
            if len(text) >= length and not any(pattern(message).search(text) for message in messages):
                yield f"{file}: \"{text}\" has no row".replace("\0", "{}")
    for file, source in sources.items():
        for text in literals(source) if file.startswith("client/src") else ():
            if IDENTIFIER.search(text):
                yield f"{file}: \"{text}\" names an identifier of C++".replace("\0", "{}")


def codes_of(root):
    header = (root / "client/include/shearbus/shearbus.h").read_text().split("---- codes ----", 1)[1].split("};", 1)[0]
    return {(name, int(n)) for name, n in re.findall(r"SHEARBUS_([A-Z_]+) = (\d{3})\b", header)}


def self_test(page, sources, codes):
    """Yields the rules that notice nothing."""
    wrong = {
        "a message that nothing prints": (page.replace("stress_soft has the wrong sign", "stress_soft has a bad sign", 1), sources, codes),
        "a row without a code": (page, sources, codes - {("SHAPE", 105)}),
        "a diagnosis without a row": (page, sources | {"client/src/diagnosis.cpp": sources["client/src/diagnosis.cpp"] + 'x = "the moon is full";'}, codes),
        "an identifier": (page, sources | {"client/src/new.cpp": 'refuse("Set ClientOptions::context");'}, codes),
        "an identifier after a quotation mark": (page, sources | {"client/src/new.cpp": """put('"'); refuse("Set ClientOptions::context");"""}, codes),
    }
    yield from (f"{name} was not noticed" for name, case in wrong.items() if not list(faults(*case)))


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--source", type=pathlib.Path, required=True)
    parser.add_argument("--self-test", action="store_true")
    options = parser.parse_args()
    root = options.source
    sources = {path.relative_to(root).as_posix(): path.read_text() for room in PRINTS for path in sorted((root / room).rglob("*.[ch]pp"))}
    case = (root / PAGE).read_text(), sources, codes_of(root)
    found = list(self_test(*case) if options.self_test else faults(*case))
    print("\n".join(found) if found else "the rules can fail" if options.self_test else "the page and the code agree")
    return bool(found)


if __name__ == "__main__":
    sys.exit(main())
