"""Run benches by name and print them as tables or as one JSON list.

A bench is a module of this folder with ``run() -> list[Row]``; its docstring's first line is its description. It may
have a ``print_report(name, rows)`` of its own where a plain table would be hard to read.
"""

from __future__ import annotations

import argparse
import importlib
import json
import pkgutil
import sys
from pathlib import Path

from bench.report import Row, print_table


def _names() -> list[str]:
    """Return the names of the benches: the modules here that are not part of the harness."""
    harness = {"__main__", "jobs", "report"}
    return sorted(m.name for m in pkgutil.iter_modules([str(Path(__file__).parent)]) if m.name not in harness)


def main() -> int:
    """Run what the command line asks for; returns the exit status."""
    parser = argparse.ArgumentParser(prog="script/bench", description="Measure Lightwell on this machine.")
    parser.add_argument("names", nargs="*", metavar="NAME", help="which benches; without one, list them")
    parser.add_argument("--json", action="store_true", help="print one JSON list instead of tables")
    arguments = parser.parse_args()
    available = _names()
    if unknown := [name for name in arguments.names if name not in available]:
        parser.error(f"no bench {', '.join(unknown)}; there are: {', '.join(available)}")
    if not arguments.names:
        for name in available:
            summary = (importlib.import_module(f"bench.{name}").__doc__ or "").strip().splitlines()[0]
            print(f"{name:12} {summary}")
        return 0
    rows: list[Row] = []
    for name in arguments.names:
        bench = importlib.import_module(f"bench.{name}")
        measured: list[Row] = bench.run()
        rows += measured
        if not arguments.json:
            getattr(bench, "print_report", print_table)(name, measured)
    if arguments.json:
        json.dump(rows, sys.stdout, indent=1)
        print()
    return 0


if __name__ == "__main__":
    sys.exit(main())
