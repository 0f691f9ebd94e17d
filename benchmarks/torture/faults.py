"""Unattended runs on cells that fail: one command each, all must complete, nothing wrong stored.

python -m benchmarks.torture.faults [--seeds 10] [--scripts 20] [--measurements 12] [--json]

`hostile` with SEEDS seeds, against the same cells without faults; SCRIPTS random scripts of eight
faults; ten scripts at the first three shots; a beam broken for 1, 3, 30, 90 and 600 s of the cell's
time at each measurement up to MEASUREMENTS. What the journal counts is compared with the simulated
tracker's own record: the robot's reflector, and the robot where the encoders were read.
"""

import json
import random
import tempfile
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import degrees
from pathlib import Path

from ruamel.yaml import YAML

from benchmarks.shared.programs import pkmcal
from benchmarks.shared.yardstick import Cell, Figure, Report, Table, main
from campaigns.campaign import open_campaign
from campaigns.journal.views import AcceptedShot

RETRY = "5"
BREAKS_S = (1.0, 3.0, 30.0, 90.0, 600.0)
FAULTS = 8
FIRST_SCRIPTS = 10
SCRIPTED = {"plan.shots": 24, "plan.validation_pairs": 2, "plan.drift_shots": 2}
"""A small plan: 30 shots."""
PATIENT = {"settle.timeout_s": 300}
"""Of the cell's time: a busy machine may look up late."""
OTHER_REFLECTOR_MM = [900.0, 350.0, -420.0]
SPEED_UP = 200
LATE_S = 8.0 * SPEED_UP
"""Longer than any driver waits, as the cell counts."""
NEAR_MM, NEAR_UDEG = 1e-6, 1
Fault = dict[str, object]


@dataclass(frozen=True, slots=True)
class Ran:
    """One unattended run: whether it completed, shots stored wrong, and what it took."""

    name: str
    complete: bool
    wrong: int
    shots: int
    sessions: int
    seconds: float


def measure(seeds: int, scripts: int, measurements: int) -> Report:
    with tempfile.TemporaryDirectory() as folder:
        root = Path(folder)
        hostile = [run_hostile(root, seed) for seed in range(1, seeds + 1)]
        small = {
            "fault scripts": [
                run_small(root, f"script {n}", random_script(random.Random(n)))
                for n in range(scripts)
            ],
            "faults at the first shots": [
                run_small(root, f"first {n}", first_script(n)) for n in range(FIRST_SCRIPTS)
            ],
            "beam breaks": [
                run_small(root, f"{seconds:g} s at {at}", [broken_beam(at, seconds)])
                for seconds in BREAKS_S
                for at in range(1, measurements + 1)
            ],
        }
    every = {"hostile": [ran for ran, _ in hostile], **small}
    figures = [figure for name, runs in every.items() for figure in figures_of(name, runs)]
    largest = max((away for _, away in hostile), default=0.0)
    figures.append(
        Figure("hostile: parameters from the same cell without faults", largest, "σ", highest=1.0)
    )
    return Report(figures, [table_of(name, runs) for name, runs in every.items()])


def figures_of(name: str, runs: Sequence[Ran]) -> Iterator[Figure]:
    yield Figure(f"{name}: runs", len(runs))
    yield Figure(f"{name}: not complete", sum(not ran.complete for ran in runs), highest=0)
    yield Figure(f"{name}: shots stored wrong", sum(ran.wrong for ran in runs), highest=0)


def table_of(name: str, runs: Sequence[Ran]) -> Table:
    rows: list[list[Cell]] = [
        [ran.name, "yes" if ran.complete else "NO", ran.shots, ran.wrong, ran.sessions, ran.seconds]
        for ran in runs
    ]
    return Table(name, ("", "complete", "shots", "wrong", "sessions", "s"), rows)


def run_hostile(root: Path, seed: int) -> tuple[Ran, float]:
    """A run of the hostile cell, and how many σ its parameters are from those without faults."""
    found: list[dict[str, tuple[float, float]]] = []
    runs: list[Ran] = []
    for name, faults in (("faultless", []), ("hostile", None)):
        folder = root / f"{name}-{seed}"
        pkmcal("new", str(folder), "--scenario", "hostile")
        cell = {"seed": seed} if faults is None else {"seed": seed, "faults": faults}
        set_keys(folder / "cell.yaml", cell)
        set_keys(folder / "campaign.yaml", PATIENT)
        pkmcal("plan", str(folder))
        runs.append(run_in(folder, f"seed {seed}"))
        found.append(parameters_of(folder))
    clean, faulty = found
    away = [abs(faulty[name][0] - value) / std for name, (value, std) in clean.items()]
    return runs[-1], max(away)


def parameters_of(folder: Path) -> dict[str, tuple[float, float]]:
    """Values and σ of what `identify` frees."""
    _, answer = pkmcal("identify", str(folder), "--json", expected=(0, 1))
    parameters = json.loads(answer)["parameters"]
    return {name: (p["value"], p["std"]) for name, p in parameters.items() if p["std"]}


def run_small(root: Path, name: str, faults: Sequence[Fault]) -> Ran:
    folder = root / name.replace(" ", "-")
    pkmcal("new", str(folder), "--scenario", "realistic")
    set_keys(folder / "campaign.yaml", SCRIPTED | PATIENT)
    pkmcal("plan", str(folder))
    cell = {"tracker.other_reflector_mm": OTHER_REFLECTOR_MM, "speed_up": SPEED_UP}
    set_keys(folder / "cell.yaml", {**cell, "faults": list(faults)})
    return run_in(folder, name)


def run_in(folder: Path, name: str) -> Ran:
    """One unattended command, and what is then in the journal."""
    words = ("run", str(folder), "--yes", "--json", "--retry", RETRY)
    seconds, answer = pkmcal(*words, expected=range(256))
    campaign = open_campaign(folder)
    planned = len(campaign.read_plan())
    with campaign.journal_reader() as journal:
        series = journal.latest_series("run")
        shots = journal.shots(series.number) if series else ()
        sessions = len(journal.records()) and sum(
            type(entry.record).__name__ == "SessionStarted" for entry in journal.records()
        )
    complete = bool(answer) and json.loads(answer)["shots"] == planned == len(shots)
    truth = json.loads((folder / "cell-memory.json").read_text(encoding="utf-8"))["taken"]
    return Ran(name, complete, sum(wrong_shots(shots, truth)), len(shots), sessions, seconds)


def wrong_shots(
    shots: Iterable[AcceptedShot], truth: Sequence[Mapping[str, object]]
) -> Iterator[bool]:
    """Of each shot that counts, whether the tracker never told it of the robot standing there."""
    for shot in shots:
        yield not any(is_truth(shot, each) for each in truth)


def is_truth(shot: AcceptedShot, told: Mapping[str, object]) -> bool:
    point, place = told["point_in_tracker_mm"], told["robot_target"]
    assert isinstance(point, list)
    assert isinstance(place, list)
    outcome = shot.outcome
    stored = [round(degrees(joint) * 1e6) for joint in outcome.joints]
    near = zip(outcome.point_in_tracker_mm, point, strict=True)
    there = zip(stored, place, strict=True)
    return (
        told["on"] == "robot"
        and all(abs(a - b) <= NEAR_MM for a, b in near)
        and all(abs(a - b) <= NEAR_UDEG for a, b in there)
    )


def broken_beam(at: int, seconds: float) -> Fault:
    return {"at_measurement": at, "kind": "beam_break", "seconds": seconds}


def random_script(rng: random.Random) -> list[Fault]:
    """Eight faults at places of their own, of all kinds that an unattended run may meet.

    No emergency stop: whoever pressed it must start the robot again.
    """
    measurements = iter(rng.sample(range(1, 36), FAULTS))
    moves = iter(rng.sample(range(2, 40), FAULTS))
    answers = {
        device: iter(rng.sample(range(20, most), FAULTS))
        for device, most in (("controller", 500), ("tracker", 200))
    }
    script: list[Fault] = []
    for _ in range(FAULTS):
        kind = rng.choice(["beam", "target", "drive", "stall", "wire", "wire"])
        if kind == "beam":
            script.append(broken_beam(next(measurements), rng.choice([1.0, 5.0, 20.0, 90.0])))
        elif kind == "target":
            script.append({"at_measurement": next(measurements), "kind": "wrong_target"})
        elif kind == "drive":
            script.append({"at_move": next(moves), "kind": "drive_fault", "seconds": 500.0})
        elif kind == "stall":
            script.append({"at_move": next(moves), "kind": "stall"})
        else:
            script.append(wire_fault(rng, answers))
    return script


def wire_fault(rng: random.Random, answers: Mapping[str, Iterator[int]]) -> Fault:
    device = rng.choice(["controller", "tracker"])
    kind = rng.choice(["late", "silent", "garbage", "torn", "close"])
    fault: Fault = {"device": device, "at_answer": next(answers[device]), "kind": kind}
    return fault | {"seconds": LATE_S} if kind == "late" else fault


def first_script(number: int) -> list[Fault]:
    """Wrong targets and broken beams at shots 1 to 3, alone and together."""
    wrong = [{"at_measurement": at, "kind": "wrong_target"} for at in (1, 2, 3)]
    together: list[list[Fault]] = [
        [wrong[0]],
        [wrong[1]],
        [wrong[2]],
        [wrong[0], broken_beam(2, 5.0)],
        [broken_beam(1, 5.0), wrong[1]],
        [wrong[0], wrong[2]],
        [wrong[1], wrong[2]],
        [broken_beam(1, 90.0), broken_beam(2, 5.0), wrong[2]],
        [wrong[0], {"device": "tracker", "at_answer": 45, "kind": "close"}],
        [wrong[1], {"at_move": 3, "kind": "drive_fault", "seconds": 500.0}],
    ]
    return together[number]


def set_keys(path: Path, settings: Mapping[str, object]) -> None:
    """Set keys of a YAML file, named like `plan.shots`."""
    yaml = YAML()
    tree = yaml.load(path.read_text(encoding="utf-8"))
    for name, value in settings.items():
        *sections, key = name.split(".")
        section = tree
        for step in sections:
            section = section[step]
        section[key] = value
    with path.open("w", encoding="utf-8") as file:
        yaml.dump(tree, file)


if __name__ == "__main__":
    raise SystemExit(main(__doc__, measure, seeds=10, scripts=20, measurements=12))
