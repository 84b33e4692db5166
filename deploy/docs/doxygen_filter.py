#!/usr/bin/python3
"""Prints a header with its comments as comments of Doxygen, which the headers themselves do not need: doxygen_filter.py HEADER.

A comment on lines of its own belongs to the declaration below it, a comment behind code to the code before it. Blocks of code in a comment
are its lines that are indented. A comment that an empty line follows belongs to the file."""
import pathlib
import re
import sys

# Strings first: what looks like a comment in a text is none.
TOKEN = re.compile(r'"(?:\\.|[^"\\\n])*"|\'(?:\\.|[^\'\\\n])*\'|/\*.*?\*/|(?:[ \t]*//[^\n]*\n?)+', re.S)


def words(comment):
    """Returns the lines of a comment without its marks."""
    if comment.startswith("/*"):
        return [re.sub(r"^\s*\* ?", "", line) for line in comment[2:-2].strip(" ").split("\n")]
    return [re.sub(r"^\s*// ?", "", line) for line in comment.rstrip("\n").split("\n")]


def documented(lines):
    """Returns the lines with indented ones as code and special characters as text."""
    text, code = [], False
    for line in lines:
        is_code = line.startswith("  ") and bool(text)
        if line.strip() and is_code != code:
            text.append("@code{.unparsed}" if is_code else "@endcode")
            code = is_code
        text.append(line if code else re.sub(r"`(\w+)`", r"@c \1", re.sub(r"([\\@<>&#%])", r"\\\1", line).replace("file://", "%file://")))
    return text + ["@endcode"] * code


def filtered(source):
    at, out = 0, []
    for token in TOKEN.finditer(source):
        comment, before = token[0], source[:token.start()].rpartition("\n")[2]
        out.append(source[at : token.start()])
        at = token.end()
        if not comment.lstrip().startswith(("/*", "//")):
            out.append(comment)
            continue
        ending = "\n" if comment.endswith("\n") else ""
        lines = words(comment.strip(" \t") if comment.lstrip().startswith("/*") else comment)
        if re.match(r"-{3,}", lines[0]):  # the heading of a part of the file
            out.append(ending)
        elif before.strip():
            trailing, below = (lines[:1], lines[1:]) if comment.lstrip().startswith("//") and len(lines) > 1 else (lines, [])
            # A line of // below a comment behind code goes on with it only where it is as far to the right.
            columns = [len(part) - len(part.lstrip()) for part in comment.split("\n")]
            if below and columns[1] >= len(before):
                trailing, below = lines, []
            out.append(" /**< " + "\n".join(documented(trailing)) + " */" + ending)
            if below:
                out.append("/** " + "\n".join(documented(below)) + " */\n")
        else:
            is_of_file = not source[: token.start()].strip()
            out.append("/** " + ("@file\n" if is_of_file else "") + "\n".join(documented(lines)) + " */" + ending)
    return "".join(out) + source[at:]


if __name__ == "__main__":
    sys.stdout.write(filtered(pathlib.Path(sys.argv[1]).read_text()))
