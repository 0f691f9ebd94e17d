"""Plans that cannot be made: one line that names what is wrong, exit code 2, nothing changed."""

import pytest
from command_line import change, contents

FEW = ("--candidates", "100")


@pytest.mark.parametrize(
    ("options", "named"),
    [
        (("--shots", "7"), ["--shots is 7", "even"]),
        (("--shots", "120", *FEW), ["120 shots", "100 candidates", "--candidates 4000"]),
        (("--shots", "12", *FEW), ["12 shots", "22 parameters", "14 or more", "--fix"]),
        (("--until", "σ=0.0001", *FEW), ["goal σ=0.0001 mm", "100 shots", "leave ±", "ask for σ="]),
        (("--until", "σ=0.02", "--shots", "20", *FEW), ["20 shots", "allow more --shots"]),
        (("--until", "0.02"), ["goal '0.02'", "σ=0.02"]),
        (("--until", "σ=0"), ["goal σ is 0", "above 0"]),
        (
            ("--until", "σ=0.02", "--placement", "boundary"),
            ["--until", "--placement boundary", "leave --until out"],
        ),
        (("--criterion", "D", "--placement", "boundary"), ["--criterion", "leave --criterion out"]),
        (("--criterion", "Z"), ["--criterion", "'Z'"]),
        (("--candidates", "99"), ["--candidates", "'99'", "100"]),
        (("--candidates", "1000000000"), ["--candidates", "'1000000000'", "20000"]),
        (("--estimator", "points-and-distances"), ["--estimator", "points-and-distances"]),
        (("--free", "arm*.azimut_deg"), ["arm*.azimut_deg", "azimuth_deg"]),
        (("--fix", "arm7.*"), ["arm7.*", "matches no parameter"]),
        (("--fix", "*"), ["--fix leaves no parameter"]),
        (("--fix", "*_mm", "--until", "σ=0.02"), ["--until", "no length", "--shots"]),
        (("--free", "arm0.z_mm"), ["arm0.z_mm, arm1.z_mm", "move together", "--fix"]),
        (("--free", "arm0.z_mm", *FEW, "--shots", "40"), ["arm0.z_mm", "move together", "--fix"]),
    ],
)
def test_a_plan_that_cannot_be_made(pkmcal, planned, options, named):
    before = contents(planned)
    ended = pkmcal("plan", planned, *options)
    assert ended.code == 2, ended.err
    assert [word for word in named if word not in ended.error_line] == []
    assert contents(planned) == before


def test_what_is_said_to_be_reachable_is_reached(pkmcal, planned):
    ended = pkmcal("plan", planned, "--until", "σ=0.0001", *FEW)
    goal = ended.error_line.split("ask for ")[1].split(" ")[0]
    made = pkmcal("plan", planned, "--until", goal, *FEW, "--json")
    assert made.code == 0
    assert made.document["worst"]["length_mm"] <= float(goal.removeprefix("σ="))


@pytest.mark.parametrize(
    ("settings", "named"),
    [
        ({"tracker.uncertainty.along_um": 0.0}, ["uncertainty.along_um", "above 0"]),
        ({"tracker.uncertainty.across_um_per_m": -1.0}, ["across_um_per_m", "at least 0"]),
        ({"tracker.uncertainty.along_mm": 0.01}, ["along_mm", "along_um"]),
    ],
)
def test_a_data_sheet_that_cannot_be(pkmcal, planned, settings, named):
    change(planned / "campaign.yaml", settings)
    ended = pkmcal("plan", planned)
    assert ended.code == 2, ended.err
    assert [word for word in ["campaign.yaml", *named] if word not in ended.error_line] == []
