"""Where frames come from: one module a URL scheme, opened by `open_source`."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from lightwell.errors import SourceError
from lightwell.settings import MappingSettings
from lightwell_workers.ingest.sources.base import Source
from lightwell_workers.ingest.sources.url import SourceUrl, parse_source_url


def _exr(url: SourceUrl, mapping: MappingSettings) -> Source:
    from lightwell_workers.ingest.sources.exr import open_exr

    return open_exr(url, mapping=mapping)


def _video(url: SourceUrl, mapping: MappingSettings) -> Source:
    from lightwell_workers.ingest.sources.video import open_video

    return open_video(url)


def _synthetic(url: SourceUrl, mapping: MappingSettings) -> Source:
    from lightwell_workers.ingest.sources.synthetic import open_synthetic

    return open_synthetic(url, mapping)


# Each opener imports its own module, so that a worker loads FFmpeg or the room's kernels only where it needs them.
_OPENERS: dict[str, Callable[[SourceUrl, MappingSettings], Source]] = {
    "exr": _exr,
    "video": _video,
    "synthetic": _synthetic,
}

SCHEMES = (*_OPENERS, "upload")


def open_source(url: str, mapping: MappingSettings | None = None, uploads: Path | None = None) -> Source:
    """Open the source that ``url`` names.

    ``mapping`` is the stream's: sources that render their pictures render them in it, captures must have it.
    ``uploads``: where the server keeps what it was sent.

    Raises
    ------
    SourceError
        Where the scheme or an option is unknown, or there is nothing to read; says what to do.
    """
    parsed = parse_source_url(url)
    if parsed.scheme == "upload":
        from lightwell_workers.ingest.sources.upload import open_upload

        return open_upload(parsed, uploads)
    opener = _OPENERS.get(parsed.scheme)
    if opener is None:
        raise SourceError(f"source {url!r}: no scheme {parsed.scheme!r}. There are: {', '.join(SCHEMES)}")
    return opener(parsed, mapping or MappingSettings())
