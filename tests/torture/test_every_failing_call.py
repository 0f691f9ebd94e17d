"""Each write, fsync, rename and the like fails once: nothing is lost, and the work goes on."""

import pytest
from failing_calls import WORKS, is_possible, try_faults

pytestmark = [pytest.mark.torture, pytest.mark.long, pytest.mark.timeout(600)]


@pytest.mark.skipif(not is_possible(), reason="needs Linux and a C compiler")
@pytest.mark.parametrize("work", WORKS)
def test_every_call_may_fail_and_the_folder_stays_whole(tmp_path, work, times):
    """With `--times` each call in its turn, else every fifth."""
    said = try_faults(tmp_path, 1 if times > 1 else 5, [work])
    assert said.endswith(" faults, 0 not survived\n"), said
