"""docs/render.md and docs/igi.md name every field of a scene, and no other; and of a render job none that is not."""

from __future__ import annotations

import re
from pathlib import Path
from typing import get_args

from pydantic import BaseModel

from lightwell.job_settings import IgiRenderSettings
from lightwell.scene_settings import SceneSettings

DOCS = Path(__file__).parents[2] / "docs"
SCENES = (DOCS / "render.md").read_text("utf-8")
PICTURES, JOB, AFTER = re.split(
    r"^## As a job\n|^## The filters", (DOCS / "igi.md").read_text("utf-8"), flags=re.MULTILINE
)


def fields(settings: type[BaseModel]) -> set[str]:
    names = set()
    for name, field in settings.model_fields.items():
        models = [kind for kind in (field.annotation, *get_args(field.annotation)) if isinstance(kind, type)]
        inner = next((kind for kind in models if issubclass(kind, BaseModel)), None)
        names |= {name} if inner is None else {f"{name}.{part}" for part in inner.model_fields}
    return names


def named_in(text: str) -> set[str]:
    """Return the fields that the first cells of its tables name; a table's name holds for the rest of its cell."""
    named = set()
    for row in re.findall(r"^\| (`.*?) \|", text, flags=re.MULTILINE):
        table = ""
        for name in re.findall(r"`([a-z_.]+)`", row):
            table = name.rpartition(".")[0] or table
            named.add(name if "." in name or not table else f"{table}.{name}")
    return named


def test_every_field_of_a_scene_is_documented() -> None:
    assert named_in(SCENES + PICTURES + AFTER) == fields(SceneSettings)


def test_what_is_documented_of_the_job_exists() -> None:
    assert named_in(JOB) <= fields(IgiRenderSettings)
