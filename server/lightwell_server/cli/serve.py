"""``lightwell serve``: the daemon."""

from __future__ import annotations

from pathlib import Path

import typer


def serve(
    config: Path | None = typer.Option(None, "--config", help="TOML file (default: lightwell.toml, if there is one)."),
    host: str | None = typer.Option(None, help="Address to listen on (default: 127.0.0.1)."),
    port: int | None = typer.Option(None, min=0, max=65535, help="TCP port (default: 8400; 0: a free one)."),
    data: Path | None = typer.Option(None, help="Folder for what must survive a restart (default: data)."),
) -> None:
    """Serve the API, the live streams and the web page; run one ingest worker a stream."""
    from lightwell_server.config import load_config
    from lightwell_server.runner import Server
    from lightwell_workers.ingest.log import configure_logging

    settings = load_config(config, {"host": host, "port": port, "data_dir": data})
    configure_logging(log_format=settings.log.format, level=settings.log.level)
    server = Server(settings)
    print(f"Lightwell serves {server.url}", flush=True)
    try:
        server.run()
    except KeyboardInterrupt:
        raise typer.Exit(130) from None
