"""Follow a stream from ordinary, blocking code."""

from __future__ import annotations

from collections.abc import Callable
from typing import Self

from lightwell.conventions import Convention
from lightwell.wire import StreamInfo, StreamStatus
from lightwell_client.backdrop import BackdropPicture
from lightwell_client.blocking import Blocking
from lightwell_client.follow import DEFAULT_SERVER
from lightwell_client.frames import LightFrame
from lightwell_client.stream import AsyncLightStream


class LightStream(Blocking):
    """The light of one stream, as it comes; a thread of its own receives it, so nothing piles up while you render.

    A context manager and iterator over `LightFrame`::

        import numpy as np
        from lightwell_client import LightStream

        A = np.pi * np.array([1, 2/3, 2/3, 2/3, 1/4, 1/4, 1/4, 1/4, 1/4])  # Lambert's cosine lobe

        with LightStream("probe", bands=3, timeout=10) as light:
            for frame in light:
                irradiance = A[:, None] * frame.coefficients               # (9, 3)
                print(f"{frame.seq}: ambient {irradiance[0] * 0.282095}")
                draw(irradiance)                                           # may be slow: the next frame is the newest
                if frame.missed:
                    print(f"{frame.missed} frames were overtaken meanwhile")

    The parameters are those of `AsyncLightStream`; callbacks are called on the receiving thread.
    """

    def __init__(
        self,
        stream: str,
        server: str = DEFAULT_SERVER,
        *,
        bands: int | None = None,
        convention: Convention = "lightwell",
        max_fps: float | None = None,
        gradients: bool = False,
        newest: bool = True,
        reconnect: bool = True,
        timeout: float | None = None,
        token: str | None = None,
        on_missed: Callable[[int], object] | None = None,
        on_status: Callable[[StreamStatus], object] | None = None,
        on_backdrop: Callable[[BackdropPicture], object] | None = None,
        on_connection: Callable[[bool], object] | None = None,
    ) -> None:
        self._follower = AsyncLightStream(
            stream,
            server,
            bands=bands,
            convention=convention,
            max_fps=max_fps,
            gradients=gradients,
            newest=newest,
            reconnect=reconnect,
            timeout=timeout,
            token=token,
            on_missed=on_missed,
            on_status=on_status,
            on_backdrop=on_backdrop,
            on_connection=on_connection,
        )
        super().__init__(self._follower, stream)

    @property
    def missed(self) -> int:
        """Frames that this program did not get so far, overtaken at the server or here."""
        return self._follower.missed

    @property
    def info(self) -> StreamInfo | None:
        """Description of the stream, from the last hello."""
        return self._follower.info

    @property
    def status(self) -> StreamStatus | None:
        """The source's last status."""
        return self._follower.status

    def __iter__(self) -> Self:
        return self

    def __next__(self) -> LightFrame:
        return self.next()

    def next(self, within_seconds: float | None = None) -> LightFrame:
        """Wait for the next frame and return it; see `AsyncLightStream.next`."""
        return self._call(self._follower.next(within_seconds))

    def latest(self) -> LightFrame | None:
        """Return the newest frame at once, for loops that draw at their own rate; None before the first."""

        async def newest() -> LightFrame | None:
            return self._follower.latest()

        return self._call(newest())

    def change(
        self,
        *,
        bands: int | None = None,
        convention: Convention | None = None,
        max_fps: float | None = None,
        gradients: bool | None = None,
    ) -> None:
        """Ask for something else without reconnecting; what is left out stays."""
        self._call(self._follower.change(bands=bands, convention=convention, max_fps=max_fps, gradients=gradients))
