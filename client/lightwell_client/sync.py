"""Follow a stream from ordinary, blocking code."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Callable, Coroutine
from types import TracebackType
from typing import Any, Self, TypeVar

from lightwell.conventions import Convention
from lightwell.wire import StreamInfo, StreamStatus
from lightwell_client.backdrop import BackdropPicture
from lightwell_client.frames import LightFrame
from lightwell_client.stream import DEFAULT_SERVER, AsyncLightStream

Result = TypeVar("Result")


class LightStream:
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
            newest=newest,
            reconnect=reconnect,
            timeout=timeout,
            token=token,
            on_missed=on_missed,
            on_status=on_status,
            on_backdrop=on_backdrop,
            on_connection=on_connection,
        )
        self._loop: asyncio.AbstractEventLoop | None = None
        self._thread: threading.Thread | None = None

    @property
    def missed(self) -> int:
        """Frames that this program did not get so far, overtaken at the server or here."""
        return self._follower.missed

    @property
    def connected(self) -> bool:
        """Whether there is a connection now."""
        return self._follower.connected

    @property
    def reconnects(self) -> int:
        """Connections after the first."""
        return self._follower.reconnects

    @property
    def last_error(self) -> str:
        """Why the last connection ended; empty while there is one."""
        return self._follower.last_error

    @property
    def info(self) -> StreamInfo | None:
        """Description of the stream, from the last hello."""
        return self._follower.info

    @property
    def status(self) -> StreamStatus | None:
        """The source's last status."""
        return self._follower.status

    def __enter__(self) -> Self:
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(
            target=self._loop.run_forever, name=f"light {self._follower.stream}", daemon=True
        )
        self._thread.start()
        self._call(self._follower.__aenter__())
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        assert self._loop is not None
        assert self._thread is not None
        self._call(self._follower.__aexit__(None, None, None))
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join()
        self._loop.close()
        self._loop = None

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
        self, *, bands: int | None = None, convention: Convention | None = None, max_fps: float | None = None
    ) -> None:
        """Ask for something else without reconnecting; what is left out stays."""
        self._call(self._follower.change(bands=bands, convention=convention, max_fps=max_fps))

    def _call(self, coroutine: Coroutine[Any, Any, Result]) -> Result:
        if self._loop is None:
            coroutine.close()
            raise RuntimeError("use the stream as a context manager: with LightStream(…) as light")
        future = asyncio.run_coroutine_threadsafe(coroutine, self._loop)
        try:
            return future.result()
        except KeyboardInterrupt:
            future.cancel()
            raise
