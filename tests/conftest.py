"""What every test keeps to: it leaves nothing running, and in CI it goes deep and skips no peer."""

import gc
import os
import shutil
import signal
import tempfile
import threading
from collections.abc import Generator, Iterator
from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings

for _variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ.setdefault(_variable, "1")  # before NumPy: as `app.main` does for the program

# The list of trusted programs is the user's: tests have one of their own, and programs inherit it.
_CONFIGURATION = tempfile.TemporaryDirectory(prefix="pkmcal-tests-")
os.environ["XDG_CONFIG_HOME"] = _CONFIGURATION.name

# What is started in the background ignores Ctrl-C, and so would every program that a test starts.
signal.signal(signal.SIGINT, signal.default_int_handler)

# Files in memory: each record of a journal would wait for the disk.
_MEMORY, _ROOM_BYTES = Path("/dev/shm"), 2_000_000_000
if os.access(_MEMORY, os.W_OK) and shutil.disk_usage(_MEMORY).free > _ROOM_BYTES:
    os.environ.setdefault("PYTEST_DEBUG_TEMPROOT", str(_MEMORY))

pytest_plugins = ("whole_campaigns",)
TESTS = Path(__file__).parent
PEERS = TESTS / "peers"
WHOLE_PROGRAMS = tuple(TESTS / name for name in ("e2e", "torture", "app/report", "app/study"))
OWN_TASKS = Path("/proc/self/task")

# No deadlines: a busy machine is no fault of the code.
settings.register_profile("brief", max_examples=10, deadline=None)
settings.register_profile(
    "deep", max_examples=100, deadline=None, suppress_health_check=[HealthCheck.too_slow]
)
settings.load_profile("brief")
DEEP_IN_CI = tuple(
    TESTS / name for name in ("campaigns/kinematics", "campaigns/files", "drivers/wire")
)
"""Properties of mechanisms, files and wires are what a rare case hides in."""


def pytest_addoption(parser: pytest.Parser) -> None:
    """`--times N`: so many times as much garbage and force, as `make torture` has it."""
    parser.addoption("--times", type=int, default=1, help="of marker torture")
    parser.addoption("--seeds", type=int, help="how many of test_faults_by_seed.py")
    parser.addoption("--seed", type=int, help="the only one of test_faults_by_seed.py")


@pytest.fixture
def times(request: pytest.FixtureRequest) -> int:
    """By how much the numbers of a test by garbage or force are larger than usual."""
    return int(request.config.getoption("--times"))


@pytest.fixture(autouse=True)
def nothing_is_left_running() -> Iterator[None]:
    """Fail the test that leaves a thread or a process behind, not one of those that come after."""
    threads, processes = set(threading.enumerate()), children()
    yield
    new = [thread for thread in threading.enumerate() if thread not in threads]
    for thread in new:
        thread.join(1.0)  # one that was told to end needs a moment
    left = [thread.name for thread in new if thread.is_alive()]
    left += [f"process {number}" for number in sorted(children() - processes)]
    if left:
        pytest.fail(f"the test left running: {', '.join(left)}", pytrace=False)


def children() -> set[int]:
    """This process's children, also those that have ended unnoticed; none where Linux isn't."""
    found: set[int] = set()
    for task in OWN_TASKS.glob("*/children"):
        try:
            found.update(map(int, task.read_text(encoding="ascii").split()))
        except (FileNotFoundError, ProcessLookupError):  # the thread has ended since it was listed
            continue
    return found


def in_ci() -> bool:
    """Whether this is the run that decides."""
    return bool(os.environ.get("CI"))


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(
    item: pytest.Item, call: pytest.CallInfo[None]
) -> Generator[None, pytest.TestReport, pytest.TestReport]:
    """In CI a skipped test with a real peer has failed: there the peer has to be there."""
    report = yield
    is_peer = item.get_closest_marker("peer") is not None
    if in_ci() and is_peer and report.skipped and not hasattr(report, "wasxfail"):
        report.outcome = "failed"
        report.longrepr = f"{item.nodeid}: skipped, but in CI its peer must be there"
    return report


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Whole programs and drawn pages are slow; larger numbers take their time."""
    files = {item.path for item in items}
    of_programs = {path for path in files if not set(WHOLE_PROGRAMS).isdisjoint(path.parents)}
    has_all_its_time = config.getoption("--times") > 1
    for item in items:
        if has_all_its_time:
            item.add_marker(pytest.mark.timeout(0), append=False)
        if item.path in of_programs:
            item.add_marker(pytest.mark.slow)


def pytest_collection_finish() -> None:
    """Tests live to the end: the collector of garbage need not look at them again and again."""
    gc.freeze()


@pytest.hookimpl(wrapper=True)
def pytest_make_collect_report(
    collector: pytest.Collector,
) -> Generator[None, pytest.CollectReport, pytest.CollectReport]:
    """In CI a whole file of peers that skips itself has failed too, and some properties go deep."""
    deep = in_ci() and any(folder in collector.path.parents for folder in DEEP_IN_CI)
    settings.load_profile("deep" if deep else "brief")  # read where a test is defined
    report = yield
    if in_ci() and report.skipped and PEERS in collector.path.parents:
        report.outcome = "failed"
        report.longrepr = f"{collector.nodeid}: skipped, but in CI its peer must be there"
    return report
