"""The engine's states: every step of the table, and nothing beside it."""

from itertools import product

import pytest
from fake_cell import Listener

from campaigns.measuring.run_state import FOLLOWERS, EngineState, RunState, time_left_s


def way_to(state: EngineState) -> list[EngineState]:
    """The shortest way from the beginning to a state, by the table."""
    ways = [[EngineState.IDLE]]
    for way in ways:
        if way[-1] is state:
            return way[1:]
        followers = FOLLOWERS[way[-1]] | {EngineState.STOPPED}
        ways += [[*way, follower] for follower in followers if follower not in way]
    raise AssertionError(f"{state} is never reached")


def test_only_what_the_table_says_may_follow() -> None:
    for state, follower in product(EngineState, EngineState):
        listener = Listener()
        run_state = RunState(listener, done=0, total=1)
        for step in way_to(state):
            run_state.enter(step)
        if follower is EngineState.STOPPED or follower in FOLLOWERS[state]:
            run_state.enter(follower)
            assert listener.told[-1].state is follower
            continue
        with pytest.raises(AssertionError, match=f"{follower.value} cannot follow {state.value}"):
            run_state.enter(follower)


def test_every_state_is_in_the_table_and_nothing_follows_the_end() -> None:
    assert set(FOLLOWERS) == set(EngineState)
    assert all(len(way_to(state)) < len(EngineState) for state in EngineState)
    assert FOLLOWERS[EngineState.STOPPED] == FOLLOWERS[EngineState.FINISHED] == frozenset()


def test_time_left_is_an_interval_that_narrows_to_nothing() -> None:
    assert time_left_s([2.0, 3.0], 10) is None
    wide = time_left_s([2.0, 3.0, 2.5], 10)
    narrow = time_left_s([2.0, 3.0, 2.5] * 10, 10)
    assert wide is not None
    assert narrow is not None
    assert wide[0] < narrow[0] < 25.0 < narrow[1] < wide[1]
    assert time_left_s([2.0, 3.0, 2.5], 0) == (0.0, 0.0)
