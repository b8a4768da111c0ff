"""How the command line, the environment and the defaults make up a stream's settings."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

from lightwell.errors import LightwellError
from lightwell_server.cli.ingest import stream_settings


def test_defaults_stand_where_nothing_is_said() -> None:
    settings = stream_settings(None, {"source": "synthetic:room", "bands": None, "filter": {"kind": None}})
    assert settings.model_dump() == type(settings)(source="synthetic:room").model_dump()


def test_changes_reach_into_the_document() -> None:
    document = '{"source": "a:", "filter": {"kind": "alpha", "alpha": 3}, "window": {"kind": "hann"}}'
    settings = stream_settings(document, {"source": None, "filter": {"alpha": 4.0, "kind": None}})
    assert (settings.source, settings.filter.kind, settings.filter.alpha) == ("a:", "alpha", 4.0)
    assert settings.window.kind == "hann"


@pytest.mark.parametrize(
    ("document", "changes", "message"),
    [
        (None, {"source": None}, "name a source"),
        ("{", {}, "--settings is no JSON"),
        ("[]", {}, r"--settings = \[\]: must be an object"),
        ('{"source": "a:", "band": 3}', {}, "--settings: band is no option: check its spelling"),
        (
            '{"source": "a:", "mapping": "x"}',
            {"mapping": {"kind": None}},
            "--settings: mapping = 'x': must be an object",
        ),
        ('{"source": "a:", "gain": 0}', {"bands": 3}, "--settings: gain = 0: must be greater than 0"),
        (None, {"source": "a:", "bands": 99}, "setting bands = 99: .*less than or equal to 8"),
        (None, {"source": "a:", "gain": float("inf")}, "setting gain = inf: must be a finite number"),
        (None, {"source": "a:", "mapping": {"disc": (1.0, 2.0)}}, "setting mapping.disc.2 is missing"),
    ],
)
def test_errors_name_the_setting(document: str | None, changes: dict[str, object], message: str) -> None:
    with pytest.raises(LightwellError, match=message):
        stream_settings(document, changes)


@pytest.mark.parametrize("place", ["--settings", "LIGHTWELL_STREAM_SETTINGS"])
def test_the_command_names_where_the_document_comes_from(place: str) -> None:
    command = [sys.executable, "-m", "lightwell_server.cli", "ingest", "--stream", "x"]
    document = {"LIGHTWELL_STREAM_SETTINGS": "[]"} if place != "--settings" else {}
    options = ["--settings", "[]"] if place == "--settings" else []
    result = subprocess.run(
        [*command, *options], capture_output=True, text=True, check=False, timeout=100, env=os.environ | document
    )
    assert (result.returncode, result.stderr) == (
        1,
        f'lightwell: {place} = []: must be an object, such as {{"bands": 3}}\n',
    )
