"""Time that a run still takes, as it is shown."""

from campaigns.measuring.run_state import time_left_s


def test_time_left_is_an_interval_that_narrows_to_nothing() -> None:
    assert time_left_s([2.0, 3.0], 10) is None
    wide = time_left_s([2.0, 3.0, 2.5], 10)
    narrow = time_left_s([2.0, 3.0, 2.5] * 10, 10)
    assert wide is not None
    assert narrow is not None
    assert wide[0] < narrow[0] < 25.0 < narrow[1] < wide[1]
    assert time_left_s([2.0, 3.0, 2.5], 0) == (0.0, 0.0)
