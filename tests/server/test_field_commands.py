"""``lightwell field``, and gradients on the command line."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from tests.support.publisher import Publisher
from tests.support.server import running_server, wait_until
from typer.testing import CliRunner

from lightwell.errors import LightwellError
from lightwell.io.exr import write_rgb
from lightwell.probe.latlong import LatLong
from lightwell.synthetic.room import Room
from lightwell.wire import pack_coefficients
from lightwell_client import Lightwell, ProblemError
from lightwell_server.cli import app

GRADIENTS = pack_coefficients(np.full((9, 3, 3), 0.25))


def lightwell(*arguments: str) -> str:
    """Run a command in this process; its errors are raised."""
    result = CliRunner().invoke(app, list(arguments))
    if result.exception is not None and not isinstance(result.exception, SystemExit):
        raise result.exception
    assert result.exit_code == 0, result.output
    return result.output


def test_fields_are_made_looked_at_and_deleted(tmp_path: Path) -> None:
    with running_server(tmp_path) as url, Publisher(url, "left") as left, Publisher(url, "right") as right:
        left.publish(position=(0.0, 0.0, 1.0), gradients=GRADIENTS, trust_radius_m=0.3)
        right.publish(position=(1.0, 0.0, 1.0), gradients=GRADIENTS)
        with Lightwell(url) as client:
            wait_until(lambda: all(stream.frames_received for stream in client.streams()))
        at_server = ("--server", url)
        assert "no fields yet" in lightwell("field", "list", *at_server)
        made = lightwell("field", "create", "stage", "left", "right", *at_server)
        assert "left                     running    at (0, 0, 1) m, with gradients" in made
        assert "2 of 2 streams give light: left, right" in lightwell("field", "list", *at_server)
        assert json.loads(lightwell("field", "list", "--json", *at_server))[0]["streams"] == ["left", "right"]

        sampled = lightwell("field", "sample", "stage", "--at", "0.5,0,1", "--at", "0,0,2", *at_server)
        assert "at (0.5, 0, 1) m" in sampled
        assert "with gradients" in sampled
        document = json.loads(lightwell("field", "sample", "stage", "--at", "0.5,0,1", "--json", *at_server))
        assert len(document["points"][0]["coefficients"]) == 9
        watched = lightwell("field", "watch", "stage", "--count", "1", "--at", "0.5,0,1", "--json", *at_server)
        assert json.loads(watched.splitlines()[0])["points"][0]["at"] == [0.5, 0, 1]
        assert "streams   (" in lightwell("field", "watch", "stage", "--count", "1", *at_server)

        assert "left" not in lightwell("field", "set", "stage", "right", *at_server)
        with pytest.raises(ProblemError, match="there is no stream 'nobody'"):
            lightwell("field", "set", "stage", "nobody", *at_server)
        with pytest.raises(LightwellError, match="--at: '1,2': must be three numbers"):
            lightwell("field", "sample", "stage", "--at", "1,2", *at_server)
        lightwell("field", "delete", "stage", *at_server)
        with pytest.raises(ProblemError, match="there is no field 'stage'"):
            lightwell("field", "show", "stage", *at_server)

        command = [sys.executable, "-m", "lightwell_server.cli", "watch", "left", "--json", "--count", "1", *at_server]
        plain = json.loads(subprocess.run(command, capture_output=True, check=True, timeout=100).stdout)
        assert (plain["gradients"], plain["position"], plain["trust_radius_m"]) == (None, [0, 0, 1], 0.3)
        asked = [*command, "--gradients", "--convention", "three"]
        turned = json.loads(subprocess.run(asked, capture_output=True, check=True, timeout=100).stdout)
        assert np.shape(turned["gradients"]) == (9, 3, 3)
        assert turned["position"] == [0, 1, 0]


def test_project_prints_gradients(tmp_path: Path) -> None:
    room, at, step = Room(lights=0), (0.3, -0.2, 0.4), 1e-3
    lower, upper = (",".join(map(str, corner)) for corner in room.bounds())
    latlong = LatLong(64, 128)
    directions, _ = latlong.directions(*latlong.pixel_centres())
    picture = tmp_path / "probe.exr"
    write_rgb(picture, room.radiance(directions, 0.0, at).astype(np.float32))
    box = ("--proxy", "box", "--box-lower", lower, "--box-upper", upper)
    there = ("--position", "0.3,-0.2,0.4")
    document = json.loads(lightwell("project", str(picture), *box, *there, "--json", "--bands", "3"))
    ahead, behind = (room.coefficients(3, 0.0, (0.3, -0.2, 0.4 + sign * step)) for sign in (1, -1))
    along_z = (ahead - behind) / (2 * step)
    error = np.linalg.norm(np.array(document["gradients"])[..., 2] - along_z) / np.linalg.norm(along_z)
    assert error < 0.06
    assert 0.3 < document["trust_radius_m"] < 0.5
    unity = json.loads(lightwell("project", str(picture), *box, *there, "--json", "--convention", "unity"))
    assert np.shape(unity["gradients"]) == (25, 3, 3)
    assert "Right to about 10 % within" in lightwell(
        "project", str(picture), "--proxy", "sphere", "--proxy-radius-m", "2"
    )
    for options, reason in (
        (box, "needs the probe's place"),
        ((*box, "--position", "9,0,0"), "--proxy: gradients: the box spans x"),
        (("--proxy", "sphere"), "needs radius_m"),
        (("--proxy", "sphere", "--proxy-radius-m", "1", "--bands", "9"), "--proxy: bands"),
    ):
        with pytest.raises(LightwellError, match=reason):
            lightwell("project", str(picture), *options)
