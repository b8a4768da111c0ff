"""The captures that the server knows: folders below the data roots, by id."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

from lightwell.errors import LightwellError
from lightwell.io.captures import Capture, open_capture
from lightwell.job_settings import JobsSettings
from lightwell_server.store import Store
from lightwell_workers.jobs.roots import data_roots

CAPTURE_ID = re.compile(r"^[a-z0-9][a-z0-9_-]{0,62}$")


class CaptureRefusedError(LightwellError):
    """A capture may not be used: says why and what would help."""


class CaptureNameError(LightwellError):
    """A capture's id is none: says what would be one."""


class CaptureTakenError(LightwellError):
    """A capture's id stands for another folder."""


class CaptureUnknownError(LightwellError):
    """There is no capture of this id."""


@dataclass(frozen=True)
class Registered:
    """A capture by id."""

    id: str
    directory: Path


class Captures:
    """Keeps ids and folders in the server's store."""

    def __init__(self, store: Store, settings: JobsSettings, data_dir: Path) -> None:
        self._store = store
        self._data_dir = data_dir.absolute()
        self.roots = data_roots(settings, data_dir)
        """Folders below which inputs of jobs may lie."""

    def all(self) -> list[Registered]:
        """Return the captures by id."""
        return [Registered(name, Path(path)) for name, path in sorted(self._store.captures().items())]

    def find(self, name: str) -> Registered:
        """Return a capture; raises `CaptureUnknownError`."""
        path = self._store.captures().get(name)
        if path is None:
            raise CaptureUnknownError(f"there is no capture {name!r}; POST /api/v1/captures registers one")
        return Registered(name, Path(path))

    def register(self, path: str, name: str | None) -> tuple[Registered, Capture]:
        """Remember a capture; the same id for the same folder may be registered again.

        Raises
        ------
        CaptureRefusedError
            Where the folder lies outside the data roots.
        CaptureNameError, CaptureTakenError
            Where the id is bad, or taken.
        CaptureError
            Where the folder holds no valid capture.
        """
        directory = self.allowed(path)
        capture = open_capture(directory)
        chosen = name or re.sub(r"[^a-z0-9_-]+", "-", directory.name.lower()).strip("-")[:63]
        if not CAPTURE_ID.match(chosen):
            raise CaptureNameError(f"id: {chosen!r}: use lower-case letters, digits, - and _, at most 63")
        known = self._store.captures().get(chosen)
        if known is not None and known != str(directory):
            raise CaptureTakenError(f"id: {chosen!r} stands for another folder; give another id")
        self._store.put_capture(chosen, str(directory))
        return Registered(chosen, directory), capture

    def forget(self, name: str) -> None:
        """Forget a capture; its folder stays."""
        self.find(name)
        self._store.delete_capture(name)

    def resolve(self, name_or_path: str) -> Path:
        """Return the folder of a capture that a job names by id or by path; raises as `find` and `allowed`."""
        known = self._store.captures().get(name_or_path)
        if known is not None:
            return self.allowed(known)
        if CAPTURE_ID.match(name_or_path):
            raise CaptureUnknownError(f"capture: there is no capture {name_or_path!r}")
        return self.allowed(name_or_path)

    def allowed(self, path: str) -> Path:
        """Return a folder, relative to the data folder or absolute, with all links followed.

        Raises `CaptureRefusedError` outside the data roots.
        """
        try:
            directory = (self._data_dir / path).resolve()
            directory.exists()  # raises where no file can have such a name
        except (OSError, ValueError, RuntimeError):
            raise CaptureRefusedError(f"{path!r} is no usable path") from None
        if not any(directory.is_relative_to(root) for root in self.roots):
            raise CaptureRefusedError(
                f"{path}: lies outside the data roots; move it below {self.roots[0]}, or add its folder to "
                "[jobs] data_roots"
            )
        return directory
