"""The database that holds the queue: SQLite in the data folder, or Postgres by URL."""

from __future__ import annotations

import contextlib
import logging
import sqlite3
from pathlib import Path

from dbos import DBOS

from lightwell.errors import LightwellError
from lightwell_workers.jobs.job import QueueError

APPLICATION = "lightwell"
VERSION = "1"
"""Of the steps' order. DBOS resumes a job only under the version that began it: raise it when that order changes."""
QUEUE = "jobs"


def database_url(url: str, data_dir: Path) -> str:
    """Return the URL of the queue's database."""
    return url or f"sqlite:///{(data_dir / 'jobs.sqlite').absolute()}"


def migrate(url: str) -> None:
    """Bring the database up to date; every process does so first. Concurrent calls are fine.

    Raises
    ------
    QueueError
        Where it cannot be reached or written.
    """
    silence()
    try:
        if url.startswith("sqlite:///"):
            path = Path(url.removeprefix("sqlite:///"))
            path.parent.mkdir(parents=True, exist_ok=True)
            # DBOS leaves SQLite's rollback journal on; write-ahead mode is three times as fast.
            with contextlib.closing(sqlite3.connect(path, timeout=30)) as connection:
                connection.execute("PRAGMA journal_mode=WAL")
        DBOS.migrate(url)
    except Exception as error:
        reason = str(error).strip().splitlines()[0] if str(error).strip() else type(error).__name__
        raise QueueError(f"the queue's database cannot be used: {reason}; see [jobs] database_url") from None


def silence() -> None:
    """Keep DBOS's banner, migrations and the tracebacks of cancelled jobs out of the log."""
    logging.getLogger("dbos").setLevel(logging.ERROR)
    logging.getLogger("dbos").addFilter(_is_news)


def _is_news(record: logging.LogRecord) -> bool:
    error = record.exc_info[1] if record.exc_info else None
    return not (error is not None and ("Cancelled" in type(error).__name__ or isinstance(error, LightwellError)))
