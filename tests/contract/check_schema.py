#!/usr/bin/python3
"""Checks shearbus/v1/*.proto against the agreed schema: compared with the descriptors in tests/golden no message, field, enum or enum value
may be removed, renumbered, retyped, or moved in or out of a oneof. Additions are allowed.

check_schema.py --protos DIR --golden FILE [--update]   compares; --update stores the present schema as the agreed one
check_schema.py --protos DIR --self-test                shows that each rule fails on a schema changed for it"""
import argparse
import pathlib
import subprocess
import sys
import tempfile

from google.protobuf import descriptor_pb2


def compile_protos(protoc, protos, target):
    files = sorted(str(p) for p in (protos / "shearbus/v1").glob("*.proto"))
    subprocess.run([protoc, f"-I{protos}", f"--descriptor_set_out={target}", *files], check=True)
    return descriptor_pb2.FileDescriptorSet.FromString(target.read_bytes())


def flatten(schema):
    """Returns ("field", message, name) -> all properties that bytes or callers depend on, and the same for enum values."""
    parts = {}

    def enum(scope, e):
        parts["enum", f"{scope}.{e.name}"] = True
        for value in e.value:
            parts["value", f"{scope}.{e.name}", value.name] = value.number

    def message(scope, m):
        name = f"{scope}.{m.name}"
        parts["message", name] = True
        for f in m.field:
            oneof = m.oneof_decl[f.oneof_index].name if f.HasField("oneof_index") and not f.proto3_optional else None
            parts["field", name, f.name] = dict(number=f.number, type=f.type, type_name=f.type_name, label=f.label,
                                                presence=f.proto3_optional, oneof=oneof, packed=f.options.packed)
        for e in m.enum_type:
            enum(name, e)
        for nested in m.nested_type:
            message(name, nested)

    for file in schema.file:
        for m in file.message_type:
            message(file.package, m)
        for e in file.enum_type:
            enum(file.package, e)
        for x in file.extension:
            parts["extension", x.extendee, x.name] = dict(number=x.number, type=x.type, type_name=x.type_name)
    return parts


def faults(agreed, present):
    then, now = flatten(agreed), flatten(present)
    for key, what in sorted(then.items(), key=str):
        if key not in now:
            yield f"{' '.join(key)} is gone: within a major version nothing is removed or renamed"
        elif now[key] != what:
            yield f"{' '.join(key)} was {what} and is now {now[key]}"


def self_test(present):
    def changed(change):
        other = descriptor_pb2.FileDescriptorSet.FromString(present.SerializeToString())
        messages = {m.name: m for f in other.file for m in f.message_type}
        enums = {e.name: e for f in other.file for e in f.enum_type}
        change(messages, enums)
        return list(faults(present, other))

    def field(messages, message, name):
        return next(f for f in messages[message].field if f.name == name)

    damages = {
        "renumbered field": lambda m, e: setattr(field(m, "Downscale", "dt_s"), "number", 90),
        "retyped field": lambda m, e: setattr(field(m, "Layer", "cells"), "type", 1),
        "renamed field": lambda m, e: setattr(field(m, "Layer", "cells"), "name", "zones"),
        "removed field": lambda m, e: m["Column"].field.pop(),
        "field made repeated": lambda m, e: setattr(field(m, "Hello", "client_name"), "label", 3),
        "presence lost": lambda m, e: setattr(field(m, "Layer", "grading"), "proto3_optional", False),
        "moved out of the oneof": lambda m, e: field(m, "RequestHeader", "commit").ClearField("oneof_index"),
        "removed enum value": lambda m, e: e["Code"].value.pop(),
        "renumbered enum value": lambda m, e: setattr(e["Field"].value[3], "number", 77),
        "renamed enum value": lambda m, e: setattr(e["Regime"].value[1], "name", "REGIME_STUCK"),
        "renamed message": lambda m, e: setattr(m["Commit"], "name", "Accept"),
    }
    silent = [name for name, damage in damages.items() if not changed(damage)]
    additions = {
        "new field": lambda m, e: m["Downscale"].field.add(name="later", number=99, type=1, label=1),
        "new enum value": lambda m, e: e["Code"].value.add(name="CODE_LATER", number=499),
    }
    silent += [f"{name} (is free)" for name, addition in additions.items() if changed(addition)]
    if silent:
        sys.exit("rules that do not hold: " + ", ".join(silent))
    print(f"{len(damages)} damages seen, {len(additions)} additions let pass")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--protos", required=True, type=pathlib.Path)
    parser.add_argument("--protoc", default="protoc")
    parser.add_argument("--golden", type=pathlib.Path)
    parser.add_argument("--update", action="store_true")
    parser.add_argument("--self-test", action="store_true")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as directory:
        present = compile_protos(options.protoc, options.protos, pathlib.Path(directory, "v1.bin"))
    if options.self_test:
        return self_test(present)
    if options.update:
        options.golden.write_bytes(present.SerializeToString())
    found = list(faults(descriptor_pb2.FileDescriptorSet.FromString(options.golden.read_bytes()), present))
    if found:
        sys.exit("the schema breaks protocol 1:\n  " + "\n  ".join(found))
    print(f"{len(flatten(present))} parts of the schema are as agreed, or new")


if __name__ == "__main__":
    main()
