"""``lightwell work``: one job executor, beside a server or alone."""

from __future__ import annotations

from pathlib import Path

import typer

from lightwell_workers.ingest.log import LogFormat, LogLevel


def work(
    server_config: Path | None = typer.Option(
        None, "--server-config", help="TOML file of the server whose queue it works on (default: lightwell.toml)."
    ),
    data: Path | None = typer.Option(None, help="The server's data folder (default: data)."),
    settings: str | None = typer.Option(
        None, envvar="LIGHTWELL_JOBS_SETTINGS", hidden=True, help="[jobs] as JSON, from a server that starts this."
    ),
    log_format: LogFormat = typer.Option("auto", help="auto: text on a terminal, else JSON."),
    log_level: LogLevel = typer.Option("info", help="What is worth a line."),
) -> None:
    """Work on the jobs of a queue until it is stopped; what is not finished then goes on later."""
    import signal
    import threading

    from pydantic import ValidationError

    from lightwell.errors import LightwellError
    from lightwell.job_settings import JobsSettings
    from lightwell_server.config import load_config
    from lightwell_workers.ingest.log import configure_logging
    from lightwell_workers.jobs.executor import run_executor

    configure_logging(log_format=log_format, level=log_level)
    config = load_config(server_config, {"data_dir": data})
    jobs = config.jobs
    if settings is not None:
        try:
            jobs = JobsSettings.model_validate_json(settings)
        except ValidationError as error:
            raise LightwellError(f"LIGHTWELL_JOBS_SETTINGS: {error.errors()[0]['msg']}") from None
    stop = threading.Event()
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda *_: stop.set())
    run_executor(jobs, config.server.data_dir, stop)
    # Threads of interrupted jobs may still hold on to something; their checkpoints are on disk.
    import os

    os._exit(0)
