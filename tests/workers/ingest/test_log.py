"""The log of a process: one form for its own lines and for those of libraries."""

from __future__ import annotations

import json
import subprocess
import sys

PROGRAM = """
import logging, sys
from lightwell_workers.ingest.log import configure_logging, stage_logger
configure_logging(*sys.argv[3:], log_format=sys.argv[1], level=sys.argv[2])
stage_logger("source").info("opened")
stage_logger("source").warning("frame skipped")
logging.getLogger("uvicorn.access").info("not worth a line")
try:
    1 / 0
except ZeroDivisionError:
    logging.getLogger("uvicorn.error").exception("route %s", "failed")
"""


def log(*arguments: str) -> str:
    return subprocess.run(
        [sys.executable, "-c", PROGRAM, *arguments], check=True, stderr=subprocess.PIPE, text=True
    ).stderr


def test_away_from_a_terminal_every_line_is_json_and_names_the_stream() -> None:
    opened, skipped, failed = (json.loads(line) for line in log("auto", "info", "room").splitlines())
    assert (opened["event"], opened["stage"], opened["stream"], opened["level"]) == ("opened", "source", "room", "info")
    assert skipped["level"] == "warning"
    assert (failed["event"], failed["logger"], failed["stream"]) == ("route failed", "uvicorn.error", "room")
    assert failed["level"] == "error"
    assert "ZeroDivisionError" in failed["exception"]


def test_the_level_holds_for_both() -> None:
    (failed,) = (json.loads(line) for line in log("json", "error").splitlines())
    assert failed["logger"] == "uvicorn.error"
    assert "stream" not in failed


def test_text_is_for_people() -> None:
    text = log("text", "info")
    opened, skipped, failed, *_ = text.splitlines()
    assert "opened" in opened
    assert "frame skipped" in skipped
    assert "route failed" in failed
    assert "ZeroDivisionError: " in text
