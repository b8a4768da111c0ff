"""What survives a restart."""

from __future__ import annotations

import sqlite3
from functools import partial
from pathlib import Path

import httpx
import pytest
from tests.support.server import problem, running_server

from lightwell_server.config import ConfigError
from lightwell_server.store import SCHEMA_VERSION, Store, StoredRow, StoreError


def test_rows_survive(tmp_path: Path) -> None:
    path = tmp_path / "deep" / "store.sqlite"
    store = Store(path)
    store.put("streams", "hall", '{"source": "a"}', 1)
    store.put("streams", "hall", '{"source": "b"}', 2)
    store.put("streams", "room", "{}", 1)
    store.delete("streams", "room")
    store.delete("streams", "room")
    store.put("fields", "hall", '{"streams": ["hall"]}', 3)
    store.close()
    again = Store(path)
    assert again.all("fields") == {"hall": StoredRow('{"streams": ["hall"]}', 3)}
    assert again.all("streams") == {"hall": StoredRow('{"source": "b"}', 2)}
    again.close()


def test_the_file_is_in_write_ahead_mode(tmp_path: Path) -> None:
    path = tmp_path / "store.sqlite"
    Store(path).close()
    connection = sqlite3.connect(path)
    assert connection.execute("PRAGMA journal_mode").fetchone() == ("wal",)
    connection.close()


def test_a_file_of_a_newer_version_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "store.sqlite"
    connection = sqlite3.connect(path)
    connection.execute(f"PRAGMA user_version={SCHEMA_VERSION + 1}")
    connection.close()
    with pytest.raises(ConfigError, match="written by a newer Lightwell"):
        Store(path)


def test_a_file_that_is_no_database_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "store.sqlite"
    path.write_bytes(b"no database at all" * 100)
    with pytest.raises(ConfigError, match=r"is no usable database: .*; move it away to start anew"):
        Store(path)


def test_a_file_that_is_damaged_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "store.sqlite"
    store = Store(path)
    store.put("streams", "hall", "x" * 10_000, 1)
    store.close()
    data = bytearray(path.read_bytes())
    data[4096:] = b"\xff" * (len(data) - 4096)
    path.write_bytes(data)
    with pytest.raises(ConfigError, match=r"malformed; move it away to start anew"):
        Store(path)


def test_a_folder_that_cannot_be_made_is_refused(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(ConfigError, match=r"cannot be opened: .*--data"):
        Store(tmp_path / "file" / "store.sqlite")


def test_a_file_that_is_locked_is_not_to_be_moved_away(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "store.sqlite"
    Store(path).close()
    other = sqlite3.connect(path, isolation_level=None)
    other.execute("PRAGMA locking_mode=EXCLUSIVE")
    other.execute("BEGIN EXCLUSIVE")
    monkeypatch.setattr(sqlite3, "connect", partial(sqlite3.connect, timeout=0))
    with pytest.raises(ConfigError, match=r"cannot be used: database is locked; .*--data"):
        Store(path)
    other.close()


def test_a_change_that_cannot_be_written_is_an_error_with_its_reason(tmp_path: Path) -> None:
    store = Store(tmp_path / "store.sqlite")
    store.put("streams", "hall", "{}", 1)
    fill(store)
    with pytest.raises(StoreError, match="database or disk is full"):
        store.put("streams", "room", "x" * 100_000, 1)
    assert store.all("streams") == {"hall": StoredRow("{}", 1)}
    store.close()


def test_a_full_disk_is_a_problem_document(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    stores: list[Store] = []
    prepare = Store._prepare

    def remember(store: Store, path: Path) -> None:
        prepare(store, path)
        stores.append(store)

    monkeypatch.setattr(Store, "_prepare", remember)
    with running_server(tmp_path) as url:
        fill(stores[0])
        settings = {"source": f"exr:{'x' * 100_000}"}
        response = httpx.post(f"{url}/api/v1/streams", json={"name": "hall", "settings": settings})
        assert "disk is full" in problem(response, 507, "not-kept")["detail"]
        assert httpx.get(f"{url}/api/v1/streams").json() == {"streams": []}


def fill(store: Store) -> None:
    """Let the file grow no further, as on a full disk."""
    (pages,) = store._connection.execute("PRAGMA page_count").fetchone()
    store._connection.execute(f"PRAGMA max_page_count={pages}")
