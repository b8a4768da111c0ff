"""Which states may follow which."""

from __future__ import annotations

import pytest

from lightwell_server.session import WorkerState, follow, new_session


def test_a_worker_may_crash_and_start_again() -> None:
    path = [WorkerState.STARTING, WorkerState.RUNNING, WorkerState.BACKING_OFF, WorkerState.STARTING]
    state = WorkerState.STOPPED
    for following in path:
        state = follow(state, following)
    assert state is WorkerState.STARTING


@pytest.mark.parametrize("state", list(WorkerState))
def test_every_state_may_stay_and_may_stop(state: WorkerState) -> None:
    assert follow(state, state) is state
    assert follow(state, WorkerState.STOPPED) is WorkerState.STOPPED


def test_an_impossible_change_says_what_was_expected() -> None:
    with pytest.raises(ValueError, match="a worker that is stopped cannot become running; expected one of: starting"):
        follow(WorkerState.STOPPED, WorkerState.RUNNING)


def test_sessions_differ() -> None:
    assert new_session() != new_session()
