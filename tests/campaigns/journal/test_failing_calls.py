"""Some of the writes, fsyncs and renames of a journal and a text fail: the folder stays whole.

All of them do in `tests/torture/test_every_failing_call.py`.
"""

import re

import pytest
from failing_calls import WORKS, is_possible, try_faults

SOME = 31
"""Every so many-th call fails."""


@pytest.mark.slow
@pytest.mark.skipif(not is_possible(), reason="needs Linux and a C compiler")
def test_calls_may_fail_and_the_folder_stays_whole(tmp_path):
    said = try_faults(tmp_path, SOME, [*WORKS])
    tried = re.fullmatch(r"(\d+) faults, 0 not survived\n", said)
    assert tried, said
    assert int(tried[1]) > 3 * len(WORKS), "some fail"
