"""The test's own LinuxCNC: whatever happens to it, it leaves nothing behind."""

from contextlib import ExitStack
from pathlib import Path

import pytest
from linuxcnc_bench import NEEDS_LINUXCNC, world_controller

pytestmark = NEEDS_LINUXCNC

AT_A_TIME = 4
LOCK = Path("/tmp/linuxcnc.lock")
PROGRAMS = ("milltask", "rtapi_app", "linuxcnc_bridge.py", "linuxcncsvr", "io")


def shared_memory():
    """The system's segments, by their lines' keys and numbers."""
    lines = Path("/proc/sysvipc/shm").read_text().splitlines()[1:]
    return {tuple(line.split()[:2]) for line in lines}


def processes_of(folder):
    """Processes of LinuxCNC with anything of this instance in their words or surroundings."""
    found = []
    for process in Path("/proc").iterdir():
        if not process.name.isdigit():
            continue
        try:
            words = (process / "cmdline").read_bytes() + (process / "environ").read_bytes()
        except OSError:  # it has ended meanwhile, or is somebody else's
            continue
        if str(folder).encode() in words:
            found.append(process.name)
    return found


@pytest.mark.parametrize("rounds", [1, pytest.param(5, marks=pytest.mark.long)])
def test_starts_and_stops_leave_no_process_lock_or_shared_memory(tmp_path, rounds):
    before, locked = shared_memory(), LOCK.exists()
    all_of_them = [world_controller(tmp_path / str(number)) for number in range(AT_A_TIME)]
    for _ in range(rounds):
        with ExitStack() as stops:
            for linuxcnc in all_of_them:
                stops.callback(linuxcnc.stop)
                linuxcnc.launch()
            for linuxcnc in all_of_them:
                linuxcnc.await_ready()
            all_of_them[1].hal("setp", "fb.0.offset", "3")
            assert float(all_of_them[2].hal("getp", "fb.0.offset")) == 0.0
            for program in PROGRAMS:
                all_of_them[0].kill(program)
        assert processes_of(tmp_path) == []
    assert shared_memory() <= before
    assert LOCK.exists() is locked
