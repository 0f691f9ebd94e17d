"""observations.csv: rows of other kinds than points, and what is refused with line and remedy."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from printers import printer

from campaigns.errors import ShotsInvalid
from campaigns.fit.kinds import KINDS
from campaigns.shots.observations_csv import (
    ObservationRow,
    default_in_words,
    observations_text,
    parse_observations,
    require_measured,
)
from campaigns.shots.shot_sets import ShotSet

MECHANISM = printer().mechanism
OBJECTS = ("bed", "part", "probe")
HEAD = "kind,object,q0_mm,q1_mm,q2_mm,value_mm,std_mm,pair,set,time,session\n"
JOINT = st.floats(0.0, 500.0)


def parsed(text, objects=OBJECTS):
    return parse_observations(text, "o.csv", MECHANISM, objects)


@st.composite
def rows(draw):
    kind = KINDS[draw(st.sampled_from(sorted(KINDS)))]
    poses = kind.poses
    joints = st.tuples(JOINT, JOINT, JOINT)
    # whole degrees come back as they went
    values = tuple(
        float(np.deg2rad(draw(st.integers(-180, 180)))) if name.endswith("_deg") else draw(JOINT)
        for name in kind.columns
    )
    return ObservationRow(
        kind=kind.name,
        object=draw(st.sampled_from(OBJECTS)),
        joints=tuple(draw(joints) for _ in range(poses)),
        values=values if draw(st.booleans()) else (),
        std_mm=draw(st.floats(1e-6, 1.0)),
        purpose=draw(st.sampled_from([ShotSet.IDENTIFICATION, ShotSet.VALIDATION])),
        session=draw(st.integers(0, 3)),
        time=draw(st.sampled_from([None, "2026-11-21T09:00:00Z"])),
        std_source=draw(st.sampled_from(["", "default", "Acme 9, typed by A. Bee"])),
    )


@given(st.lists(rows(), min_size=1, max_size=5))
def test_what_is_written_is_read_again(written):
    """Lines count from 2; a pair's label is its place."""
    line, expected = 1, []
    for place, row in enumerate(written):
        line += len(row.joints)
        label = str(place) if len(row.joints) > 1 else ""
        changed = {"line": line, "pair": label, "file": "o.csv"}
        expected.append(ObservationRow(**{**_fields(row), **changed}))
    assert list(parsed(observations_text(expected, MECHANISM))) == expected


@pytest.mark.parametrize(
    ("stated", "words"),
    [
        (None, "the file's own figures"),
        ("", "the file's own figures"),
        ("default", "default: usual of such instruments"),
        ("Acme 9, typed by A. Bee", "Acme 9, typed by A. Bee"),
    ],
)
def test_each_row_says_where_its_std_is_from(stated, words):
    """None: the file is older, and has no such column."""
    column = "" if stated is None else "std_source,"
    value = "" if stated is None else f'"{stated}",'
    head = HEAD.replace("std_mm,", f"std_mm,{column}")
    (row,) = parsed(f"{head}height,bed,1,2,3,0.5,0.01,{value},,,\n")
    assert row.std_source_in_words == words
    assert bool(default_in_words([row])) is (stated == "default")


def test_planned_rows_keep_an_empty_column_for_their_values():
    row = ObservationRow("height", "bed", ((1.0, 2.0, 3.0),), (), 0.01)
    text = observations_text([row], MECHANISM)
    assert text.splitlines()[0] == "kind,object,q0_mm,q1_mm,q2_mm,value_mm,std_mm"
    assert parsed(text)[0].is_planned


def test_value_of_a_pair_stands_in_either_row():
    text = HEAD + "distance,part,1,2,3,30,0.05,1,,,\ndistance,part,1,2,4,,0.05,1,,,\n"
    (row,) = parsed(text)
    assert row.values == (30.0,)
    assert row.joints == ((1.0, 2.0, 3.0), (1.0, 2.0, 4.0))


REFUSED = {
    "unknown kind": ("hight,bed,1,2,3,0,0.01,,,,", "o.csv:2: unknown kind 'hight'", "height?"),
    "no kind": (",bed,1,2,3,0,0.01,,,,", "o.csv:2: kind is empty", "height"),
    "no object": ("height,,1,2,3,0,0.01,,,,", "o.csv:2: object is empty", "name the bed"),
    "misspelt object": (
        "height,bett,1,2,3,0,0.01,,,,", "o.csv:2: unknown object 'bett'", "known here: bed, part",
    ),
    "unknown object": (
        "height,plate,1,2,3,0,0.01,,,,",
        "o.csv:2: unknown object 'plate'",
        "write `- {name: plate}` under objects in campaign.yaml",
    ),
    "no σ": ("height,bed,1,2,3,0,,,,,", "o.csv:2: std_mm is empty: no σ is assumed", "1 σ"),
    "σ of 0": ("height,bed,1,2,3,0,0,,,,", "o.csv:2: std_mm is 0, must be above 0", "1 σ"),
    "no number": ("height,bed,1,2,3,0.x,0.01,,,,", "value_mm is '0.x'", "correct"),
    "decimal comma": ('height,bed,1,2,3,"0,5",0.01,,,,', "a decimal comma", "decimal points"),
    "no joint": ("height,bed,1,,3,0,0.01,,,,", "o.csv:2: q1_mm is empty", "a number"),
    "half a pair": (
        "distance,part,1,2,3,5,0.01,7,,,",
        "o.csv:2: pair 7 of part has one row, must have two",
        "add the row of its other pose",
    ),
    "three of a pair": (
        "\n".join(["distance,part,1,2,3,5,0.01,7,,,"] * 3), "has 3 rows", "its own label",
    ),
    "no pair": ("distance,part,1,2,3,5,0.01,,,,", "pair is empty, but a distance", "one label"),
    "pair of a height": ("height,bed,1,2,3,0,0.01,4,,,", "pair is 4, but a height", "empty"),
    "two values": (
        "distance,part,1,2,3,5,0.01,7,,,\ndistance,part,1,2,4,6,0.01,7,,,",
        "o.csv:3: both rows of the pair have values, which differ", "keep one",
    ),
    "two sets": (
        "distance,part,1,2,3,5,0.01,7,,,\ndistance,part,1,2,4,,0.01,7,validation,,",
        "o.csv:3: the rows of the pair are of two sets", "the same set",
    ),
    "set of shots": ("height,bed,1,2,3,0,0.01,,drift,,", "set is drift", "validation"),
}  # fmt: skip


@pytest.mark.parametrize(("lines", "problem", "remedy"), REFUSED.values(), ids=REFUSED)
def test_refused_with_line_and_remedy(lines, problem, remedy):
    with pytest.raises(ShotsInvalid) as error:
        parsed(f"{HEAD}{lines}\n")
    assert problem in error.value.problem
    assert remedy in error.value.remedy


def test_values_of_another_kind_are_refused():
    text = "kind,object,q0_mm,q1_mm,q2_mm,value_mm,x_mm,std_mm\nheight,bed,1,2,3,0,5,0.01\n"
    with pytest.raises(ShotsInvalid, match="x_mm is 5, but a height has value_mm"):
        parsed(text)


def test_part_of_a_point_is_refused():
    text = "kind,object,q0_mm,q1_mm,q2_mm,x_mm,y_mm,z_mm,std_mm\nreflector,probe,1,2,3,5,,7,0.01\n"
    with pytest.raises(ShotsInvalid, match="y_mm is empty"):
        parsed(text)


def test_column_of_sigma_must_be_there():
    text = "kind,object,q0_mm,q1_mm,q2_mm,value_mm\nheight,bed,1,2,3,0\n"
    with pytest.raises(ShotsInvalid, match="column std_mm is missing"):
        parsed(text)


def test_planned_rows_are_counted_when_values_are_needed():
    planned = parsed(HEAD + "height,bed,1,2,3,0,0.1,,,,\nheight,bed,1,2,4,,0.1,,,,\n")
    with pytest.raises(ShotsInvalid, match="1 of 2 observations have no value") as error:
        require_measured(planned, "o.csv")
    assert "fill in" in error.value.remedy


def _fields(row):
    return {name: getattr(row, name) for name in row.__dataclass_fields__}
