"""What every source of frames offers."""

from __future__ import annotations

from collections.abc import Iterator
from types import TracebackType
from typing import Protocol, Self

from lightwell.errors import FrameError
from lightwell_workers.ingest.frame import Frame, Pixels


class Source(Protocol):
    """Frames of captured light, in order.

    Iterating blocks until the next frame is there. A frame that cannot be used comes as a `FrameError` (returned, not
    raised), so that the stream goes on. The iterator ends when the source is at its end or has been closed.
    """

    url: str
    is_live: bool
    """True where frames come at their own pace and the newest wins; False where every frame counts."""
    interval_seconds: float
    """Time between frames, as far as the source knows."""

    @property
    def frames_dropped(self) -> int:
        """Frames that were overtaken by a newer one before they were taken."""

    def first_picture(self) -> Pixels | None:
        """Return the first picture without starting the play, so that tables can be made for its size.

        None where it cannot be had beforehand. Call it before iterating.
        """

    def __iter__(self) -> Iterator[Frame | FrameError]:
        """Return the frames; at most one iteration a source."""

    def close(self) -> None:
        """Wake a waiting iterator and end it; may be called from any thread, and more than once."""

    def __enter__(self) -> Self:
        """Return the source."""

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        """Close it."""
