"""Streams, fields and captures that were made known through the API, in a SQLite file that survives a restart.

A row of a stream or field holds its whole settings. It wins over what the configuration file has under that name, until
it is deleted. Writes are transactions in write-ahead mode; a server that is killed loses none that was answered.
"""

from __future__ import annotations

import contextlib
import sqlite3
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Literal, NamedTuple, get_args

from lightwell.errors import LightwellError
from lightwell_server.config import ConfigError

SCHEMA_VERSION = 3
Kind = Literal["streams", "fields"]
KINDS: tuple[Kind, ...] = get_args(Kind)


class StoreError(LightwellError):
    """A change could not be written, as on a full disk; what was kept before still is."""


class StoredRow(NamedTuple):
    """One row."""

    settings: str
    """`lightwell.settings.StreamSettings` or `FieldSettings` as JSON."""
    revision: int
    """Counts the changes, from 1."""


class Store:
    """The file; safe to use from several threads."""

    def __init__(self, path: Path) -> None:
        self._lock = threading.Lock()
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            self._connection = sqlite3.connect(path, check_same_thread=False, isolation_level=None)
        except (OSError, sqlite3.Error) as error:
            raise ConfigError(f"{path}: cannot be opened: {error}; give another folder with --data") from None
        try:
            self._prepare(path)
        except sqlite3.Error as error:
            self._connection.close()
            if getattr(error, "sqlite_errorcode", 0) & 0xFF in (sqlite3.SQLITE_NOTADB, sqlite3.SQLITE_CORRUPT):
                raise ConfigError(f"{path}: is no usable database: {error}; move it away to start anew") from None
            raise ConfigError(
                f"{path}: cannot be used: {error}; see to the disk and its permissions, or give another folder with"
                " --data"
            ) from None
        except ConfigError:
            self._connection.close()
            raise

    def _prepare(self, path: Path) -> None:
        self._connection.execute("PRAGMA journal_mode=WAL")
        self._connection.execute("PRAGMA synchronous=FULL")
        (version,) = self._connection.execute("PRAGMA user_version").fetchone()
        if version > SCHEMA_VERSION:
            raise ConfigError(f"{path}: was written by a newer Lightwell; update, or give another folder with --data")
        for table in KINDS:
            self._connection.execute(
                f"CREATE TABLE IF NOT EXISTS {table} (name TEXT PRIMARY KEY,"
                " settings TEXT NOT NULL, revision INTEGER NOT NULL, changed_ns INTEGER NOT NULL)"
            )
        self._connection.execute(
            "CREATE TABLE IF NOT EXISTS captures (id TEXT PRIMARY KEY, directory TEXT NOT NULL) WITHOUT ROWID"
        )
        self._connection.execute(f"PRAGMA user_version={SCHEMA_VERSION}")
        for kind in KINDS:
            self.all(kind)  # a damaged file shows here, where it can be named

    def all(self, kind: Kind) -> dict[str, StoredRow]:
        """Return the streams or fields by name."""
        query = f"SELECT name, settings, revision FROM {kind} ORDER BY name"  # noqa: S608, one of two literals
        with self._lock:
            rows = self._connection.execute(query).fetchall()
        return {name: StoredRow(settings, revision) for name, settings, revision in rows}

    def put(self, kind: Kind, name: str, settings: str, revision: int) -> None:
        """Keep the settings of a stream or field; raises `StoreError`."""
        with self._writing() as connection:
            connection.execute(
                f"INSERT INTO {kind} VALUES (?, ?, ?, ?) ON CONFLICT (name) DO UPDATE SET"  # noqa: S608
                " settings = excluded.settings, revision = excluded.revision, changed_ns = excluded.changed_ns",
                (name, settings, revision, time.time_ns()),
            )

    def delete(self, kind: Kind, name: str) -> None:
        """Forget a stream or field; nothing happens where there is none. Raises `StoreError`."""
        with self._writing() as connection:
            connection.execute(f"DELETE FROM {kind} WHERE name = ?", (name,))  # noqa: S608

    def captures(self) -> dict[str, str]:
        """Return the folders of the registered captures by id."""
        with self._lock:
            return dict(self._connection.execute("SELECT id, directory FROM captures").fetchall())

    def put_capture(self, name: str, directory: str) -> None:
        """Keep a capture's folder; raises `StoreError`."""
        with self._writing() as connection:
            connection.execute("INSERT OR REPLACE INTO captures VALUES (?, ?)", (name, directory))

    def delete_capture(self, name: str) -> None:
        """Forget a capture; raises `StoreError`."""
        with self._writing() as connection:
            connection.execute("DELETE FROM captures WHERE id = ?", (name,))

    @contextlib.contextmanager
    def _writing(self) -> Iterator[sqlite3.Connection]:
        with self._lock:
            try:
                yield self._connection
            except sqlite3.Error as error:
                raise StoreError(f"the data directory cannot keep the change: {error}") from error

    def close(self) -> None:
        """Close the file."""
        with self._lock:
            self._connection.close()
