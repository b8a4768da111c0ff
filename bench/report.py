"""Rows of a bench, and how they are printed and timed."""

from __future__ import annotations

import statistics
import sys
import time
from collections.abc import Callable, Mapping
from typing import NotRequired, TypedDict

from rich.console import Console
from rich.table import Table


class Row(TypedDict):
    """One figure; ``ratio`` is ``value / baseline`` of the same run."""

    name: str
    value: float
    unit: str
    baseline: NotRequired[float]
    ratio: NotRequired[float]


def row(name: str, value: float, unit: str, baseline: float | None = None) -> Row:
    """Return a row, with its ratio to a baseline measured in the same run."""
    if baseline is None:
        return Row(name=name, value=value, unit=unit)
    return Row(name=name, value=value, unit=unit, baseline=baseline, ratio=value / baseline)


def print_table(title: str, rows: list[Row]) -> None:
    """Print rows for people."""
    table = Table(title=title, title_justify="left")
    for heading in ("figure", "value", "unit", "baseline", "ratio"):
        table.add_column(heading, justify="left" if heading in ("figure", "unit") else "right")
    for item in rows:
        baseline, ratio = item.get("baseline"), item.get("ratio")
        table.add_row(
            item["name"],
            f"{item['value']:.4g}",
            item["unit"],
            "" if baseline is None else f"{baseline:.4g}",
            "" if ratio is None else f"{ratio:.3g}",
        )
    Console(file=sys.stdout).print(table)


def interleaved_medians(functions: Mapping[str, Callable[[], object]], repeats: int = 15) -> dict[str, float]:
    """Return the median milliseconds of each function, called in turn so that a drift of the machine hits all alike.

    Every function runs once before the clock starts (compilation, caches).
    """
    for function in functions.values():
        function()
    milliseconds: dict[str, list[float]] = {name: [] for name in functions}
    for _ in range(repeats):
        for name, function in functions.items():
            start = time.perf_counter_ns()
            function()
            milliseconds[name].append((time.perf_counter_ns() - start) / 1e6)
    return {name: statistics.median(values) for name, values in milliseconds.items()}
