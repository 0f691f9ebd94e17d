"""The wall clock."""

from drivers.ports import SystemClock


def test_real_time_passes_while_sleeping():
    clock = SystemClock()
    begun_s = clock.now_s()
    clock.sleep_s(0.002)
    assert clock.now_s() - begun_s >= 0.002
