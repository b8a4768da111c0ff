"""``lightwell field``: several probes at known places, and the light between them."""

from __future__ import annotations

import json as json_module
from typing import TYPE_CHECKING, Any, Literal

import typer

from lightwell.conventions import Convention
from lightwell_server.cli.connection import JSON, SERVER, TOKEN, connect

if TYPE_CHECKING:
    from lightwell_client import FieldLight
    from lightwell_client.rest import FieldInfo

field_commands = typer.Typer(help="Combine streams whose probes stand at known places.", no_args_is_help=True)

NAME = typer.Argument(help="Name of the field.")
STREAMS = typer.Argument(help="Names of its streams.")
CONVENTION = typer.Option("lightwell", help="Axes, signs, order and scale of the coefficients.")
BANDS = typer.Option(None, min=1, max=8, help="At most this many bands.")
Method = Literal["barycentric", "shepard"]
METHOD = typer.Option("barycentric", help="Weights of the samples: barycentric, or shepard (by distance).")


@field_commands.command("list")
def list_fields(server: str = SERVER, token: str | None = TOKEN, json: bool = JSON) -> None:
    """List the fields and their streams."""
    import msgspec

    with connect(server, token) as client:
        found = client.fields()
    if json:
        print(json_module.dumps(msgspec.to_builtins(found)))
        return
    for field in found:
        used = sum(member.used for member in field.members)
        print(f"{field.name:24} {used} of {len(field.members)} streams give light: {', '.join(field.streams)}")
    if not found:
        print("no fields yet: lightwell field create NAME STREAM STREAM …")


@field_commands.command("show")
def show(name: str = NAME, server: str = SERVER, token: str | None = TOKEN, json: bool = JSON) -> None:
    """Describe a field: which of its streams give light now, and why the others do not."""
    with connect(server, token) as client:
        _print(client.field(name), as_json=json)


@field_commands.command("create")
def create(
    name: str = NAME,
    streams: list[str] = STREAMS,
    server: str = SERVER,
    token: str | None = TOKEN,
    json: bool = JSON,
) -> None:
    """Combine streams; each needs a place (position_m of its settings, or a source that knows it)."""
    with connect(server, token) as client:
        _print(client.create_field(name, streams), as_json=json)


@field_commands.command("set")
def set_streams(
    name: str = NAME,
    streams: list[str] = STREAMS,
    server: str = SERVER,
    token: str | None = TOKEN,
    json: bool = JSON,
) -> None:
    """Make a field of other streams."""
    with connect(server, token) as client:
        _print(client.update_field(name, streams), as_json=json)


@field_commands.command("delete")
def delete(name: str = NAME, server: str = SERVER, token: str | None = TOKEN) -> None:
    """Delete a field; its streams stay."""
    with connect(server, token) as client:
        client.delete_field(name)


@field_commands.command("sample")
def sample(
    name: str = NAME,
    at: list[str] = typer.Option(..., metavar="X,Y,Z", help="A point in world metres; may be repeated."),
    method: Method = METHOD,
    convention: Convention = CONVENTION,
    bands: int | None = BANDS,
    server: str = SERVER,
    token: str | None = TOKEN,
    json: bool = JSON,
) -> None:
    """Print the light at points, from the newest frames."""
    import msgspec

    points = _points(at)
    with connect(server, token) as client:
        found = client.sample_field(name, points, method=method, convention=convention, bands=bands)
    if json:
        print(json_module.dumps(msgspec.to_builtins(found, enc_hook=lambda array: array.tolist())))
        return
    for point in found.points:
        _print_light(list(point.at), point.coefficients)
    lacking = [member.stream for member in found.members if member.used and not member.gradients]
    slopes = "with gradients" if found.gradients else "without gradients"
    print(f"{slopes}; not of {', '.join(lacking)}" if found.gradients and lacking else slopes)
    for member in found.members:
        if member.problem:
            print(f"without {member.stream}: {member.problem}")


@field_commands.command("watch")
def watch(
    name: str = NAME,
    at: list[str] = typer.Option(
        [], metavar="X,Y,Z", help="A point in metres along the convention's axes; may be repeated."
    ),
    method: Method = METHOD,
    count: int | None = typer.Option(None, min=1, help="Stop after so many times of new light."),
    convention: Convention = CONVENTION,
    bands: int | None = BANDS,
    max_fps: float | None = typer.Option(4.0, min=0.01, help="Frames of each stream a second."),
    server: str = SERVER,
    token: str | None = TOKEN,
    json: bool = JSON,
) -> None:
    """Follow a field: the mean of its probes, or the light at points, whenever there is newer; reconnects by itself."""
    from lightwell.errors import LightwellError
    from lightwell_client import Field

    points = _points(at)
    try:
        field = Field(name, server, bands=bands, convention=convention, max_fps=max_fps, token=token)
    except ValueError as error:
        raise LightwellError(f"--server: {error}") from None
    try:
        with field:
            _follow(field, points, method, count, as_json=json)
    except KeyboardInterrupt:
        raise typer.Exit(130) from None


def _follow(field: Any, points: list[Any], method: Method, count: int | None, *, as_json: bool) -> None:  # noqa: ANN401
    import sys

    from lightwell_client import LightTimeoutError

    taken, said = 0, ""
    while count is None or taken < count:
        try:
            light = field.next(within_seconds=2.0)
        except LightTimeoutError as error:
            if str(error) != said:
                print(f"lightwell: {error}", file=sys.stderr, flush=True)
            said = str(error)
            continue
        taken, said = taken + 1, ""
        _print_moment(light, points, method, as_json=as_json)


def _print_moment(light: FieldLight, points: list[Any], method: Method, *, as_json: bool) -> None:
    places = points or light.positions.mean(axis=0)[None].tolist()
    values = light.at(places, method)
    if as_json:
        document = {
            "field": light.field,
            "points": [
                {"at": list(place), "coefficients": value.tolist()} for place, value in zip(places, values, strict=True)
            ],
            "streams": {
                name: {"seq": frame.seq, "position": None if frame.position is None else frame.position.tolist()}
                for name, frame in light.frames.items()
            },
            "problems": dict(light.problems),
        }
        print(json_module.dumps(document), flush=True)
        return
    shown = "   ".join(
        f"{_place(place)} R {value[0, 0]:.4g} G {value[0, 1]:.4g} B {value[0, 2]:.4g}"
        for place, value in zip(places, values, strict=True)
    )
    left_out = "".join(f"   without {name}: {problem}" for name, problem in light.problems.items())
    print(f"{len(light.frames)} streams   {shown}{left_out}", flush=True)


def _print(field: FieldInfo, *, as_json: bool) -> None:
    import msgspec

    if as_json:
        print(json_module.dumps(msgspec.to_builtins(field)))
        return
    print(f"{field.name}: {field.subscribers} subscribers")
    for member in field.members:
        place = "place unknown" if member.position_m is None else f"at {_place(member.position_m)} m"
        slope = "with gradients" if member.gradients else "without gradients"
        print(f"  {member.stream:24} {member.state:10} {place}, {slope}{member.problem and ': '}{member.problem}")


def _print_light(place: list[float], coefficients: Any) -> None:  # noqa: ANN401
    print(f"at {_place(place)} m")
    for index, row in enumerate(coefficients):
        print(f"  {index:2} " + " ".join(f"{value:12.6g}" for value in row))


def _place(values: Any) -> str:  # noqa: ANN401
    return "(" + ", ".join(f"{value:g}" for value in values) + ")"


def _points(texts: list[str]) -> list[tuple[float, float, float]]:
    from lightwell_server.cli.grid import parse_vector

    return [parse_vector("--at", text) for text in texts]
