"""Meshes and light maps that pages and programs send: checked, kept below the data directory, by content.

``<data>/uploads/<id>/`` (`lightwell.io.uploads`) appears whole or not at all. Uploads are kept until they are deleted.
"""

from __future__ import annotations

import asyncio
import contextlib
import errno
import hashlib
import os
import shutil
import sys
import threading
import time
import unicodedata
import uuid
from collections.abc import AsyncIterator
from pathlib import Path

import msgspec

from lightwell.errors import LightwellError
from lightwell.io.uploads import MAP_FILE, RECORD, UPLOAD_ID, UploadError, UploadRecord, kind_of, read_record
from lightwell_server.config import UploadsSettings
from lightwell_workers.inspect_upload import Answer

MEGABYTE = 1 << 20
WRITE_BYTES = MEGABYTE
ID_LENGTH = 20
INSPECTIONS = 2
INSPECTION_SECONDS = 120.0
LONGEST_NAME = 200
INCOMING = ".incoming-"


class UploadUnknownError(LightwellError):
    """There is no upload of this id."""


class UploadTypeError(LightwellError):
    """A file is of a type that is not taken."""


class UploadTooLargeError(LightwellError):
    """A file is larger than the server takes."""


class UploadFullError(LightwellError):
    """There is no room for a file."""


class Uploads:
    """The folder of uploads."""

    def __init__(self, settings: UploadsSettings, data_dir: Path, min_free_mb: int) -> None:
        self.settings = settings
        self.root = (data_dir / "uploads").absolute()
        self._min_free = min_free_mb * MEGABYTE
        self._inspecting = asyncio.Semaphore(INSPECTIONS)
        self._lock = threading.Lock()
        """Held while a folder appears or goes, and while room is looked for."""
        self._arriving: dict[Path, int] = {}
        """Bytes that each file on its way has been given room for."""
        if self.root.is_dir():
            for unfinished in self.root.glob(f"{INCOMING}*"):  # of a server that was killed
                shutil.rmtree(unfinished, ignore_errors=True)

    def all(self) -> list[UploadRecord]:
        """Return the uploads, newest first."""
        if not self.root.is_dir():
            return []
        records = [read_record(folder) for folder in self.root.iterdir() if UPLOAD_ID.match(folder.name)]
        return sorted((record for record in records if record is not None), key=lambda one: (-one.created, one.id))

    def find(self, upload: str) -> UploadRecord:
        """Return an upload; raises `UploadUnknownError`."""
        record = read_record(self.root / upload) if UPLOAD_ID.match(upload) else None
        if record is None:
            raise UploadUnknownError(f"there is no upload {upload!r}; POST /api/v1/uploads?name=… sends a file")
        return record

    def path(self, record: UploadRecord) -> Path:
        """Return where an upload's file lies."""
        return record.path_below(self.root / record.id)

    def source(self, record: UploadRecord) -> str | None:
        """Return the source of a stream that shows a map; None for meshes."""
        return f"upload:{record.id}" if record.kind == "map" else None

    def delete(self, upload: str) -> None:
        """Delete an upload; raises `UploadUnknownError`."""
        gone = self.root / f"{INCOMING}{uuid.uuid4().hex}"
        with self._lock:
            folder = self.root / self.find(upload).id
            # Renamed first: what is left of it, if anything, is no upload.
            folder.rename(gone)
        shutil.rmtree(gone, ignore_errors=True)

    async def receive(self, name: str, body: AsyncIterator[bytes], announced: int | None) -> tuple[UploadRecord, bool]:
        """Take a file; return its record, and whether it is new. The same bytes are the same upload.

        Raises
        ------
        UploadTypeError, UploadTooLargeError, UploadFullError
            Before more is read than need be.
        UploadError
            Where the file is damaged or holds nothing that can be used.
        """
        title = _title(name)
        try:
            _, suffix = kind_of(title)
        except UploadError as error:
            raise UploadTypeError(str(error)) from None
        incoming = self.root / f"{INCOMING}{uuid.uuid4().hex}"
        try:
            await asyncio.to_thread(self._take_room, incoming, title, announced or 0, 0)
            await asyncio.to_thread(incoming.mkdir, parents=True)
            file = incoming / (MAP_FILE if suffix == ".exr" else f"file{suffix}")
            size, sha256 = await self._write(file, title, body, announced or 0)
            known = read_record(self.root / sha256[:ID_LENGTH])
            if known is not None:
                return known, False
            contents = await self._inspect(file, title)
            return await asyncio.to_thread(self._keep, incoming, file, title, size, sha256, contents)
        except OSError as error:
            if error.errno in (errno.ENOSPC, errno.EDQUOT):
                raise UploadFullError(f"{title}: the disk is full; free space, then send it again") from None
            raise UploadFullError(f"{title}: cannot be kept: {error.strerror or error}") from None
        finally:
            self._arriving.pop(incoming, None)
            await asyncio.to_thread(shutil.rmtree, incoming, ignore_errors=True)

    def _take_room(self, incoming: Path, title: str, size: int, written: int) -> None:
        """Give a file that is on its way room for ``size`` bytes, of which ``written`` are on the disk."""
        with self._lock:
            self._require_room(incoming, title, size, written)
            self._arriving[incoming] = size

    def _require_room(self, incoming: Path, title: str, size: int, written: int) -> None:
        limit = self.settings.max_mb * MEGABYTE
        if size > limit:
            raise UploadTooLargeError(
                f"{title}: has {size} bytes; at most {self.settings.max_mb} MB are taken ([uploads] max_mb): "
                "simplify the mesh or shrink the map"
            )
        used = sum(record.bytes for record in self.all())
        used += sum(bytes_ for place, bytes_ in self._arriving.items() if place != incoming)
        if used + size > self.settings.quota_mb * MEGABYTE:
            raise UploadFullError(
                f"{title}: uploads use {used // MEGABYTE} MB of {self.settings.quota_mb} MB ([uploads] quota_mb): "
                "delete some, or raise the quota"
            )
        existing = next(path for path in (self.root, *self.root.parents) if path.exists())
        free = shutil.disk_usage(existing).free
        if free - (size - written) < self._min_free:
            raise UploadFullError(
                f"{title}: the disk has {free // MEGABYTE} MB free and must keep {self._min_free // MEGABYTE} MB "
                "([server] min_free_mb): free space, then send it again"
            )

    async def _write(self, path: Path, title: str, body: AsyncIterator[bytes], announced: int) -> tuple[int, str]:
        """Write what comes; return its size and SHA-256."""
        digest, size, waiting = hashlib.sha256(), 0, bytearray()

        def flush(data: bytes) -> None:
            digest.update(data)
            file.write(data)
            file.flush()
            self._take_room(path.parent, title, max(announced, size), size)

        with await asyncio.to_thread(path.open, "wb") as file:
            async for chunk in body:
                size += len(chunk)
                if size > self.settings.max_mb * MEGABYTE:
                    await asyncio.to_thread(self._take_room, path.parent, title, size, 0)
                waiting += chunk
                if len(waiting) >= WRITE_BYTES:
                    await asyncio.to_thread(flush, bytes(waiting))
                    waiting.clear()
            await asyncio.to_thread(flush, bytes(waiting))
            await asyncio.to_thread(os.fsync, file.fileno())
        if size == 0:
            raise UploadError(f"{title}: is empty")
        return size, digest.hexdigest()

    async def _inspect(self, path: Path, title: str) -> Answer:
        """Return what a process of its own finds in a file; raises `UploadError` where it finds nothing usable."""
        async with self._inspecting:
            process = await asyncio.create_subprocess_exec(
                sys.executable,
                "-m",
                "lightwell_workers.inspect_upload",
                str(path),
                title,
                str(self.settings.max_triangles),
                stdin=asyncio.subprocess.DEVNULL,
                stdout=asyncio.subprocess.PIPE,
                stderr=asyncio.subprocess.DEVNULL,
                env=os.environ | {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"},
            )
            try:
                output, _ = await asyncio.wait_for(process.communicate(), INSPECTION_SECONDS)
            except TimeoutError:
                raise UploadError(
                    f"{title}: takes longer than {INSPECTION_SECONDS:.0f} s to read; simplify it"
                ) from None
            finally:
                if process.returncode is None:
                    with contextlib.suppress(ProcessLookupError):
                        process.kill()
                    await process.wait()
        try:
            answer = msgspec.json.decode(output, type=Answer)
        except msgspec.MsgspecError:
            raise UploadError(f"{title}: cannot be read: its reader broke down; export it again") from None
        if answer.refused is not None or answer.contents is None:
            raise UploadError(answer.refused or f"{title}: cannot be read")
        return answer

    def _keep(
        self, incoming: Path, file: Path, title: str, size: int, sha256: str, answer: Answer
    ) -> tuple[UploadRecord, bool]:
        assert answer.contents is not None
        kind, _ = kind_of(title)
        record = UploadRecord(
            id=sha256[:ID_LENGTH],
            kind=kind,
            name=title,
            file=MAP_FILE if kind == "map" else file.name,
            bytes=size,
            sha256=sha256,
            created=time.time_ns(),
            contents=answer.contents,
        )
        (incoming / RECORD).write_bytes(msgspec.json.format(msgspec.json.encode(record), indent=1))
        if record.file != file.name:
            file.unlink()  # the map that was made of it is what is used
        target = self.root / record.id
        with self._lock:
            known = read_record(target)  # the same file may have come twice at once
            if known is not None:
                return known, False
            shutil.rmtree(target, ignore_errors=True)
            incoming.rename(target)
        return record, True


def _title(name: str) -> str:
    """Return the last part of a name, without what cannot be shown; raises `UploadTypeError` where nothing is left."""
    last = name.replace("\\", "/").rpartition("/")[2]
    shown = "".join(char for char in last if unicodedata.category(char)[0] != "C").strip()
    if not shown or not shown.strip("."):
        raise UploadTypeError(f"name: {name!r} is no file name; send one such as bunny.glb")
    stem, dot, suffix = shown.rpartition(".")
    return shown if len(shown) <= LONGEST_NAME or not dot else f"{stem[: LONGEST_NAME - 12]}.{suffix[:10]}"
