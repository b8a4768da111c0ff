"""How the command line, the environment and the defaults make up a stream's settings."""

from __future__ import annotations

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
        ("{", {}, "is no JSON"),
        ('{"source": "a:", "band": 3}', {}, "setting band"),
        (None, {"source": "a:", "bands": 99}, "setting bands: .*less than or equal to 8"),
        (None, {"source": "a:", "mapping": {"disc": (1.0, 2.0)}}, "setting mapping.disc"),
    ],
)
def test_errors_name_the_setting(document: str | None, changes: dict[str, object], message: str) -> None:
    with pytest.raises(LightwellError, match=message):
        stream_settings(document, changes)
