#!/usr/bin/python3
"""Tables of shearbus-replay, which runs this program: reads a table of text as a history in HDF5, compares two tables.

    tables.py read TABLE.csv --out HISTORY.h5 (--points | --steps) [--columns ...]
    tables.py compare A B --kind text|hdf5 --kind text|hdf5 --rtol R
"""
import contextlib
import ctypes
import os
import pathlib
import signal
import sys

sys.dont_write_bytecode = True
sys.path.insert(1, str(pathlib.Path(__file__).resolve().parents[1] / "report"))
from terminal import Parser, complain, end_by_signals, real_number, whole_number  # noqa: E402

PROGRAM = "shearbus-replay"


def write(table, path):
    """Writes a table of text as a history (proto/files/recording.md)."""
    import h5py

    dts = {} if table.dts is None else {"dt": table.dts}
    try:
        with h5py.File(path, "w") as file:
            for name, values in {"time": table.times, **dts, "node_id": table.ids, **table.values, **table.texts}.items():
                file[name] = values
            file["time"].attrs["t0"] = table.start
    except (OSError, RuntimeError) as fault:  # a full disk
        raise OSError(f"{table.path}: the history that is made of it does not fit into {pathlib.Path(path).parent}: {fault}. "
                      "Name a directory with room in the environment variable TMPDIR") from fault


def end_with_parent(parent, path):
    """If the program that waits for this one is killed, the file that was to be its input is removed."""
    def remove(*_):
        with contextlib.suppress(OSError):
            os.unlink(path)
        os._exit(1)

    signal.signal(signal.SIGTERM, remove)
    ctypes.CDLL(None).prctl(1, signal.SIGTERM)  # PR_SET_PDEATHSIG
    if os.getppid() != parent:  # it was killed before
        remove()


def run(options):
    from csv_table import CsvTable

    if options.command == "read":
        end_with_parent(options.parent, options.out)
        write(CsvTable(options.table, options.columns, options.points), options.out)
        return 0
    from compare_tables import compare

    equal = compare(options.a, options.b, options.kind, options.rtol)
    sys.stdout.flush()
    return 0 if equal else 1


def main():
    end_by_signals()
    parser = Parser(prog=PROGRAM, description=__doc__)
    commands = parser.add_subparsers(dest="command", required=True)
    read = commands.add_parser("read")
    read.add_argument("table")
    read.add_argument("--out", required=True)
    read.add_argument("--parent", type=whole_number, default=os.getppid())
    read.add_argument("--columns", default="")
    read.add_argument("--points", action="store_true")
    read.add_argument("--steps", action="store_true")
    comparison = commands.add_parser("compare")
    comparison.add_argument("a")
    comparison.add_argument("b")
    comparison.add_argument("--kind", action="append", choices=["text", "hdf5"], required=True)
    comparison.add_argument("--rtol", type=real_number, default=0.0)
    options = parser.parse_args()
    trouble = 2 if options.command == "compare" else 1
    try:
        return run(options)
    except ImportError as fault:
        complain(PROGRAM, f"tables of text and comparisons need python3-numpy and python3-h5py: {fault}. Install them; a history in HDF5 is replayed without")
    except (OSError, ValueError, MemoryError) as fault:
        complain(PROGRAM, fault or "not enough memory for the table")
    return trouble


if __name__ == "__main__":
    code = main()
    sys.exit(code)
