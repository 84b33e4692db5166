#!/usr/bin/python3
"""Runs every command of a page as printed: the fenced blocks tagged sh or console, in their order, in one shell for each page.

commands.py --build BUILD [--source ROOT] [PAGE...]     pages relative to ROOT; without pages all that have such a block
commands.py --self-test

The shell stands in a copy of the tree, in which build/ is the given build directory; build/bin is on PATH. A page says in comments before
a block, which readers do not see:

    <!-- norun: REASON -->     the block is not run
    <!-- prints: TEXT -->      the block prints this; repeatable
    <!-- prepare: COMMAND -->  is run before the block, for what a reader has already, such as a scene of the reader's own
    <!-- file: NAME -->        the block, of any language, is the contents of a file
    <!-- input: COMMAND -->    the block, of any language, is the standard input of this command

A block of sh without a comment must run. A block that has a command and no tag, indented or fenced, is a fault; so is a page without a block that
is named."""
import argparse
import os
import pathlib
import re
import shutil
import signal
import subprocess
import sys
import tempfile

COPIED = ("README.md", "client", "hydro_stub", "deploy", "proto", "server")  # commands may write next to these files
BLOCK = re.compile(r"^((?:<!-- .*? -->\n)*)(```+)([^\n`]*)\n(.*?)^\2[ \t]*$", re.M | re.S)
COMMENT = re.compile(r"<!-- (norun|prints|prepare|file|input): (.*?) -->")
KINDS = ("sh", "console", "bash", "shell")
TIMEOUT_S = 120
# A line of a block without a tag that a reader would type: a program with arguments that are no part of a synopsis.
TYPED = re.compile(r"^(?:\$ |sudo |apt-get |cmake |ctest |build/bin/|deploy/|/usr/bin/python3 |shearbus-[a-z]+ )(?!.*(?:\[|\||[A-Z]{3,}|\.\.\.)).*$", re.M)
INDENTED = re.compile(r"(?:^|\n\n)((?: {4}.*\n)+)")


def untagged_commands(page):
    """Returns the faults of blocks with commands that no tag makes a reader, or this program, see as commands."""
    found = [(line, contents) for line, kind, comments, contents in blocks(page) if kind in ("", "text") and "norun" not in comments]
    plain = re.sub(BLOCK, lambda fence: "\n" * fence[0].count("\n"), page)
    found += [(plain[: match.start(1)].count("\n") + 1, re.sub("^ {4}", "", match[1], flags=re.M)) for match in INDENTED.finditer(plain)]
    return [f"line {line}: {typed[0]!r} is a command in a block that is not tagged sh" for line, text in found if (typed := TYPED.search(text))]


def pages_with_commands(root):
    """Returns the pages of the tree that have a block to run, or a command in a block without a tag."""
    pages = sorted(p for house in (*COPIED, "tests", ".github") for p in ([root / house] if (root / house).is_file() else (root / house).rglob("*.md")))
    return [p.relative_to(root).as_posix() for p in pages
            if untagged_commands(p.read_text()) or any(kind in KINDS or "input" in comments for _, kind, comments, _ in blocks(p.read_text()))]


def console(text):
    """Returns the commands of a console block: the lines behind "$ "."""
    return "".join(line[2:] + "\n" for line in text.splitlines() if line.startswith("$ "))


def blocks(page):
    """Yields (line, kind, comments as {word: [text]}, contents) of each fenced block of a page."""
    for match in BLOCK.finditer(page):
        comments = {}
        for word, text in COMMENT.findall(match[1]):
            comments.setdefault(word, []).append(text)
        kind = match[3].split(" ")[0]
        yield page[: match.start(2)].count("\n") + 1, kind, comments, console(match[4]) if kind == "console" else match[4]


def run_page(text, directory, environment):
    """Returns (faults, number of blocks that were run, [(line, reason)] of those that were not)."""
    if untagged := untagged_commands(text):
        return untagged, 0, []
    script, expected, skipped = ["set -euo pipefail"], {}, []
    for line, kind, comments, contents in blocks(text):
        if "norun" in comments:
            if not comments["norun"][0].strip():
                return [f"line {line}: norun needs a reason"], 0, []
            skipped.append((line, comments["norun"][0]))
        elif "file" in comments:
            path = directory / comments["file"][0]
            script.append(f"mkdir -p {path.parent}; cat > {path} <<'END_OF_FILE_OF_PAGE'\n{contents}END_OF_FILE_OF_PAGE")
        elif kind in KINDS or "input" in comments:
            expected[line] = comments.get("prints", [])
            command = f"{{ {comments['input'][0]}; }} <<'END_OF_BLOCK_OF_PAGE'\n{contents}END_OF_BLOCK_OF_PAGE" if "input" in comments else contents.rstrip("\n")
            script += [f"echo '@@ {line}'", *comments.get("prepare", []), command]
        elif comments.get("prints") or comments.get("prepare"):
            return [f"line {line}: a block of {kind or 'no kind'} is not run, and has a comment for one that is"], 0, []
    script.append("echo '@@ end'")
    with tempfile.TemporaryFile("w+", errors="replace") as log:  # no pipe: what the page leaves running would hold it open
        shell = subprocess.Popen(["bash", "-c", "\n".join(script)], cwd=directory, env=environment, stdin=subprocess.DEVNULL, stdout=log,
                                 stderr=subprocess.STDOUT, start_new_session=True)
        timed_out = False
        try:
            shell.wait(timeout=TIMEOUT_S)
        except subprocess.TimeoutExpired:
            timed_out = True
        try:
            os.killpg(shell.pid, signal.SIGKILL)
        except ProcessLookupError:
            pass
        shell.wait()
        log.seek(0)
        output = log.read()
    parts = re.split(r"^@@ (\d+|end)\n", output, flags=re.M)
    printed = dict(zip(parts[1::2], parts[2::2]))
    last = parts[-2] if len(parts) > 1 else "0"
    if last != "end" or shell.returncode != 0:
        why = f"no end after {TIMEOUT_S} s" if timed_out else f"exit code {shell.returncode}"
        return [f"line {last}: {why}:\n{printed.get(last, output)[-2000:]}"], len(expected), skipped
    return [f"line {line}: expected {text!r} in what is printed:\n{printed[str(line)][-2000:]}"
            for line, texts in expected.items() for text in texts if text not in printed[str(line)]], len(expected), skipped


def self_test(directory):
    """Checks that a page whose commands fail, print something else, hang on to a process or lack a reason is noticed."""
    environment = {**os.environ}
    cases = {  # page -> number of faults
        "```sh\ntrue\n```\n\n<!-- prints: two -->\n```sh\necho one two\n```\n": 0,
        "<!-- file: a.txt -->\n```text\nhello\n```\n<!-- prints: hello -->\n```sh\ncat a.txt\n```\n": 0,
        "```sh\nfalse\n```\n": 1,
        "```sh\nfalse | true\n```\n": 1,
        "<!-- prints: two -->\n```sh\necho one\n```\n": 1,
        "<!-- norun: elsewhere -->\n```sh\nfalse\n```\n": 0,
        "<!-- prints: one -->\n```c\nint one;\n```\n": 1,
        "```console\n$ test 1 = 2\nno\n```\n": 1,
        "```console\n$ echo one\none\n```\n": 0,
        "```sh\nexit 0\n```\n```sh\nfalse\n```\n": 1,
        "<!-- input: tr a-z A-Z -->\n<!-- prints: HOST -->\n```python\nhost\n```\n": 0,
        "<!-- input: cat | tr a-z A-Z -->\n<!-- prints: HOST -->\n```python\nhost\n```\n": 0,
        "<!-- input: false -->\n```python\nhost\n```\n": 1,
        "```sh\nsleep 600 & echo $!\n```\n": 0,
        "Run it:\n\n    deploy/run scene.toml\n": 1,
        "```\nshearbus-hydro scene.toml\n```\n": 1,
        "```text\n$ true\n```\n": 1,
        "Usage:\n\n    shearbus-hydro SCENE.toml [--out DIR]\n": 0,
    }
    return [f"self-test: {found} where {expected} fault was expected:\n{page}" for page, expected in cases.items()
            if len(found := run_page(page, directory, environment)[0]) != expected]


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--build", type=pathlib.Path)
    parser.add_argument("--source", type=pathlib.Path, default=pathlib.Path(__file__).resolve().parents[2])
    parser.add_argument("--self-test", action="store_true")
    parser.add_argument("pages", nargs="*")
    options = parser.parse_args()
    failed = []
    if options.self_test:
        with tempfile.TemporaryDirectory(prefix="shearbus-") as scratch:
            failed = self_test(pathlib.Path(scratch))
        print("\n".join(failed) or "pages with wrong commands are noticed")
        sys.exit(bool(failed))
    build, source = options.build.resolve(), options.source.resolve()
    for page in options.pages or pages_with_commands(source):
        with tempfile.TemporaryDirectory(prefix="shearbus-") as scratch:  # short, for the sockets
            directory = pathlib.Path(scratch)
            for name in COPIED:
                if (source / name).is_dir():
                    shutil.copytree(source / name, directory / name, symlinks=True, ignore=shutil.ignore_patterns("__pycache__"))
                else:
                    shutil.copy(source / name, directory / name)
            (directory / "tests").symlink_to(source / "tests")
            (directory / "build").symlink_to(build)
            (directory / "scratch").mkdir(mode=0o700)
            environment = {**os.environ, "PATH": f"{build / 'bin'}:{os.environ['PATH']}", "SCRATCH": str(directory / "scratch"),
                           "PYTHONDONTWRITEBYTECODE": "1", "MPLCONFIGDIR": str(directory / "scratch")}
            faults, count, skipped = run_page((source / page).read_text(), directory, environment)
        print(f"{page}: {count} blocks were run, {len(skipped)} were not")
        print("".join(f"  line {line} is not run: {reason}\n" for line, reason in skipped), end="", flush=True)
        failed += [f"{page}: {fault}" for fault in faults]
    print("\n".join(failed))
    sys.exit(bool(failed))


if __name__ == "__main__":
    main()
