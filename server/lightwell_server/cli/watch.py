"""``lightwell watch``: follow a stream in the terminal."""

from __future__ import annotations

import math
from collections import deque
from typing import TYPE_CHECKING

import typer

from lightwell.errors import LightwellError

if TYPE_CHECKING:
    from rich.table import Table

    from lightwell_client import LightFrame, LightStream

BARS = "▁▂▃▄▅▆▇█"
HISTORY = 48
DRAWS_PER_SECOND = 8


def watch(
    stream: str = typer.Argument(help="Name of the stream."),
    server: str = typer.Option("http://127.0.0.1:8400", help="URL of the server."),
    count: int | None = typer.Option(None, min=1, help="Stop after this many frames."),
    json: bool = typer.Option(False, "--json", help="Print every frame as one line of JSON."),
    convention: str = typer.Option("lightwell", help="lightwell, three, filament, unity, unreal or sloan."),
    bands: int | None = typer.Option(None, min=1, max=8, help="At most this many bands."),
    gradients: bool = typer.Option(False, "--gradients", help="Also how the light changes beside the probe."),
    token: str | None = typer.Option(None, envvar="LIGHTWELL_TOKEN", help="The server's token."),
) -> None:
    """Show the light of STREAM as it comes; reconnects by itself."""
    from lightwell.conventions import CONVENTIONS
    from lightwell_client import LightStream

    chosen = next((name for name in CONVENTIONS if name == convention), None)
    if chosen is None:
        raise typer.BadParameter(f"{convention!r}: must be one of {', '.join(CONVENTIONS)}", param_hint="--convention")
    try:
        light = LightStream(
            stream, server, bands=bands, convention=chosen, gradients=gradients, token=token, newest=not json
        )
    except ValueError as error:
        raise LightwellError(f"--server: {error}") from None
    try:
        with light:
            if json:
                _print_lines(light, count)
            else:
                _show_table(light, count)
    except KeyboardInterrupt:
        raise typer.Exit(130) from None


def _print_lines(light: LightStream, count: int | None) -> None:
    """Print frames as they come; on standard error, why there is no connection, once for each reason."""
    import json
    import sys

    from lightwell_client import LightTimeoutError

    taken, said = 0, ""
    while count is None or taken < count:
        try:
            print(json.dumps(light.next(within_seconds=1.0).as_json()), flush=True)
            taken, said = taken + 1, ""
        except LightTimeoutError:
            if light.last_error not in ("", said):
                print(f"lightwell: no connection: {light.last_error}", file=sys.stderr, flush=True)
            said = light.last_error


def _show_table(light: LightStream, count: int | None) -> None:
    from rich.console import Console
    from rich.live import Live

    from lightwell_client import LightTimeoutError

    history: deque[LightFrame] = deque(maxlen=HISTORY)
    taken = 0
    with Live(_table(light, history), console=Console(), refresh_per_second=DRAWS_PER_SECOND) as live:
        while count is None or taken < count:
            try:
                history.append(light.next(within_seconds=1.0))
                taken += 1
            except LightTimeoutError:
                pass  # the table shows the connection's state and the age of the last frame
            live.update(_table(light, history))


def _table(light: LightStream, history: deque[LightFrame]) -> Table:
    import time

    import numpy as np
    from rich.table import Table

    info, status = light.info, light.status
    table = Table(show_header=False, title=f"stream {info.name}" if info else "connecting …", title_justify="left")
    table.add_column(style="bold")
    table.add_column(min_width=HISTORY)
    connection = "connected" if light.connected else "not connected, trying again"
    table.add_row("connection", f"{connection}, {light.reconnects} reconnects")
    if light.last_error:
        table.add_row("", light.last_error)
    if info is not None:
        table.add_row("source", f"{info.source} ({info.mapping}, {status.state if status else info.state})")
    if status is not None and status.last_error:
        table.add_row("last error", status.last_error)
    if not history:
        table.add_row("light", "no frame yet")
        return table
    newest = history[-1]
    age = (time.time_ns() - (newest.publish_time_ns if newest.from_hello else newest.received_time_ns)) / 1e9
    arrived = [frame for frame in history if not frame.from_hello]
    latencies = sorted(frame.latency_seconds * 1000 for frame in arrived)
    table.add_row("frame", f"{newest.seq}, {age:.1f} s ago, {light.missed} missed")
    table.add_row("rate", f"{frame_rate([frame.received_time_ns for frame in arrived]):.1f} frames/s")
    if latencies:
        table.add_row("latency", f"{latencies[len(latencies) // 2]:.1f} ms median, {latencies[-1]:.1f} ms longest")
    irradiance = [mean_irradiance(frame) for frame in history]
    table.add_row("irradiance", f"{sparkline(irradiance)} {irradiance[-1]:.4g} ({newest.units})")
    red, green, blue = newest.coefficients[0].tolist()
    table.add_row(
        "coefficient 0", f"R {red:.5g}  G {green:.5g}  B {blue:.5g} ({newest.convention}, {newest.bands} bands)"
    )
    if newest.position is not None:
        table.add_row("probe at", "  ".join(f"{value:.3f}" for value in newest.position) + " m")
    if newest.gradients is not None:
        change = np.linalg.norm(newest.gradients[0], axis=-1) / np.maximum(np.abs(newest.coefficients[0]), 1e-30)
        radius = newest.trust_radius_m
        reach = "" if radius is None else f", right to about 10 % within {radius:.2g} m"
        table.add_row("gradient", f"the mean changes by {change.max():.0%} a metre{reach}")
    if newest.quality.stage_ms:
        stages = "  ".join(f"{name} {milliseconds:.1f}" for name, milliseconds in newest.quality.stage_ms.items())
        table.add_row("stages, ms", stages)
    return table


def mean_irradiance(frame: LightFrame) -> float:
    """Return the luminance of the irradiance, averaged over all orientations of a surface: π times mean radiance."""
    from lightwell.conventions import LUMINANCE

    first = float(frame.coefficients[0] @ LUMINANCE)
    mean_radiance = first if frame.convention == "unity" else first / math.sqrt(4 * math.pi)
    return math.pi * mean_radiance


def frame_rate(received_ns: list[int]) -> float:
    """Return frames per second of a list of times of arrival; 0 for fewer than two."""
    if len(received_ns) < 2 or received_ns[-1] <= received_ns[0]:
        return 0.0
    return (len(received_ns) - 1) / ((received_ns[-1] - received_ns[0]) / 1e9)


def sparkline(values: list[float]) -> str:
    """Return one bar a value, from the smallest to the largest of them."""
    low, high = min(values), max(values)
    span = high - low
    if span <= 0 or not math.isfinite(span):
        return BARS[0] * len(values)
    return "".join(BARS[min(int((value - low) / span * len(BARS)), len(BARS) - 1)] for value in values)
