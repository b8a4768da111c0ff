from __future__ import annotations

import itertools
from pathlib import Path

import msgspec
import numpy as np
import pytest

from lightwell.errors import SourceError
from lightwell.io.exr import write_rgb
from lightwell.io.uploads import MAP_FILE, RECORD, Contents, UploadKind, UploadRecord
from lightwell_workers.ingest.sources import open_source

ID = "0123456789abcdef0123"


def keep(uploads: Path, kind: UploadKind) -> None:
    folder = uploads / ID
    folder.mkdir()
    write_rgb(folder / MAP_FILE, np.full((8, 16, 3), 0.5, np.float32))
    record = UploadRecord(ID, kind, "sky.exr", MAP_FILE, 1, "0" * 64, 0, Contents())
    (folder / RECORD).write_bytes(msgspec.json.encode(record))


def test_a_map_is_shown_again_and_again(tmp_path: Path) -> None:
    keep(tmp_path, "map")
    with open_source(f"upload:{ID}", uploads=tmp_path) as source:
        for frame in itertools.islice(source, 2):
            np.testing.assert_array_equal(np.asarray(getattr(frame, "pixels")), 0.5)  # noqa: B009 -- or an error


@pytest.mark.parametrize(
    ("url", "told", "message"),
    [
        (f"upload:{ID}", False, "--uploads DIR"),
        (f"upload:{'f' * 20}", True, "may have been deleted"),
        (f"upload:{ID}", True, "sky.exr is a mesh"),
        ("upload:../../etc", True, "names no upload"),
        (f"upload:{ID}?fps=5", True, "no option 'fps'"),
    ],
)
def test_what_cannot_be_shown_is_said_without_a_place(tmp_path: Path, url: str, told: bool, message: str) -> None:
    keep(tmp_path, "mesh")
    with pytest.raises(SourceError, match=message) as caught:
        open_source(url, uploads=tmp_path if told else None)
    assert str(tmp_path) not in str(caught.value)
