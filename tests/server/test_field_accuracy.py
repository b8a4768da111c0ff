"""Two probes a metre apart under an area light, through workers, server and client: the light between them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from tests.support.server import running_server, wait_until

from lightwell.synthetic.scene import PRESETS
from lightwell_client import Field, FieldLight, Lightwell

SCENE = PRESETS["panel"]
assert SCENE.room_half is not None
HALF = SCENE.room_half
LEFT, RIGHT = (-0.3, 0.1, 0.5), (0.7, 0.1, 0.5)
BOX = {"proxy": "box", "box_lower_m": [-x for x in HALF], "box_upper_m": list(HALF)}
LINE = np.array(LEFT) + np.linspace(0, 1, 21)[:, None] * np.subtract(RIGHT, LEFT)


def stream(at: tuple[float, float, float], **changes: Any) -> dict[str, Any]:
    source = f"synthetic:panel?fps=10&width=128&at={at[0]},{at[1]},{at[2]}"
    return {"source": source, "backdrop": {"enabled": False}} | changes


def error(light: np.ndarray) -> float:
    exact = SCENE.coefficients(LINE, 5)
    return float(np.linalg.norm(light - exact) / np.linalg.norm(exact))


def both(field: Field, *, gradients: bool) -> FieldLight:
    """Return the light when both streams give it, with gradients or without."""
    while True:
        light = field.next()
        has = [frame.gradients is not None for frame in light.frames.values()]
        if has == [gradients] * 2:
            return light


def test_gradients_make_the_field_between_two_probes_three_times_better(tmp_path: Path) -> None:
    streams = {"left": stream(LEFT), "right": stream(RIGHT)}
    fields = {"stage": {"streams": ["left", "right"]}}
    with (
        running_server(tmp_path, supervisor={"embedded": True}, streams=streams, fields=fields) as url,
        Lightwell(url) as client,
        Field("stage", url, timeout=60) as field,
    ):
        without = error(both(field, gradients=False).at(LINE))
        for name in streams:
            client.update(name, {"gradients": BOX})  # the workers follow while they run
        light = both(field, gradients=True)
        with_gradients = error(light.at(LINE))
        sampled = client.sample_field("stage", LINE)
        client.update("left", {"gradients": {"proxy": "mesh", "mesh": "/nowhere/room.glb"}})
        wait_until(lambda: "settings refused: /nowhere/room.glb" in client.stream("left").last_error)
        both(field, gradients=True)  # and what worked goes on
    print(f"\nerror along the line: {without:.3f} without gradients, {with_gradients:.3f} with")
    assert with_gradients < without / 3
    np.testing.assert_allclose([point.coefficients for point in sampled.points], light.at(LINE), rtol=1e-4, atol=1e-4)
