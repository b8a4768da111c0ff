"""How a worker logs: structured lines on standard error."""

from __future__ import annotations

import logging
import sys

import structlog


def configure_logging(stream: str, *, json: bool, level: int = logging.INFO) -> None:
    """Log to standard error, as JSON lines or as text for people; call once, at the start of the process.

    Every line names the ``stream``, whichever thread writes it: a server's workers share one log.
    """

    def name_stream(_logger: object, _method: str, event: structlog.typing.EventDict) -> structlog.typing.EventDict:
        return {"stream": stream, **event}

    renderers: list[structlog.typing.Processor] = (
        [structlog.processors.format_exc_info, structlog.processors.JSONRenderer()]
        if json
        else [structlog.dev.ConsoleRenderer(colors=sys.stderr.isatty())]
    )
    structlog.configure(
        processors=[
            name_stream,
            structlog.processors.add_log_level,
            structlog.processors.TimeStamper(fmt="iso", utc=True),
            *renderers,
        ],
        wrapper_class=structlog.make_filtering_bound_logger(level),
        logger_factory=structlog.PrintLoggerFactory(file=sys.stderr),
    )


def stage_logger(stage: str) -> structlog.typing.FilteringBoundLogger:
    """Return the logger of one stage: its name is a field of every line."""
    logger: structlog.typing.FilteringBoundLogger = structlog.get_logger(stage=stage)
    return logger
