"""The web page's files."""

from __future__ import annotations

import http.client
from collections.abc import Iterator
from pathlib import Path
from urllib.parse import urlsplit

import httpx
import pytest
from tests.support.server import running_server


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    folder = tmp_path_factory.mktemp("site")
    page = folder / "static"
    (page / "assets").mkdir(parents=True)
    (page / "index.html").write_text("<!doctype html><title>page</title>")
    (page / "assets" / "main-1a2b.js").write_text("export {}")
    (page / "assets" / "bunny-1a2b.glb").write_bytes(b"glTF")
    (folder / "secret.txt").write_text("hush")
    (page / "link.txt").symlink_to(folder / "secret.txt")
    with running_server(folder / "data", page) as url:
        yield url


@pytest.mark.parametrize(
    ("path", "media_type", "cache"),
    [
        ("/", "text/html; charset=utf-8", "no-cache"),
        ("/assets/main-1a2b.js", "text/javascript; charset=utf-8", "public, max-age=31536000, immutable"),
        ("/assets/bunny-1a2b.glb", "model/gltf-binary", "public, max-age=31536000, immutable"),
    ],
)
def test_files_have_their_type_and_their_caching(site: str, path: str, media_type: str, cache: str) -> None:
    response = httpx.get(site + path)
    assert response.status_code == 200
    assert response.headers["content-type"] == media_type
    assert response.headers["cache-control"] == cache
    assert response.headers["x-content-type-options"] == "nosniff"


@pytest.mark.parametrize(
    "path",
    [
        "/../secret.txt",
        "/assets/../../secret.txt",
        "/%2e%2e/secret.txt",
        "/..%2fsecret.txt",
        "/assets/%2e%2e/%2e%2e/secret.txt",
        "/....//secret.txt",
        "//etc/passwd",
        "/%2fetc%2fpasswd",
        "/..\\secret.txt",
        "/link.txt",
    ],
)
def test_nothing_outside_the_folder_is_served(site: str, path: str) -> None:
    connection = http.client.HTTPConnection(urlsplit(site).netloc)
    connection.putrequest("GET", path, skip_host=True)
    connection.putheader("Host", "localhost")
    connection.endheaders()
    response = connection.getresponse()
    assert response.status == 404
    assert b"hush" not in response.read()
    connection.close()


def test_a_page_that_is_not_built_says_how_to_build_it(tmp_path: Path) -> None:
    with running_server(tmp_path / "other", tmp_path) as url:
        response = httpx.get(url)
        assert response.status_code == 200
        assert "./script/setup" in response.text
        assert response.headers["cache-control"] == "no-store"
