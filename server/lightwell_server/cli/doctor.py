"""``lightwell doctor``: checks the installation and says what would mend it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path

import typer

PACKAGES = (
    "numpy",
    "numba",
    "msgspec",
    "OpenEXR",
    "opencv-contrib-python-headless",
    "av",
    "fastapi",
    "uvicorn",
    "websockets",
    "httpx",
    "pydantic",
    "dbos",
    "distributed",
    "zarr",
    "matplotlib",
)
COMPRESSIONS = ("none", "rle", "zips", "zip", "piz", "pxr24", "b44", "b44a", "dwaa", "dwab", "zstd")
OLDEST_PYTHON = (3, 11)
MEGABYTE = 1 << 20


@dataclass(frozen=True)
class Finding:
    """Result of one check."""

    name: str
    ok: bool
    detail: str
    essential: bool = True
    """Whether Lightwell cannot do its work without it."""
    remedy: str = ""


def doctor(
    json: bool = typer.Option(False, "--json", help="Print the findings as JSON."),
    port: int = typer.Option(8400, min=1, max=65535, help="Port that should be free."),
    data: Path = typer.Option(Path("data"), help="Folder for the server's data."),
) -> None:
    """Check the installation; exit status 1 where something essential fails."""
    checks: tuple[Callable[[], Finding], ...] = (
        _python,
        _packages,
        _numba,
        _exr,
        _video,
        _page,
        _chromium,
        lambda: _port(port),
        lambda: _data(data),
        _sources,
    )
    findings = []
    for check in checks:
        finding = _guarded(check)
        findings.append(finding)
        if not json:
            print(f"{'✓' if finding.ok else '✗'} {finding.name}: {finding.detail}")
            if not finding.ok and finding.remedy:
                print(f"  → {finding.remedy}")
    ok = all(finding.ok or not finding.essential for finding in findings)
    if json:
        import json as json_module

        print(json_module.dumps({"ok": ok, "checks": [asdict(finding) for finding in findings]}))
    raise typer.Exit(0 if ok else 1)


def _guarded(check: Callable[[], Finding]) -> Finding:
    """Return what a check finds; one that breaks has found something."""
    try:
        return check()
    except Exception as error:
        name = getattr(check, "__name__", "check").strip("_<>")
        return Finding(name, False, f"{type(error).__name__}: {error}", remedy="install Lightwell anew: ./script/setup")


def _python() -> Finding:
    import platform
    import sys

    ok = sys.version_info[:2] >= OLDEST_PYTHON
    wanted = ".".join(map(str, OLDEST_PYTHON))
    return Finding("Python", ok, f"{platform.python_version()}", remedy=f"install Python {wanted} or newer")


def _packages() -> Finding:
    from importlib.metadata import PackageNotFoundError, version

    from lightwell._version import __version__

    absent: list[str] = []
    found = [f"lightwell {__version__}"]
    for name in PACKAGES:
        try:
            found.append(f"{name} {version(name)}")
        except PackageNotFoundError:
            absent.append(name)
    detail = f"missing: {', '.join(absent)}" if absent else ", ".join(found)
    return Finding("packages", not absent, detail, remedy="./script/setup")


def _numba() -> Finding:
    import time

    import numpy as np

    from lightwell.sh.basis import evaluate

    start = time.perf_counter()
    values = evaluate(np.array([[0.0, 0.0, 1.0]]), 2)
    ok = bool(np.allclose(values[0], [0.28209479, 0, 0.48860251, 0]))
    return Finding(
        "numba", ok, f"kernels work (first call {time.perf_counter() - start:.1f} s)", remedy="./script/setup"
    )


def _exr() -> Finding:
    from tempfile import TemporaryDirectory

    import numpy as np

    from lightwell.io.exr import read_rgb, write_rgb

    ramp = np.linspace(1, 2, 48, dtype=np.float16)  # smooth: some compressions are lossy
    pixels = np.ascontiguousarray(np.broadcast_to(ramp[None, :, None], (32, 48, 3)))
    right: list[str] = []
    wrong: list[str] = []
    with TemporaryDirectory() as folder:
        for compression in COMPRESSIONS:
            path = Path(folder) / f"{compression}.exr"
            write_rgb(path, pixels, compression=compression)
            close = np.allclose(read_rgb(path).pixels.astype(np.float32), pixels.astype(np.float32), rtol=0.02)
            (right if close else wrong).append(compression)
    detail = f"round trip fails with {', '.join(wrong)}" if wrong else f"round trip with {', '.join(right)}"
    return Finding("EXR", not wrong, detail, remedy="install OpenEXR 3.4.6 or newer")


def _video() -> Finding:
    from av.codec import codecs_available

    wanted = ("h264", "hevc", "vp9", "av1", "prores", "ffv1")
    present = [name for name in wanted if name in codecs_available]
    detail = f"decodes {', '.join(present)}" if present else "no usable decoder"
    return Finding("video", bool(present), detail, essential=False, remedy="install PyAV with FFmpeg: pip install av")


def _page() -> Finding:
    from lightwell_server.routes.page import static_directory

    built = (static_directory() / "index.html").is_file()
    detail = "built" if built else "not built; the server runs without it"
    return Finding("web page", built, detail, essential=False, remedy="./script/setup")


def _chromium() -> Finding:
    import shutil

    found = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
    detail = found or "not found; only the browser tests need it"
    return Finding("Chromium", found is not None, detail, essential=False, remedy="apt-get install chromium")


def _port(port: int) -> Finding:
    import socket

    with socket.socket() as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind(("127.0.0.1", port))
        except OSError as error:
            remedy = f"stop what uses port {port}, or serve with another --port"
            return Finding("port", False, f"{port}: {error.strerror}", essential=False, remedy=remedy)
    return Finding("port", True, f"{port} is free")


def _data(data: Path) -> Finding:
    import shutil
    from tempfile import TemporaryFile

    existing = next(path for path in (data.absolute(), *data.absolute().parents) if path.exists())
    remedy = "give a folder that can be written to with --data"
    try:
        with TemporaryFile(dir=existing):  # fails where it is a file
            pass
    except OSError as error:
        return Finding("data", False, f"{data}: cannot be written to: {error.strerror}", remedy=remedy)
    free = shutil.disk_usage(existing).free // MEGABYTE
    return Finding("data", free >= 100, f"{data}: writable, {free} MB free", remedy="free some disk, at least 100 MB")


def _sources() -> Finding:
    detail = "exr: (recorded sequences), video: (files) and synthetic: (rooms); no camera drivers in this version"
    return Finding("sources", True, detail, essential=False)
