"""The catalogue without sockets: what happens while a stream is deleted."""

from __future__ import annotations

import asyncio
from collections.abc import Iterator
from pathlib import Path

import pytest

from lightwell.settings import StreamSettings
from lightwell_server.catalogue import Catalogue, Origin
from lightwell_server.config import HubSettings
from lightwell_server.hub import Hub
from lightwell_server.problems import Problem
from lightwell_server.store import Store

SETTINGS = StreamSettings(source="exr:x")


class SlowWorkers:
    """A supervisor whose worker ends when the test says so."""

    def __init__(self) -> None:
        self.removing = asyncio.Event()
        self.removed = asyncio.Event()

    def apply(self, name: str, settings: StreamSettings) -> None:
        pass

    async def remove(self, name: str) -> None:
        self.removing.set()
        await self.removed.wait()


@pytest.fixture
def store(tmp_path: Path) -> Iterator[Store]:
    store = Store(tmp_path / "lightwell.sqlite")
    yield store
    store.close()


async def test_a_worker_may_announce_a_stream_while_it_is_deleted(store: Store) -> None:
    workers = SlowWorkers()
    catalogue = Catalogue(Hub(HubSettings(), "run"), store, workers, {})
    before = catalogue.channel((await catalogue.create("hall", SETTINGS)).name)
    deleting = asyncio.create_task(catalogue.delete("hall", if_match=None))
    await workers.removing.wait()

    with pytest.raises(Problem, match="there is no stream 'hall'"):
        catalogue.announce("hall", SETTINGS, embedded=True)
    channel, _ = catalogue.announce("hall", SETTINGS, embedded=False)
    workers.removed.set()
    await deleting

    assert catalogue.channel("hall") is channel is not before
    assert [entry.origin for entry in catalogue.entries()] == [Origin.WORKER]
