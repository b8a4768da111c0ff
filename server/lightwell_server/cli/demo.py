"""``lightwell demo``: the whole system on sample data."""

from __future__ import annotations

import asyncio
import subprocess
import sys
import threading
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, TypedDict

import typer

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from lightwell_client import Job, LightFrame, Lightwell
    from lightwell_server.config import Config

FIRST_FRAME_SECONDS = 120.0
"""Time for a stream's first frame: kernels are compiled on the first run."""
WARM_UP_SECONDS = 1.0
MEASURE_SECONDS = 4.0
STOP_SECONDS = 15.0
SHOWN_COEFFICIENTS = 9
SAMPLE_CAPTURE = "demo"
SAMPLE_PROBES = 300
SAMPLE_SIZE = 64
SAMPLE_RESOLUTION = 16


class Latency(TypedDict):
    """Capture to client, milliseconds."""

    p50: float
    p99: float


class StreamSummary(TypedDict):
    """What a client saw of one stream."""

    name: str
    frames: int
    fps: float
    missed: int
    latency_ms: Latency
    coefficients: list[list[float]]


class JobSummary(TypedDict):
    """What became of the sample job."""

    id: str
    kind: str
    state: str
    seconds: float
    error_relative: float | None


class Summary(TypedDict):
    """What ``demo --once`` prints."""

    streams: list[StreamSummary]
    jobs: list[JobSummary]
    ok: bool


def demo(
    once: bool = typer.Option(False, "--once", help="Run everything for a few seconds, print a summary and end."),
    json: bool = typer.Option(False, "--json", help="With --once: print the summary as JSON."),
    port: int | None = typer.Option(None, min=0, max=65535, help="TCP port (default: 8400; with --once: a free one)."),
    data: Path | None = typer.Option(None, help="Folder for the samples and the server's data (default: data)."),
    bare: bool = typer.Option(False, "--bare", hidden=True, help="Leave the sample job to who started this."),
) -> None:
    """Serve sample streams (two recordings, two probes in a synthetic room) and make a grid of a sample capture."""
    if once:
        summary = _run_once(0 if port is None else port, data)
        _print_summary(summary, as_json=json)
        raise typer.Exit(0 if summary["ok"] else 1)
    _serve(port, data, watch_job=not bare)


def _serve(port: int | None, data: Path | None, *, watch_job: bool) -> None:
    from lightwell_server.config import load_config
    from lightwell_server.runner import Server
    from lightwell_workers.ingest.log import configure_logging
    from lightwell_workers.ingest.samples import FIELDS, make_samples

    config = load_config(None, {"port": port, "data_dir": data})
    configure_logging(log_format=config.log.format, level=config.log.level)
    with _progress() as report:
        samples = make_samples(config.server.data_dir / "samples", report)
        make_sample_capture(config.server.data_dir, report)
    server = Server(config.model_copy(update={"streams": samples | config.streams, "fields": FIELDS | config.fields}))
    print(f"Lightwell serves {server.url} (streams: {', '.join(samples)})", flush=True)
    if watch_job:
        threading.Thread(target=_show_sample_job, args=(server.url, config), name="sample job", daemon=True).start()
    try:
        server.run()
    except KeyboardInterrupt:
        raise typer.Exit(130) from None


@contextmanager
def _progress() -> Iterator[Callable[[str, int, int], None] | None]:
    """Give a function that draws progress bars on a terminal, or None elsewhere."""
    if not sys.stderr.isatty():
        yield None
        return
    from rich.console import Console
    from rich.progress import Progress, TaskID

    with Progress(console=Console(stderr=True), transient=True) as progress:
        bars: dict[str, TaskID] = {}

        def report(name: str, done: int, total: int) -> None:
            if name not in bars:
                bars[name] = progress.add_task(f"making sample {name}", total=total)
            progress.update(bars[name], completed=done)

        yield report


def _run_once(port: int, data: Path | None) -> Summary:
    """Start the demo as its own process, follow every stream as a client would, and end it."""
    from lightwell.errors import LightwellError
    from lightwell_client import Lightwell

    command = [sys.executable, "-m", "lightwell_server.supervised", "demo", "--bare", "--port", str(port)]
    if data is not None:
        command += ["--data", str(data)]
    process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    try:
        assert process.stdout is not None
        words = process.stdout.readline().split()
        if len(words) < 3:
            raise LightwellError("the server did not start; the lines above say why")
        url = words[2]
        with Lightwell(url) as server:
            names = [stream.name for stream in server.streams() if stream.settings["enabled"]]
            streams = asyncio.run(_follow_all(url, names))
            # After the streams have been measured: the job takes all cores.
            job = _run_sample_job(server)
        ok = len(streams) > 0 and all(map(_worked, streams)) and job["state"] == "succeeded"
        return Summary(streams=streams, jobs=[job], ok=ok)
    finally:
        process.terminate()
        try:
            process.wait(STOP_SECONDS)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
        for pipe in (process.stdin, process.stdout):
            assert pipe is not None
            pipe.close()


async def _follow_all(url: str, names: list[str]) -> list[StreamSummary]:
    ready = asyncio.Barrier(len(names))
    return list(await asyncio.gather(*(_follow(url, name, ready) for name in names)))


def make_sample_capture(data_dir: Path, report: Callable[[str, int, int], None] | None) -> Path:
    """Simulate the sample capture, if it is not there yet; return its folder."""
    from lightwell.io.simulate import RigSettings, simulate_capture
    from lightwell.synthetic.scene import PRESETS

    directory = data_dir / "captures" / SAMPLE_CAPTURE
    if not directory.exists():
        directory.parent.mkdir(parents=True, exist_ok=True)
        rig = RigSettings(probes=SAMPLE_PROBES, size=SAMPLE_SIZE)
        bar = None if report is None else partial(report, "capture")
        simulate_capture(directory, PRESETS["scene1"], rig, bar)
    return directory


def _submit_sample_job(server: Lightwell) -> Job:
    """Register the sample capture and submit its grid; a second demo on the same data gets the same job."""
    server.register_capture(f"captures/{SAMPLE_CAPTURE}", SAMPLE_CAPTURE)
    settings = {"capture": SAMPLE_CAPTURE, "resolutions": SAMPLE_RESOLUTION}
    return server.submit("ilf-grid", settings, key=f"demo {SAMPLE_PROBES} {SAMPLE_SIZE} {SAMPLE_RESOLUTION}")


def _run_sample_job(server: Lightwell) -> JobSummary:
    """Submit the sample job through the API, tell how far it is, and return what became of it."""
    import json
    import time

    job = _submit_sample_job(server)
    stage = ""
    for event in server.events(job.id):
        if event["type"] == "progress" and event["stage"] != stage:
            stage = event["stage"]
            print(f"job {job.id}: {stage}", file=sys.stderr)
    job = server.job(job.id)
    print(f"job {job.id}: {job.state}{(job.error and ': ' + job.error) or ''}", file=sys.stderr)
    report = next((item for item in job.artifacts if item.path == "report.json"), None)
    error = None if report is None else json.loads(server.artifact(report.id)).get("error_relative")
    seconds = ((job.finished or time.time_ns()) - (job.started or job.created)) / 1e9
    return JobSummary(id=job.id, kind=job.kind, state=job.state, seconds=round(seconds, 3), error_relative=error)


def _show_sample_job(url: str, config: Config) -> None:
    """Submit the sample job when the server answers, and say on the terminal what becomes of it."""
    import time

    from lightwell.errors import LightwellError
    from lightwell_client import Lightwell

    tokens = config.auth.admin_tokens
    with Lightwell(url, token=tokens[0].get_secret_value() if tokens else None) as server:
        for _ in range(100):
            if server.is_alive():
                break
            time.sleep(0.1)
        try:
            summary = _run_sample_job(server)
            if summary["state"] == "succeeded":
                grid = f"{url}/api/v1/grids/{summary['id']}.grid"
                print(f"a grid of {SAMPLE_PROBES} probes is ready: {grid}", file=sys.stderr)
        except LightwellError as error:
            print(f"the sample job: {error}", file=sys.stderr)


async def _follow(url: str, name: str, ready: asyncio.Barrier) -> StreamSummary:
    """Follow one stream; all start to count together, when each has had its first frame."""
    from lightwell_client import AsyncLightStream, LightTimeoutError

    frames: list[LightFrame] = []
    loop = asyncio.get_running_loop()
    async with AsyncLightStream(name, url, newest=False) as light:
        try:
            await light.next(within_seconds=FIRST_FRAME_SECONDS)
            print(f"{name}: first frame", file=sys.stderr)
        except LightTimeoutError as error:
            print(f"{name}: {error}", file=sys.stderr)
        await ready.wait()
        counting_from = loop.time() + WARM_UP_SECONDS
        until = counting_from + MEASURE_SECONDS
        missed_before = 0
        while (left := until - loop.time()) > 0:
            try:
                frame = await light.next(within_seconds=left)
            except LightTimeoutError:
                break
            if loop.time() < counting_from:
                missed_before = light.missed
            else:
                frames.append(frame)
        return _summarise(name, frames, light.missed - missed_before)


def _summarise(name: str, frames: list[LightFrame], missed: int) -> StreamSummary:
    import numpy as np

    from lightwell_server.cli.watch import frame_rate

    latencies = [frame.latency_seconds * 1000 for frame in frames] or [0.0]
    p50, p99 = np.percentile(latencies, [50, 99]).tolist()
    return StreamSummary(
        name=name,
        frames=len(frames),
        fps=round(frame_rate([frame.received_time_ns for frame in frames]), 2),
        missed=missed,
        latency_ms=Latency(p50=round(p50, 2), p99=round(p99, 2)),
        coefficients=frames[-1].coefficients[:SHOWN_COEFFICIENTS].tolist() if frames else [],
    )


def _worked(stream: StreamSummary) -> bool:
    """Return whether light came, and kept coming."""
    import numpy as np

    return stream["frames"] >= 2 and stream["fps"] > 0 and bool(np.isfinite(stream["coefficients"]).all())


def _print_summary(summary: Summary, *, as_json: bool) -> None:
    if as_json:
        import json

        print(json.dumps(summary))
        return
    from rich.console import Console
    from rich.table import Table

    table = Table(title="ok" if summary["ok"] else "not everything worked", title_justify="left")
    for heading in ("stream", "frames", "fps", "missed", "latency p50, ms", "p99, ms", "coefficient 0 (R G B)"):
        table.add_column(heading, justify="left" if heading == "stream" else "right")
    for stream in summary["streams"]:
        first = " ".join(f"{value:.4g}" for value in stream["coefficients"][0]) if stream["coefficients"] else "none"
        latency = stream["latency_ms"]
        table.add_row(
            stream["name"],
            str(stream["frames"]),
            f"{stream['fps']:.1f}",
            str(stream["missed"]),
            f"{latency['p50']:.1f}",
            f"{latency['p99']:.1f}",
            first,
        )
    Console().print(table)
    for job in summary["jobs"]:
        error = "" if job["error_relative"] is None else f", error against the exact field {job['error_relative']:.1%}"
        print(f"job {job['id']} ({job['kind']}): {job['state']} after {job['seconds']:.1f} s{error}")
