"""What survives a restart."""

from __future__ import annotations

import sqlite3
from pathlib import Path

import pytest

from lightwell_server.config import ConfigError
from lightwell_server.store import SCHEMA_VERSION, Store, StoredStream


def test_rows_survive(tmp_path: Path) -> None:
    path = tmp_path / "deep" / "store.sqlite"
    store = Store(path)
    store.put("hall", '{"source": "a"}', 1)
    store.put("hall", '{"source": "b"}', 2)
    store.put("room", "{}", 1)
    store.delete("room")
    store.delete("room")
    store.close()
    again = Store(path)
    assert again.all() == {"hall": StoredStream('{"source": "b"}', 2)}
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


def test_a_folder_that_cannot_be_made_is_refused(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(ConfigError, match=r"cannot be opened: .*--data"):
        Store(tmp_path / "file" / "store.sqlite")
