"""Structured logs of workers and server on standard error: lines for people on a terminal, JSON elsewhere."""

from __future__ import annotations

import logging
import sys
from typing import Literal

import structlog

LogFormat = Literal["auto", "text", "json"]
LogLevel = Literal["debug", "info", "warning", "error"]


def resolve_format(log_format: LogFormat) -> Literal["text", "json"]:
    """Return the format that ``auto`` stands for: text where standard error is a terminal."""
    if log_format == "auto":
        return "text" if sys.stderr.isatty() else "json"
    return log_format


def configure_logging(stream: str = "", *, log_format: LogFormat = "auto", level: LogLevel = "info") -> None:
    """Log to standard error from ``level`` on; call once, at the start of the process.

    Every line names the ``stream``, where one is given, whichever thread writes it: a server's workers share one log.
    What libraries log with the standard `logging` comes out in the same form, from warnings on.
    """
    threshold = logging.getLevelNamesMapping()[level.upper()]

    def name_stream(_logger: object, _method: str, event: structlog.typing.EventDict) -> structlog.typing.EventDict:
        return {"stream": stream, **event} if stream else event

    common: list[structlog.typing.Processor] = [
        name_stream,
        structlog.processors.add_log_level,
        structlog.processors.TimeStamper(fmt="iso", utc=True),
    ]
    renderers: list[structlog.typing.Processor] = (
        [structlog.processors.format_exc_info, structlog.processors.JSONRenderer()]
        if resolve_format(log_format) == "json"
        else [structlog.dev.ConsoleRenderer(colors=sys.stderr.isatty())]
    )
    structlog.configure(
        processors=[*common, *renderers],
        wrapper_class=structlog.make_filtering_bound_logger(threshold),
        logger_factory=structlog.PrintLoggerFactory(file=sys.stderr),
    )
    handler = logging.StreamHandler(sys.stderr)
    handler.setFormatter(
        structlog.stdlib.ProcessorFormatter(
            foreign_pre_chain=[*common, structlog.stdlib.add_logger_name],
            processors=[structlog.stdlib.ProcessorFormatter.remove_processors_meta, *renderers],
        )
    )
    logging.basicConfig(level=max(threshold, logging.WARNING), handlers=[handler])


def stage_logger(stage: str) -> structlog.typing.FilteringBoundLogger:
    """Return the logger of one stage: its name is a field of every line."""
    logger: structlog.typing.FilteringBoundLogger = structlog.get_logger(stage=stage)
    return logger
