"""The walk that adds a kind of observation is followed, and identifies a robot of rods by it."""

import re
import textwrap
from pathlib import Path

import numpy as np
import pytest

from benchmarks.observed_truths import TrueCell
from campaigns.api import identify
from campaigns.fit import kinds, slots
from campaigns.identification.objects import Object
from campaigns.identification.other_kinds import Measured

PAGE = Path(__file__).parents[2] / "CONTRIBUTING.md"
WALK = PAGE.read_text(encoding="utf-8").partition("## Adding a kind of observation")[2]
SLOT, FUNCTION, LINE = (
    textwrap.dedent(block).strip()
    for block in re.findall(r"```python\n(.*?)```", WALK.partition("\n## ")[0], re.DOTALL)
)
MOST_LINES = 20
FEED = np.array([1.0, 6e-3, -4e-3])


@pytest.fixture
def wire(monkeypatch):
    """The kind by the walk's lines, in the table."""
    in_slots, in_kinds = dict(vars(slots)), dict(vars(kinds))
    exec(SLOT, in_slots)
    in_kinds["WIRE"] = in_slots["WIRE"]
    exec(FUNCTION, in_kinds)
    kind = eval(LINE, in_kinds)
    monkeypatch.setitem(kinds.KINDS, kind.name, kind)
    return kind


def test_the_walk_is_short():
    lines = [line for part in (SLOT, FUNCTION, LINE) for line in part.splitlines() if line.strip()]
    assert len(lines) <= MOST_LINES


def test_a_robot_is_identified_by_distances_from_a_wire(wire):
    cell = TrueCell.of("linear-delta", 3)
    poses = np.concatenate([cell.on_level(140.0, 30), cell.on_level(140.0, 30, 40.0)])
    joints = cell.joints(poses)
    places = cell.truth.stood(joints, poses).places
    foot = cell.centre_mm - [0.0, 200.0, -20.0]
    away = places - foot - np.outer((places - foot) @ FEED, FEED) / (FEED @ FEED)
    values = np.linalg.norm(away, axis=1) + cell.noise(0.01, 60)
    heights = cell.measure("height", Object("bed"), cell.on_level(150.0, 30))
    row = {"kind": wire.name, "object": Object("taut"), "std_mm": 0.01}
    wired = Measured(joints=joints, values=values, **row)
    results = [
        identify(None, cell.robot, observations=rows, options={"quantities": ("flat",)})
        for rows in ([heights], [heights, wired])
    ]
    alone, both = ({q.name: q for q in r.uncertainty.determined} for r in results)
    assert both["xy"].rms < 0.5 * alone["xy"].rms
    real = cell.errors(results[1], heights.joints)
    assert {name: real[name] < 2.0 * both[name].rms for name in both} == dict.fromkeys(both, True)
    values[7] += 1.5
    result = identify(
        None, cell.robot, observations=[heights, Measured(joints=joints, values=values, **row)]
    )
    says = [f.says for f in result.judgement.findings if f.name == "wrong-observations"]
    assert says == ["wires of taut left out as wrong: 7 (from 0)"]
