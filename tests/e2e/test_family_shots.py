"""Shots of every mechanism of the family, taken in and identified by the commands."""

import pytest
from family_cases import MEMBERS, flat_in

CLOSE_TO_TRUTH = {"mm": 1e-4, "deg": 1e-5}
"""The files' points have six decimals, their joints nine."""
CLOSE_TO_LEAST_SQUARES = {"mm": 1e-4, "deg": 1e-6}
OFTEN = ("delta", "linear-delta")
all_members = pytest.mark.parametrize(
    "member",
    [pytest.param(each, marks=[] if each.name in OFTEN else pytest.mark.long) for each in MEMBERS],
    ids=lambda each: each.name,
)
pytestmark = pytest.mark.slow


@pytest.fixture
def identified(pkmcal, tmp_path):
    """Identifies from a member's shots of some kind; gives the document."""

    def found(member, kind, *options):
        folder = tmp_path / member.name
        assert pkmcal("new", folder, "--robot", member.name).code == 0
        assert pkmcal("import", folder, member.shots_file(kind)).code == 0
        return pkmcal("identify", folder, *options, "--json").document

    return found


def assert_same(document, geometry, close):
    expected = flat_in(geometry)
    assert document["parameters"].keys() == expected.keys()
    for name, entry in document["parameters"].items():
        limit = close[name.rpartition("_")[2]]
        assert entry["value"] == pytest.approx(expected[name], rel=0, abs=limit), name


@all_members
def test_exact_points_give_the_truth(identified, member):
    found = identified(member, "exact")
    assert found["rank"] == len(member.space.free_by_default)
    assert_same(found, member.answers("exact")["truth"], CLOSE_TO_TRUTH)


@all_members
def test_exact_distances_give_the_truth(identified, member):
    found = identified(member, "exact", "--estimator", "distances")
    assert_same(found, member.answers("exact")["truth"], CLOSE_TO_TRUTH)


@all_members
def test_noisy_points_give_the_reference_s_least_squares(identified, member):
    answer = member.answers("noise")
    found = identified(member, "noise")
    assert_same(found, answer["least_squares_points"], CLOSE_TO_LEAST_SQUARES)
    of_coordinates = found["residuals_mm"]["after"]["rms"] / 3**0.5
    assert of_coordinates == pytest.approx(answer["rms_mm"], rel=1e-6)


@all_members
def test_what_no_point_tells_is_said_when_it_is_freed(identified, member):
    """By rank, with the parameters that move together; and nothing of it is taken for found."""
    fixed = {*member.space.datum} & {*member.space.names}
    everything = [word for name in member.space.names for word in ("--free", name)]
    found = identified(member, "noise", *everything)
    assert found["rank"] == len(member.space.names) - len(fixed)
    assert len(found["unobservable"]) == len(fixed)
    assert found["verdict"] != "pass"
    named = {name for combination in found["unobservable"] for name in combination}
    assert fixed <= named
