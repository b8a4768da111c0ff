from __future__ import annotations

import gzip
import json
import re
from pathlib import Path

import lightwell_client

CLIENT = Path(__file__).parents[2] / "client"
STATIC = Path(lightwell_client.__path__[0], "static")


def test_the_page_is_small() -> None:
    """What the browser needs before it can draw: what the page names; the rest is fetched when it is wanted."""
    page = (STATIC / "index.html").read_text(encoding="utf-8")
    first = [STATIC / path for path in re.findall(r'(?:src|href)="\./(assets/[^"]+\.js)"', page)]
    assert len(first) >= 1
    assert sum(len(gzip.compress(path.read_bytes())) for path in first) < 250_000
    assert (STATIC / "scene.bin").stat().st_size < 1_000_000
    text = "".join(path.read_text(encoding="utf-8") for path in first)
    for later in ("class GLTFLoader", "TransformControlsPlane", "KHR_draco_mesh_compression"):
        assert later not in text, "is fetched only when it is wanted"


def test_the_lock_file_names_no_registry() -> None:
    lock = json.loads((CLIENT / "package-lock.json").read_text(encoding="utf-8"))
    entries = [entry for name, entry in lock["packages"].items() if name]
    assert len(entries) > 20
    assert not any("resolved" in entry for entry in entries)
    assert all(entry["integrity"].startswith("sha512-") for entry in entries)


def test_what_the_page_ships_is_credited() -> None:
    notices = (STATIC / "NOTICES.txt").read_text(encoding="utf-8")
    for name in json.loads((CLIENT / "package.json").read_text(encoding="utf-8"))["dependencies"]:
        credit = {"@fontsource-variable/inter": "Inter", "@preact/signals": "signals"}.get(name, name)
        assert credit.lower() in notices.lower(), name
