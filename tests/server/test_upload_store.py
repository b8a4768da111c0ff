"""Uploads that come at the same time, and a disk that fills: the folder itself, without HTTP."""

from __future__ import annotations

import asyncio
import os
import resource
import shutil
from collections import namedtuple
from collections.abc import AsyncIterator
from pathlib import Path

import pytest
from tests.support.shapes import sphere

from lightwell.io.glb import encode_glb
from lightwell.io.uploads import Contents
from lightwell_server.config import UploadsSettings
from lightwell_server.uploads import MEGABYTE, UploadFullError, Uploads, UploadUnknownError
from lightwell_workers.inspect_upload import Answer

BALL = encode_glb([sphere(6, 8)])
Usage = namedtuple("Usage", "total used free")


class Quick(Uploads):
    """Takes every file for a mesh."""

    async def _inspect(self, path: Path, title: str) -> Answer:
        await asyncio.sleep(0.01)
        return Answer(contents=Contents(vertices=3, triangles=1))


async def body(data: bytes, chunk: int = 1 << 18) -> AsyncIterator[bytes]:
    for first in range(0, len(data), chunk):
        await asyncio.sleep(0)
        yield data[first : first + chunk]


def left(store: Uploads) -> list[str]:
    return [path.name for path in store.root.iterdir() if path.name.startswith(".")]


def test_the_same_file_many_times_at_once(tmp_path: Path) -> None:
    store = Quick(UploadsSettings(), tmp_path, 0)

    async def all_at_once() -> None:
        for _ in range(5):
            found = await asyncio.gather(
                *(store.receive(f"{number}.glb", body(BALL), len(BALL)) for number in range(12)),
            )
            assert sum(is_new for _, is_new in found) == 1
            assert len({record.id for record, _ in found}) == 1
            assert store.path(found[0][0]).read_bytes() == BALL
            gone = await asyncio.gather(
                *(asyncio.to_thread(store.delete, found[0][0].id) for _ in range(6)), return_exceptions=True
            )
            assert [type(one) for one in gone if one is not None] == [UploadUnknownError] * 5

    asyncio.run(all_at_once())
    assert left(store) == []


@pytest.mark.parametrize("announce", [True, False])
def test_files_on_their_way_count(tmp_path: Path, announce: bool) -> None:
    """Each alone has room below the quota, all together have not."""
    store = Quick(UploadsSettings(max_mb=4, quota_mb=6), tmp_path, 0)

    async def all_at_once() -> list[object]:
        bodies = [bytes([number]) * (2 * MEGABYTE) for number in range(8)]
        return list(
            await asyncio.gather(
                *(store.receive("a.glb", body(one), len(one) if announce else None) for one in bodies),
                return_exceptions=True,
            )
        )

    found = asyncio.run(all_at_once())
    kept = sum(record.bytes for record in store.all())
    assert all(isinstance(one, (tuple, UploadFullError)) for one in found)
    assert kept <= 6 * MEGABYTE
    assert kept == 6 * MEGABYTE or not announce
    assert left(store) == []
    # What was refused has given its room back.
    for record in store.all():
        store.delete(record.id)
    asyncio.run(store.receive("b.glb", body(b"b" * 4 * MEGABYTE), None))


def test_what_is_written_is_not_counted_twice(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of 100 MB that are free 50 must stay: a file of 30 has room."""
    store = Quick(UploadsSettings(), tmp_path, 50)

    def usage(path: Path) -> Usage:
        used = sum(one.stat().st_size for one in tmp_path.rglob("*") if one.is_file())
        return Usage(100 * MEGABYTE, used, 100 * MEGABYTE - used)

    monkeypatch.setattr(shutil, "disk_usage", usage)
    data = os.urandom(30 * MEGABYTE)
    record, _ = asyncio.run(store.receive("a.glb", body(data), len(data)))
    assert record.bytes == len(data)
    with pytest.raises(UploadFullError, match="free space, then send it again"):
        asyncio.run(store.receive("b.glb", body(b"b" + data), None))
    assert left(store) == []


def test_a_disk_that_takes_no_more(tmp_path: Path) -> None:
    """A limit of the process stands for the disk: writing fails in the middle of a file."""
    store = Quick(UploadsSettings(), tmp_path, 0)
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (MEGABYTE, before[1]))
    try:
        with pytest.raises(UploadFullError, match=r"a\.glb: cannot be kept: File too large"):
            asyncio.run(store.receive("a.glb", body(b"a" * 3 * MEGABYTE), None))
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert left(store) == []
    assert store.all() == []
