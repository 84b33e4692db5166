"""Texts of strangers (names in files, names of files) for a terminal: on one line, without commands to it."""
import re
import sys

# Control characters, separators of lines, and characters that change the direction of the text around them.
COMMANDS = re.compile("[\x00-\x1f\x7f-\x9f\u061c\u200e\u200f\u2028-\u202e\u2066-\u2069\ud800-\udfff]")
NAMES = {"\n": "\\n", "\t": "\\t", "\r": "\\r"}
MOST = 16384  # characters


def printable(text):
    """Returns the text with commands escaped, as \\n or \\x1b; a byte of no character (as of a file's name) as \\xff."""
    def escaped(match):
        code = ord(match[0])
        if 0xDC80 <= code <= 0xDCFF:  # how Python writes an invalid byte
            code -= 0xDC00
        return NAMES.get(match[0]) or (f"\\x{code:02x}" if code < 0x100 else f"\\u{{{code:04x}}}")
    text = COMMANDS.sub(escaped, str(text))
    return text if len(text) <= MOST else text[:MOST - 3] + "..."


def complain(program, fault):
    """Prints what has ended a program to standard error."""
    print(printable(f"{program}: {fault}"), file=sys.stderr)
