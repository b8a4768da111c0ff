"""Source URLs: what is split where, and what the errors say."""

from __future__ import annotations

import pytest

from lightwell.errors import SourceError
from lightwell_workers.ingest.sources import open_source
from lightwell_workers.ingest.sources.exr import ExrOptions
from lightwell_workers.ingest.sources.url import parse_options, parse_source_url


@pytest.mark.parametrize(
    ("text", "scheme", "target", "query"),
    [
        ("exr:a/b", "exr", "a/b", {}),
        ("exr:a/f.%04d.exr?fps=25&loop=1", "exr", "a/f.%04d.exr", {"fps": "25", "loop": "1"}),
        ("exr:a/f????.exr", "exr", "a/f????.exr", {}),
        ("exr:a/f?.exr?loop=1", "exr", "a/f?.exr", {"loop": "1"}),
        ("exr:a/b?", "exr", "a/b", {}),
        ("exr:C:/x y/%20?fps=1", "exr", "C:/x y/%20", {"fps": "1"}),
        ("synthetic:room?noise=", "synthetic", "room", {"noise": ""}),
    ],
)
def test_parts(text: str, scheme: str, target: str, query: dict[str, str]) -> None:
    url = parse_source_url(text)
    assert (url.scheme, url.target, url.query) == (scheme, target, query)


def test_options_are_typed_and_empty_ones_are_defaults() -> None:
    options = parse_options(parse_source_url("exr:a?fps=12.5&loop=yes&realtime=0&last="), ExrOptions)
    assert options == ExrOptions(fps=12.5, loop=True, realtime=False)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("frames", "has no scheme"),
        ("", "has no scheme"),
        ("rtsp:x", "There are: exr, video, synthetic"),
        ("exr:a?fps=30&fps=25", "twice"),
        ("exr:a?rate=30", "no option 'rate'.*fps.*loop.*realtime"),
        ("exr:a?fps=fast", "option 'fps'"),
        ("exr:a?fps=0", "greater than 0"),
        ("exr:?fps=1", "names no files"),
        ("synthetic:cave", "There are: room, cube"),
        ("synthetic:room?light_radius=9", "must not reach the probe"),
    ],
)
def test_errors_say_what_exists(text: str, message: str) -> None:
    with pytest.raises(SourceError, match=message):
        open_source(text)
