"""The rules of conftest.py, tried on test files of their own."""

import sys
from pathlib import Path

import pytest

pytest_plugins = ("pytester",)

RULES = Path(__file__).with_name("conftest.py").read_text(encoding="utf-8")
SETTINGS = "[pytest]\nmarkers = peer: talks to a third-party peer\n"

SKIPPED_PEER = """
import pytest

@pytest.mark.peer
def test_session():
    pytest.skip("no controller here")
"""
SKIPPED_FILE = """
import pytest

pytest.skip("no controller here", allow_module_level=True)
"""
SKIPPED_OTHER = """
import pytest

def test_colours():
    pytest.skip("no terminal here")
"""
LEFT_THREAD = """
import threading

go_home = threading.Event()
left = threading.Thread(target=go_home.wait, name="forgotten", daemon=True)

def test_forgetful():
    left.start()

def test_innocent():
    go_home.set()
    left.join()
"""
LEFT_PROCESS = """
import subprocess

left = []

def test_forgetful():
    left.append(subprocess.Popen(["sleep", "60"]))

def test_tidying_up():
    left[0].kill()
    left[0].wait()
"""


@pytest.fixture
def outcomes(pytester, monkeypatch):
    """Runs one file by our rules and counts: passed, skipped, failed, errors."""
    pytester.makeconftest(RULES)
    pytester.makeini(SETTINGS)
    monkeypatch.delenv("CI", raising=False)
    monkeypatch.setenv("PYTEST_DISABLE_PLUGIN_AUTOLOAD", "1")

    def run(text: str, name: str = "test_file.py") -> dict[str, int]:
        path = pytester.path / name
        path.parent.mkdir(exist_ok=True)
        path.write_text(text, encoding="utf-8")
        return pytester.runpytest_inprocess("-p", "no:cacheprovider").parseoutcomes()

    return run


@pytest.mark.parametrize(
    ("name", "text", "in_ci"),
    [
        ("test_file.py", SKIPPED_PEER, {"failed": 1}),
        ("peers/test_file.py", SKIPPED_FILE, {"errors": 1}),
        ("test_file.py", SKIPPED_OTHER, {"skipped": 1}),
    ],
)
def test_a_peer_may_be_missing_but_not_in_ci(outcomes, monkeypatch, name, text, in_ci):
    assert outcomes(text, name) == {"skipped": 1}
    monkeypatch.setenv("CI", "true")
    assert outcomes(text, name) == in_ci


def test_thread_left_behind_fails_the_test_that_left_it(outcomes):
    assert outcomes(LEFT_THREAD) == {"passed": 2, "errors": 1}


@pytest.mark.skipif(sys.platform != "linux", reason="children are listed under /proc")
def test_process_left_behind_fails_the_test_that_left_it(outcomes):
    assert outcomes(LEFT_PROCESS) == {"passed": 2, "errors": 1}


def test_no_two_test_modules_share_a_name():
    """The test folders are no packages, so pytest imports a module by its file name alone."""
    names = [file.name for file in Path(__file__).parent.rglob("test_*.py")]
    assert sorted({name for name in names if names.count(name) > 1}) == []


def test_a_patch_lasts_no_longer_than_its_test():
    """One that stays for the session changes tests of other rooms, when a worker gets both."""
    made = [f"MonkeyPatch{end}" for end in (".context", "(")]
    texts = {path: path.read_text(encoding="utf-8") for path in Path(__file__).parent.rglob("*.py")}
    assert not [path for path, text in texts.items() if any(each in text for each in made)]
