"""docs/render.md and docs/igi.md name every field of a scene, and no other."""

from __future__ import annotations

import re
from pathlib import Path
from typing import get_args

from pydantic import BaseModel

from lightwell.scene_settings import SceneSettings

DOCS = [Path(__file__).parents[2] / "docs" / name for name in ("render.md", "igi.md")]


def fields() -> set[str]:
    names = set()
    for name, field in SceneSettings.model_fields.items():
        models = [kind for kind in (field.annotation, *get_args(field.annotation)) if isinstance(kind, type)]
        inner = next((kind for kind in models if issubclass(kind, BaseModel)), None)
        names |= {name} if inner is None else {f"{name}.{part}" for part in inner.model_fields}
    return names


def test_every_field_is_documented() -> None:
    named = set()
    rows = [row for path in DOCS for row in re.findall(r"^\| (`.*?) \|", path.read_text("utf-8"), flags=re.MULTILINE)]
    for row in rows:
        table = ""
        for name in re.findall(r"`([a-z_.]+)`", row):
            table = name.rpartition(".")[0] or table
            named.add(name if "." in name or not table else f"{table}.{name}")
    assert named == fields()
