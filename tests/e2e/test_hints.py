"""Somebody who types only what `next:` says arrives at a report, whatever robot and controller."""

import re
import shlex
import shutil

import pytest
from bar_robots import robot_file
from command_line import SMALL_TESTS, change

from campaigns.campaign import open_campaign
from campaigns.shots.import_export import exported_shots
from campaigns.shots.shots_csv import write_shots
from sim.scenarios.adaptation import computing_all
from sim.scenarios.scenario import load_scenario

ROBOTS = ("par4-prototype", "i4l", "delta", "linear-delta")
SCENARIOS = ("drawn-robots", "realistic", "gears")
"""Noise alone on a robot that 22 parameters explain; much that they cannot; ripples, too."""
WAYS = ("full", "plain", "targets", "imported")
SMALL = {"plan.shots": 60, "plan.validation_pairs": 10, **SMALL_TESTS}
QUICK = SMALL | {"plan.shots": 24, "plan.validation_pairs": 3}
FASTER = {"speed_up": 3000}
MOVING = {"run", "validate", "load"}
"""Commands that ask before they move the robot or write into its controller."""
MOST_COMMANDS = 20


class Person:
    """Types commands and what is said to be next, and writes the limits that are asked for."""

    def __init__(self, pkmcal, folder):
        self.folder = folder
        self.typed = []
        self._pkmcal = pkmcal

    def types(self, *words):
        more = ["--yes"] if words[0] in MOVING and "import" not in words else []
        ended = self._pkmcal(*words, *more)
        assert ended.code in {0, 1}, (words, ended.err)
        self.typed.append(shlex.join(map(str, words)))
        return ended

    def follows(self, ended, until=None):
        """Type what is next, until nothing is, or until such a command; gives that and the end."""
        while (said := re.search(r"^next: (.*)$", ended.err, re.M)) is not None:
            words = shlex.split(said[1])[1:]
            if until is not None and until(words):
                return words, ended
            assert len(self.typed) < MOST_COMMANDS, self.typed
            if "set the limits" in ended.err:
                self.writes_limits()
            ended = self.types(*words)
        return [], ended

    def writes_limits(self):
        """What the scenario says that a calibrated robot keeps; of what there is no test, none."""
        asked = load_scenario(str(self.folder / "cell.yaml")).acceptance
        limits = {f"acceptance.{name}": value for name, value in asked.model_dump().items()}
        if not any(axis.is_revolute for axis in open_campaign(self.folder).robot.mechanism.task):
            limits["acceptance.rotation_mm"] = None
        change(self.folder / "campaign.yaml", {k: v for k, v in limits.items() if v is not None})


def begins(pkmcal, folder, robot, scenario, plan, *, full):
    """A campaign whose controller computes plate tilt, or does not, as far as its export."""
    person = Person(pkmcal, folder)
    made = person.types("new", folder, "--robot", robot, "--scenario", scenario)
    change(folder / "campaign.yaml", plan)
    change(folder / "cell.yaml", FASTER)
    if full:
        cell = folder / "cell.yaml"
        cell.write_text(computing_all(cell.read_text(encoding="utf-8")), encoding="utf-8")
    return person, made


def by_targets(person, made):
    """Targets are corrected instead of what comes after the export."""
    _, exported = person.follows(made, until=lambda words: words[0] in {"load", "correct"})
    pose = person.folder / "wanted.csv"
    centre = open_campaign(person.folder).centre
    names = ("x_mm", "y_mm", "z_mm", "theta_deg")[: len(centre)]
    pose.write_text(f"{','.join(names)}\n{','.join(map(str, centre.tolist()))}\n")
    assert exported.code == 0
    return person.types("correct", person.folder, "--poses", pose)


OVERRULED = ("--force", "identity", "--force", "nominal")
"""Words to load another campaign's file."""


def elsewhere(person, robot, scenario, made, tmp_path):
    """Shots measured with other software: the first campaign's run, and pairs after its load."""
    other = Person(person._pkmcal, person.folder.with_name("elsewhere"))
    person.follows(made, until=lambda words: words[0] == "identify")
    person.types("export", person.folder, "--format", "shots")
    shots = shutil.copy(person.folder / "shots.csv", tmp_path / "run.csv")
    other.types("new", other.folder, "--robot", robot, "--scenario", scenario)
    taken = other.types("import", other.folder, shots)
    words, _ = other.follows(taken, until=lambda words: words[0] == "import")
    assert words[-5:] == ["after.txt", "--stage", "after", "--unit", "mm"]
    file = other.folder / "robot-compensated.yaml"
    person.types("load", person.folder, "--robot", file, *OVERRULED)
    person.types("validate", person.folder, "--stage", "after", "--force")
    campaign, after = open_campaign(person.folder), tmp_path / "after.csv"
    mechanism = campaign.robot.mechanism
    with campaign.journal_reader() as journal:
        series = journal.series("after")[-1]
        rows, _ = exported_shots(series, journal.shots(series.number), mechanism)
    write_shots(after, rows, mechanism, overwrite=False)
    words[words.index("after.txt")] = str(after)
    return other, other.types(*words)


def verdicts(person, told):
    """Verdict on the campaign by the terminal and by the page: it is the same."""
    page = (person.folder / "report.html").read_text(encoding="utf-8")
    answer = re.search(r'<p class="decision">([^<]*)</p>', page)[1].lower()
    terminal = re.search(r"^verdict: ([a-z ]+)$", told.out, re.M)
    assert answer == terminal[1]
    return answer, told.out


def arrives(pkmcal, robot, scenario, way, tmp_path, record_property, plan=SMALL):
    person, made = begins(
        pkmcal, tmp_path / "robot", robot, scenario, plan, full=way in {"full", "imported"}
    )
    if way == "targets":
        made = by_targets(person, made)
    if way == "imported":
        person, made = elsewhere(person, robot, scenario, made, tmp_path)
    _, last = person.follows(made)
    record_property("commands", len(person.typed))
    record_property("typed", "; ".join(person.typed))
    assert person.typed[-1].startswith("report"), person.typed
    decision, says = verdicts(person, last)
    assert decision == "pass", (says, person.typed, last.err)
    assert "--rollback" not in " ".join(person.typed) or way == "plain"


def test_who_follows_the_hints_arrives(pkmcal, tmp_path, record_property):
    arrives(pkmcal, "delta", "drawn-robots", "full", tmp_path, record_property, QUICK)
    page = (tmp_path / "robot" / "report.html").read_text(encoding="utf-8")
    page = re.sub(r"<style.*?</style>", "", page, flags=re.DOTALL)
    assert "arm1.forearm_mm" in page
    for of_another in ("θ", "theta", "Par4", "par4", "arm3", "plate_mm"):
        assert of_another not in page, of_another


@pytest.mark.slow
@pytest.mark.parametrize("mechanism", ["hexapod", "five-bar"])
def test_who_follows_the_hints_arrives_with_a_platform_that_is_one_body(
    pkmcal, mechanism, tmp_path, record_property
):
    """Load and tests included; the cell simulates the robot by bars and points, not by closures."""
    robot = robot_file(tmp_path, mechanism)
    arrives(pkmcal, robot, "drawn-robots", "full", tmp_path, record_property, QUICK)


@pytest.mark.long
@pytest.mark.timeout(900)
@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("scenario", SCENARIOS)
@pytest.mark.parametrize("robot", ROBOTS)
def test_who_follows_the_hints_arrives_with_every_robot(
    pkmcal, robot, scenario, way, tmp_path, record_property
):
    arrives(pkmcal, robot, scenario, way, tmp_path, record_property)
