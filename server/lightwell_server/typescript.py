"""Generates ``client/src/wire.ts``, the browser's message types, from `lightwell.wire`.

``python -m lightwell_server.typescript`` writes the file, ``--check`` only says whether it is fresh (exit status 1 if
not). Structs become interfaces, docstrings become comments. Bytes become ``Uint8Array``; 64-bit integers become
``number``, which holds nanoseconds since the epoch to 256 ns.
"""

from __future__ import annotations

import argparse
import ast
import inspect
import json
import sys
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any, get_args

import msgspec
from msgspec import inspect as schema

from lightwell import wire
from lightwell.conventions import CONVENTIONS

HEADER = "// Generated from core/lightwell/wire.py by `python -m lightwell_server.typescript`. Do not edit.\n"

CONSTANTS = ("SUBPROTOCOL", "HEARTBEAT_SECONDS")
CONSTANT_PREFIX = "CLOSE_"

UNIONS = {
    "LiveMessage": ("What a subscriber may receive.", get_args(wire.LiveMessage)),
    "FieldMessage": ("What a field's socket may receive.", get_args(wire.FieldMessage)),
}
RECEIVED: tuple[type[msgspec.Struct], ...] = tuple(
    dict.fromkeys(struct for _, structs in UNIONS.values() for struct in structs)
)
SENT: tuple[type[msgspec.Struct], ...] = (wire.Subscribe,)


def target() -> Path:
    """Return the path of ``client/src/wire.ts`` in a checkout; raises ``FileNotFoundError`` outside of one."""
    source = Path(__file__).resolve().parents[2] / "client" / "src"
    if not source.is_dir():
        raise FileNotFoundError(f"{source} is missing: wire.ts is generated in a checkout, not in an installed package")
    return source / "wire.ts"


def generate() -> str:
    """Return the text of ``wire.ts``."""
    return "\n".join([HEADER, *_constants(), "", *_aliases(), *_interfaces(), *_unions()])


def _constants() -> Iterator[str]:
    names = [*CONSTANTS, *(name for name in vars(wire) if name.startswith(CONSTANT_PREFIX))]
    for name in names:
        yield f"export const {name} = {json.dumps(getattr(wire, name))};"


def _aliases() -> Iterator[str]:
    yield f"export type Convention = {_literals(CONVENTIONS)};\n"


def _interfaces() -> Iterator[str]:
    documented = _documentation()
    for struct in _reachable((*RECEIVED, *SENT)):
        info = schema.type_info(struct)
        assert isinstance(info, schema.StructType)
        comment, field_comments = documented[struct.__name__]
        yield _comment(comment, "")
        yield f"export interface {struct.__name__} {{"
        if info.tag is not None:
            yield f"  type: {json.dumps(info.tag)};"
        for field in info.fields:
            if field.encode_name in field_comments:
                yield _comment(field_comments[field.encode_name], "  ")
            # A sender may leave out what has a default; what we receive is always complete.
            mark = "?" if struct in SENT and not field.required else ""
            yield f"  {field.encode_name}{mark}: {_type(field.type)};"
        yield "}\n"


def _unions() -> Iterator[str]:
    for name, (comment, structs) in UNIONS.items():
        yield _comment(comment, "")
        yield f"export type {name} = {' | '.join(struct.__name__ for struct in structs)};\n"


def _reachable(roots: Iterable[type[msgspec.Struct]]) -> list[type[msgspec.Struct]]:
    """Return the structs that the roots mention, each after those that it needs."""
    ordered: list[type[msgspec.Struct]] = []

    def visit(node: schema.Type) -> None:
        match node:
            case schema.StructType():
                for field in node.fields:
                    visit(field.type)
                if node.cls not in ordered:
                    ordered.append(node.cls)
            case schema.UnionType():
                for member in node.types:
                    visit(member)
            case schema.ListType():
                visit(node.item_type)
            case schema.DictType():
                visit(node.value_type)
            case schema.Metadata():
                visit(node.type)

    for root in roots:
        visit(schema.type_info(root))
    return ordered


def _type(node: schema.Type) -> str:
    """Return the TypeScript type of a msgspec type; raises ``TypeError`` for one that the wire does not use yet."""
    match node:
        case schema.Metadata():
            return _type(node.type)
        case schema.StructType():
            return node.cls.__name__
        case schema.LiteralType():
            return "Convention" if set(node.values) == set(CONVENTIONS) else _literals(node.values)
        case schema.StrType():
            return "string"
        case schema.BoolType():
            return "boolean"
        case schema.IntType() | schema.FloatType():
            return "number"
        case schema.BytesType():
            return "Uint8Array"
        case schema.NoneType():
            return "null"
        case schema.ListType():
            return f"{_type(node.item_type)}[]"
        case schema.TupleType():
            return f"[{', '.join(_type(item) for item in node.item_types)}]"
        case schema.DictType():
            return f"Record<{_type(node.key_type)}, {_type(node.value_type)}>"
        case schema.UnionType():
            return " | ".join(_type(member) for member in node.types)
    raise TypeError(f"no TypeScript type is known for {node}")


def _literals(values: Iterable[Any]) -> str:
    return " | ".join(json.dumps(value) for value in values)


def _documentation() -> dict[str, tuple[str, dict[str, str]]]:
    """Return for each class of the wire module its docstring and the strings that stand below its fields."""
    documented = {}
    for node in ast.parse(inspect.getsource(wire)).body:
        if isinstance(node, ast.ClassDef):
            fields: dict[str, str] = {}
            for before, after in zip(node.body, node.body[1:], strict=False):
                if (
                    isinstance(before, ast.AnnAssign)
                    and isinstance(before.target, ast.Name)
                    and isinstance(after, ast.Expr)
                    and isinstance(after.value, ast.Constant)
                ):
                    fields[before.target.id] = inspect.cleandoc(str(after.value.value))
            documented[node.name] = (ast.get_docstring(node) or "", fields)
    return documented


def _comment(text: str, indent: str) -> str:
    lines = text.replace("``", "`").splitlines()
    if len(lines) == 1:
        return f"{indent}/** {lines[0]} */"
    body = "\n".join(f"{indent} * {line}".rstrip() for line in lines)
    return f"{indent}/**\n{body}\n{indent} */"


def main(arguments: list[str] | None = None) -> int:
    """Write or check the file; returns the exit status."""
    parser = argparse.ArgumentParser(prog="python -m lightwell_server.typescript", description=__doc__)
    parser.add_argument("--check", action="store_true", help="only say whether the file is fresh")
    check: bool = parser.parse_args(arguments).check
    path = target()
    text = generate()
    fresh = path.is_file() and path.read_text(encoding="utf-8") == text
    if check and not fresh:
        sys.stderr.write(f"{path} is out of date: run python -m lightwell_server.typescript\n")
        return 1
    if not fresh:
        partial = path.with_suffix(".part")
        partial.write_text(text, encoding="utf-8")
        partial.replace(path)
    return 0


if __name__ == "__main__":
    sys.exit(main())
