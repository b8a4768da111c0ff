"""The ``lightwell`` command: one module a command, imported here, heavy imports inside the functions."""

from __future__ import annotations

import sys

import typer

from lightwell._version import __version__
from lightwell.errors import LightwellError
from lightwell_server.cli.capture import capture_commands
from lightwell_server.cli.demo import demo
from lightwell_server.cli.doctor import doctor
from lightwell_server.cli.field import field_commands
from lightwell_server.cli.grid import grid_commands
from lightwell_server.cli.ingest import ingest
from lightwell_server.cli.jobs import cancel, job, jobs, retry, submit
from lightwell_server.cli.project import project
from lightwell_server.cli.render import render
from lightwell_server.cli.serve import serve
from lightwell_server.cli.watch import watch
from lightwell_server.cli.work import work

app = typer.Typer(
    name="lightwell",
    help="Captures real light and serves it live.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)


def _print_version(wanted: bool) -> None:
    if wanted:
        print(f"lightwell {__version__}")
        raise typer.Exit


@app.callback()
def _root(
    version: bool = typer.Option(False, "--version", callback=_print_version, is_eager=True, help="Print the version."),
) -> None:
    """Capture real light and serve it live."""


for command in (serve, demo, ingest, work, watch, project, render, submit, jobs, job, cancel, retry, doctor):
    app.command()(command)
app.add_typer(capture_commands, name="capture")
app.add_typer(grid_commands, name="grid")
app.add_typer(field_commands, name="field")


def main() -> None:
    """Run the command line; an error that the user can mend is one line on standard error and exit status 1."""
    try:
        app()
    except LightwellError as error:
        print(f"lightwell: {error}", file=sys.stderr)
        sys.exit(1)
    except OSError as error:
        if error.filename is None:
            raise
        print(f"lightwell: {error.filename}: {error.strerror}", file=sys.stderr)
        sys.exit(1)
