"""The benchmark of false acceptance passes a robot that is right."""

import pytest

from benchmarks import false_acceptance as benchmark
from benchmarks.situations import WRONG_POSITIONS


@pytest.mark.slow
def test_a_clean_robot_is_passed_and_is_right(tmp_path):
    verdict, sigmas, positions = benchmark.judge("delta", "clean", 80, 2, tmp_path)
    assert verdict == "pass"
    assert 0.0 < sigmas < benchmark.WRONG_SIGMAS
    assert 0.0 < positions < WRONG_POSITIONS
