"""``upload:ID``: a light map that was sent to the server, shown once a second.

The address names no place on the server, so that streams can be shown to everybody. The folder of uploads is told to
workers by the server that starts them.
"""

from __future__ import annotations

from pathlib import Path

from lightwell.errors import SourceError
from lightwell.io.uploads import UPLOAD_ID, read_record
from lightwell.settings import Settings
from lightwell_workers.ingest.sources.exr import open_exr
from lightwell_workers.ingest.sources.playback import Playback
from lightwell_workers.ingest.sources.url import SourceUrl, parse_options

ONCE_A_SECOND = {"fps": "1", "loop": "1"}


class UploadOptions(Settings):
    """What the query of an ``upload:`` URL may set: nothing."""


def check_upload(url: SourceUrl) -> None:
    """Raise `SourceError` where the URL can name no upload."""
    parse_options(url, UploadOptions)
    if not UPLOAD_ID.match(url.target):
        raise SourceError(f"source {url.text!r} names no upload: write upload:ID, with the id that POST /uploads gave")


def open_upload(url: SourceUrl, uploads: Path | None) -> Playback:
    """Open the map.

    Raises
    ------
    SourceError
        Where this process was not told of ``uploads``, or there is no such map in it.
    """
    check_upload(url)
    if uploads is None:
        raise SourceError(
            f"source {url.text!r}: workers that the server does not start need --uploads DIR, on its machine"
        )
    folder = uploads / url.target
    record = read_record(folder)
    if record is None:
        raise SourceError(f"source {url.text!r}: there is no such upload; it may have been deleted: send the map again")
    if record.kind != "map":
        raise SourceError(f"source {url.text!r}: {record.name} is a mesh; streams show light maps")
    return open_exr(SourceUrl(url.text, "exr", str(record.path_below(folder)), ONCE_A_SECOND))
