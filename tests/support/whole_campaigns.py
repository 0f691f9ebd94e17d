"""Whole campaigns as fixtures, made once for all tests that only read them; and commands."""

import pickle
import shutil
from typing import TYPE_CHECKING

import pytest
from filelock import FileLock

if TYPE_CHECKING:
    from command_line import CommandLine
    from paper_campaign import PaperCampaign

    from campaigns.assessment import Evaluation


@pytest.fixture
def pkmcal(capsys: pytest.CaptureFixture[str]) -> "CommandLine":
    """Runs a command in the process of the tests; gives its exit code, its answer and its words."""
    from command_line import CommandLine

    return CommandLine(capsys)


@pytest.fixture(scope="session")
def made_once(tmp_path_factory, worker_id):
    """Makes a folder by a function of it, once for all workers of this test run."""
    base = tmp_path_factory.getbasetemp()
    shared = (base if worker_id == "master" else base.parent) / "made once"
    shared.mkdir(exist_ok=True)

    def made(name, make):
        folder = shared / name
        with FileLock(f"{folder}.lock"):
            if not folder.exists():
                (unfinished := shared / f"{name}.{worker_id}").mkdir()
                make(unfinished / "small")
                unfinished.rename(folder)
        return folder / "small"

    return made


@pytest.fixture(scope="session")
def planned_once(made_once):
    from command_line import make_planned

    return made_once("planned", make_planned)


@pytest.fixture
def planned(planned_once, tmp_path):
    """A campaign with a plan, and nothing measured."""
    return shutil.copytree(planned_once, tmp_path / "small")


@pytest.fixture(scope="session")
def loaded(made_once, tmp_path_factory: pytest.TempPathFactory) -> "PaperCampaign":
    """A campaign up to the load: before, run, identify, export, load; leave it as it is."""
    from paper_campaign import make_loaded  # what a test of a driver need not wait for

    folder = made_once("loaded", make_loaded)
    paper = pickle.loads((folder.parent / "paper").read_bytes())
    paper.folder = folder  # another than that in which it was made
    return paper.copy_to(tmp_path_factory.mktemp("campaigns") / "loaded")


@pytest.fixture(scope="session")
def whole(loaded: "PaperCampaign") -> "PaperCampaign":
    """A campaign in which everything was done; leave it as it is."""
    paper = loaded.copy_to(loaded.folder.with_name("whole"))
    paper.validate("after")
    return paper


@pytest.fixture
def undrawn(monkeypatch: pytest.MonkeyPatch) -> None:
    """Leave out the drawing of figures, most of a page's time, where its words are tested."""
    monkeypatch.setattr("app.report.section.svg_text", lambda *_: "<svg></svg>")


@pytest.fixture(scope="session")
def evaluation(whole: "PaperCampaign") -> "Evaluation":
    """What is said of it."""
    from campaigns.assessment import evaluate

    return evaluate(whole.campaign)
