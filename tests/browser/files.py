"""Files that a test drops onto the page, and pictures that are kept of what came of it."""

from __future__ import annotations

import base64
import re
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import trimesh
from playwright.sync_api import Page

from lightwell.geometry.mesh import Mesh
from lightwell.io.exr import write_rgb
from lightwell.io.glb import encode_glb

ARTEFACTS = Path(__file__).parents[2] / ".artefacts"

_HOLD = """files => {
  const transfer = new DataTransfer();
  for (const [name, data] of Object.entries(files)) {
    transfer.items.add(new File([Uint8Array.from(atob(data), letter => letter.charCodeAt(0))], name));
  }
  window.held = transfer;
}"""
_SEND = """types => {
  const target = document.querySelector("canvas");
  for (const type of types) {
    target.dispatchEvent(new DragEvent(type, { dataTransfer: window.held, bubbles: true, cancelable: true }));
  }
}"""


def hold_over(page: Page, files: Mapping[str, bytes]) -> None:
    """Drag files over the page: scripts cannot drag real ones, these events are what a browser would send."""
    # What is painted first takes no files yet: wait until the panel can be opened, and its effects have run.
    page.get_by_role("button", name=re.compile("the panel$")).wait_for()
    page.evaluate("new Promise(done => requestAnimationFrame(() => requestAnimationFrame(done)))")
    page.evaluate(_HOLD, {name: base64.b64encode(data).decode() for name, data in files.items()})
    page.evaluate(_SEND, ["dragenter", "dragover"])


def let_go(page: Page) -> None:
    """Drop what is held."""
    page.evaluate(_SEND, ["drop"])


def mushroom(height_m: float = 0.7) -> bytes:
    """Return a GLB of a disc that stands over a stem: its shadow is wide."""
    cap = trimesh.creation.cylinder(radius=0.5, height=0.08, sections=24).subdivide()
    stem = trimesh.creation.cylinder(radius=0.08, height=height_m, sections=12).subdivide()
    parts = [(cap, height_m), (stem, height_m / 2)]
    meshes = []
    for part, height in parts:
        positions = np.asarray(part.vertices, dtype=np.float32) + np.array([0, 0, height], dtype=np.float32)
        triangles = np.asarray(part.faces, dtype=np.int32)
        normals = np.asarray(part.vertex_normals, dtype=np.float32)
        albedo = np.full_like(positions, 0.7)
        meshes.append(Mesh("part", positions, triangles, normals, albedo))
    return encode_glb(meshes)


def green_map(directory: Path) -> bytes:
    """Return an EXR, 64 × 32, of green light."""
    picture = np.full((32, 64, 3), 0.05, dtype=np.float32)
    picture[..., 1] = 0.8
    path = directory / "map.exr"
    write_rgb(path, picture)
    return path.read_bytes()


def keep(page: Page, name: str) -> None:
    """Keep a picture of the page for people to look at."""
    ARTEFACTS.mkdir(exist_ok=True)
    page.screenshot(path=ARTEFACTS / f"{name}.png")
