"""Errors that a user can do something about."""

from __future__ import annotations


class LightwellError(Exception):
    """Base of the errors that name what is wrong and how to mend it; the command line prints no traceback for them."""


class FrameError(LightwellError):
    """One frame cannot be used: names the frame and the reason. The stream goes on.

    Bytes of a file name that are not UTF-8 are written as escapes, so that the error can be printed and sent.
    """

    def __init__(self, frame: str, reason: str) -> None:
        frame = frame.encode(errors="backslashreplace").decode()
        super().__init__(f"{frame}: {reason}")
        self.frame = frame
        self.reason = reason


class SourceError(LightwellError):
    """A source cannot be opened at all: names it, the reason and the remedy."""


class MappingError(LightwellError):
    """The picture's size or the given geometry cannot belong to the mapping."""


class RenderError(LightwellError):
    """A picture cannot be rendered as it was asked for: names the object or the field, the value and the remedy."""


class ProxyError(LightwellError):
    """The geometry round a probe cannot be used: names the value and the remedy."""
