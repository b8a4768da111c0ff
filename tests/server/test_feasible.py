"""Settings that can never work."""

from __future__ import annotations

from typing import Any

import httpx
import pytest
from tests.support.publisher import Publisher
from tests.support.server import problem

from lightwell.settings import StreamSettings
from lightwell_server.feasible import require_feasible
from lightwell_server.problems import Problem

ROOM = "synthetic:room"


@pytest.mark.parametrize(
    ("settings", "field", "message"),
    [
        ({"source": "foo:bar"}, "source", "There are: exr, video, synthetic, upload"),
        ({"source": "room"}, "source", "has no scheme"),
        ({"source": "exr:"}, "source", "names no files"),
        ({"source": "upload:map.exr"}, "source", "names no upload"),
        ({"source": f"upload:{'0' * 20}?fps=2"}, "source", "has no option 'fps'"),
        ({"source": "exr:x?pace=2"}, "source", "has no option 'pace'"),
        ({"source": "video:x?transfer=gamma"}, "source", "option 'transfer'"),
        ({"source": "synthetic:room?fps=abc"}, "source", "option 'fps'"),
        ({"source": "synthetic:cellar"}, "source", "There are: room, cube"),
        ({"source": "exr:\0"}, "source", "without NUL"),
        ({"source": "exr:\0", "enabled": False}, "source", "without NUL"),
        ({"source": "exr:\ud800"}, "source", "lone surrogates"),
        ({"source": ROOM, "mapping": {"kind": "mirror-sphere"}}, "mapping", "two of: fov_degrees; sphere_radius_m"),
        ({"source": ROOM, "mapping": {"kind": "mirror-sphere", "fov_degrees": 40}}, "mapping", "sphere_distance_m"),
        ({"source": ROOM, "mapping": {"kind": "fisheye"}}, "mapping", "needs fov_degrees"),
        ({"source": ROOM, "mapping": {"kind": "angular", "disc": (5, 5, -1)}}, "mapping", "radius must be positive"),
        (
            {"source": ROOM, "mapping": {"kind": "angular", "forward": (0, 1, 0), "up": (0, 2, 0)}},
            "mapping.forward",
            "forward and up do not span",
        ),
        ({"source": ROOM, "weights": "fejer", "mapping": {"kind": "angular"}}, "weights", "use solid-angle"),
    ],
)
def test_what_can_never_work_is_named(settings: dict[str, Any], field: str, message: str) -> None:
    with pytest.raises(Problem) as caught:
        require_feasible(StreamSettings.model_validate(settings), "settings.")
    assert caught.value.status == 422
    assert caught.value.errors is not None
    (error,) = caught.value.errors
    assert error.field == f"settings.{field}"
    assert message in error.message
    assert message in caught.value.detail


@pytest.mark.parametrize(
    "settings",
    [
        {"source": "exr:/nowhere/%04d.exr?fps=24&loop=1"},
        {"source": "video:/nowhere.mov?transfer=pq"},
        {"source": ROOM, "weights": "paper"},
        {"source": ROOM, "mapping": {"kind": "cube", "forward": (0, 1, 0), "up": (0, 1, 0)}},
        {"source": ROOM, "mapping": {"kind": "fisheye", "fov_degrees": 200, "disc": (300, 200, 180)}},
        {"source": ROOM, "mapping": {"kind": "mirror-ball", "disc": (300, 200, 180)}},
        {"source": ROOM, "mapping": {"kind": "mirror-sphere", "fov_degrees": 40, "disc": (300, 200, 180)}},
        {
            "source": ROOM,
            "mapping": {
                "kind": "mirror-sphere",
                "fov_degrees": 40,
                "sphere_radius_m": 0.1,
                "sphere_distance_m": 1,
                "disc": (300, 200, 90),
            },
        },
        {"source": "camera of somebody else's", "enabled": False},
    ],
)
def test_what_may_work_passes(settings: dict[str, Any]) -> None:
    require_feasible(StreamSettings.model_validate(settings))


def test_creating_and_changing_streams_asks(api: httpx.Client, server: str) -> None:
    body = {"name": "hall", "settings": {"source": "foo:bar"}}
    (error,) = problem(api.post("/streams", json=body), 422, "invalid-input")["errors"]
    assert error["field"] == "settings.source"
    raw = b'{"name": "hall", "settings": {"source": "exr:\\ud800"}}'
    problem(api.post("/streams", content=raw, headers={"Content-Type": "application/json"}), 422, "invalid-input")
    assert api.get("/streams").json() == {"streams": []}
    api.post("/streams", json={"name": "hall", "settings": {"source": "exr:x"}}).raise_for_status()
    (error,) = problem(api.patch("/streams/hall", json={"mapping": {"kind": "fisheye"}}), 422, "invalid-input")[
        "errors"
    ]
    assert error["field"] == "mapping"
    with Publisher(server, "roof", settings={"source": "lens:7"}):
        assert api.patch("/streams/roof", json={"bands": 2}).status_code == 200
