"""Credentials in source URLs."""

from __future__ import annotations

import pytest

from lightwell_server.masking import mask, unmask


@pytest.mark.parametrize(
    ("text", "masked"),
    [
        ("exr:/data/hall/*.exr?fps=30&loop=1", "exr:/data/hall/*.exr?fps=30&loop=1"),
        ("video:rtsp://anna:hush@cam/stream", "video:rtsp://***@cam/stream"),
        ("video:http://cam/?user=anna&password=hush&fps=3", "video:http://cam/?user=anna&password=***&fps=3"),
        ("video:http://cam/?API_KEY=hush", "video:http://cam/?API_KEY=***"),
        ("video:http://cam/?access_token=hush#x", "video:http://cam/?access_token=***#x"),
        ("cannot open rtsp://a:hush@x and http://y?token=hush", "cannot open rtsp://***@x and http://y?token=***"),
    ],
)
def test_secrets_are_masked_and_the_rest_stays(text: str, masked: str) -> None:
    assert mask(text) == masked
    assert mask(masked) == masked


def test_a_masked_source_that_comes_back_keeps_its_secret() -> None:
    kept = "video:rtsp://anna:hush@cam/stream"
    assert unmask("video:rtsp://***@cam/stream", kept) == kept
    assert unmask("video:rtsp://***@other/stream", kept) == "video:rtsp://***@other/stream"
