"""The results of a ``prt-transfer`` job: blobs, baked GLB, description and preview."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from lightwell.geometry.mesh import Float32s, Mesh
from lightwell.io.files import write_atomically
from lightwell.io.glb import encode_glb
from lightwell.io.preview import encode_png
from lightwell.job_settings import PrtTransferSettings
from lightwell.transfer.preview import picture
from lightwell.transfer.surface import make_surface
from lightwell.transfer.visibility import DARK, INSIDE
from lightwell_workers.jobs.context import JobContext
from lightwell_workers.jobs.prt_plan import Plan, count_of_directions

FORMAT_VERSION = 1
MOSTLY_DARK = 0.3


def write_results(
    settings: PrtTransferSettings,
    plan: Plan,
    meshes: list[Mesh],
    transfer: Float32s,
    error: Float32s,
    state: np.ndarray[Any, np.dtype[np.uint8]],
    context: JobContext,
) -> None:
    """Write all artefacts; ``transfer (V, bands², channels)``, ``error (V,)``, ``state (V,)``, mesh after mesh."""
    results = context.results
    entries, baked = [], []
    first, total = 0, len(meshes) + 2
    for index, mesh in enumerate(meshes):
        context.progress("write", index, total)
        rows = slice(first, first + len(mesh.positions))
        first = rows.stop
        values = np.ascontiguousarray(transfer[rows].reshape(len(mesh.positions), -1))
        names = f"mesh-{index}.f32.bin", f"mesh-{index}.f16.bin"
        write_atomically(results / names[0], values.astype("<f4").tobytes())
        write_atomically(results / names[1], values.astype("<f2").tobytes())
        dark, inside = (int(np.count_nonzero(state[rows] == kind)) for kind in (DARK, INSIDE))
        if dark > MOSTLY_DARK * len(mesh.positions):
            context.log(
                f"{dark} of {len(mesh.positions)} vertices of {mesh.name!r} see no light: its normals may point"
                " inwards (set normals to triangles, or turn them in a modelling program)",
                level="warning",
            )
        lower, upper = mesh.bounds
        entries.append(
            {
                "name": mesh.name,
                "vertices": len(mesh.positions),
                "triangles": len(mesh.triangles),
                "bounds": [lower.tolist(), upper.tolist()],
                "float32": names[0],
                "float16": names[1],
                "stride": values.shape[1],
                "error_mean": float(error[rows].mean()),
                "error_max": float(error[rows].max()),
                "dark": dark,
                "inside": inside,
            }
        )
        baked.append(values)
    context.progress("write", len(meshes), total)
    lanes = baked if settings.bake and plan.channels == 1 else None
    write_atomically(results / "scene.glb", encode_glb(meshes, lanes))
    context.progress("write", len(meshes) + 1, total)
    write_atomically(results / "preview.png", encode_png(picture(make_surface(meshes), transfer, plan.objects)))
    document = {
        "version": FORMAT_VERSION,
        "bands": settings.bands,
        "channels": plan.channels,
        "directions": 0 if settings.mode == "unshadowed" else count_of_directions(settings),
        "sampling": settings.sampling,
        "mode": settings.mode,
        "bounces": settings.bounces if settings.mode == "interreflected" else 0,
        "ground": settings.ground,
        "baked": lanes is not None,
        "digest": plan.digest,
        "meshes": entries,
        "glb": "scene.glb",
    }
    _write_document(results / "transfer.json", document)
    context.progress("write", total, total)


def _write_document(path: Path, document: dict[str, Any]) -> None:
    write_atomically(path, (json.dumps(document, indent=1) + "\n").encode())
