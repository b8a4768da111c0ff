"""The web page: static files that were built into `lightwell_client`."""

from __future__ import annotations

from collections.abc import MutableMapping
from pathlib import Path
from typing import Any

from fastapi import FastAPI
from fastapi.responses import HTMLResponse
from starlette.responses import Response
from starlette.staticfiles import StaticFiles

_NOT_BUILT = """<!doctype html>
<meta charset="utf-8"><title>Lightwell</title>
<style>body { font: 16px/1.5 system-ui; margin: 4rem auto; max-width: 40rem; padding: 0 1rem }</style>
<h1>Lightwell is running</h1>
<p>The web page has not been built. In the source tree, run <code>./script/setup</code>, then reload.
<p>The API is there: <a href="/api/v1/streams">streams</a>, <a href="/api/v1/openapi.json">OpenAPI</a>,
<a href="/metrics">metrics</a>.
"""

_TYPES = {
    ".js": "text/javascript; charset=utf-8",
    ".mjs": "text/javascript; charset=utf-8",
    ".css": "text/css; charset=utf-8",
    ".wasm": "application/wasm",
    ".glb": "model/gltf-binary",
    ".svg": "image/svg+xml",
    ".woff2": "font/woff2",
    ".ply": "application/octet-stream",
}
"""Types that do not depend on the machine's own table."""

UNCHANGING = "public, max-age=31536000, immutable"
REVALIDATE = "no-cache"


class Page(StaticFiles):
    """Files with their right type; those with a digest in their name are kept for good by caches."""

    async def get_response(self, path: str, scope: MutableMapping[str, Any]) -> Response:
        """Return a file; whatever lies outside the folder is not found."""
        response = await super().get_response(path, scope)
        if (media_type := _TYPES.get(Path(path).suffix.lower())) is not None:
            response.headers["Content-Type"] = media_type
        hashed = path.startswith("assets/")  # the builder puts files whose names hold their digest there
        response.headers["Cache-Control"] = UNCHANGING if hashed else REVALIDATE
        response.headers["X-Content-Type-Options"] = "nosniff"
        return response


def static_directory() -> Path:
    """Return where the built page is, or would be."""
    import lightwell_client

    return Path(lightwell_client.__file__).parent / "static"


def install(app: FastAPI, directory: Path) -> None:
    """Serve the page at ``/``, or say how to build it where it has not been built."""
    if (directory / "index.html").is_file():
        app.mount("/", Page(directory=directory, html=True), name="page")
        return

    @app.get("/", include_in_schema=False)
    async def not_built() -> HTMLResponse:
        return HTMLResponse(_NOT_BUILT, headers={"Cache-Control": "no-store"})
