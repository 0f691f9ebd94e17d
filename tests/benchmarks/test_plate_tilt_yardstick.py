"""The yardstick of plate tilt on made figures: its limits can be missed."""

import pytest

from benchmarks import plate_tilt
from benchmarks.plate_tilt import REFERENCE_UM, choices, coverage, limits
from benchmarks.shared.studies import Studied
from campaigns.studies.study import CampaignRow, CampaignVerdict

pytestmark = pytest.mark.long

KINDS = [f"kind {place}" for place in range(8)]


def left(full_um):
    columns = (KINDS, REFERENCE_UM["standard"], REFERENCE_UM["rods"], full_um)
    return list(zip(*columns, strict=True))


def row(position_mm, model="standard", what="rods 0.2 mm"):
    figures = dict.fromkeys(CampaignVerdict.__slots__, 0) | {"position_mm": position_mm}
    return CampaignRow(0, what, verdict=CampaignVerdict(**figures | {"model": model}))


def by_model(**rows):
    return {model: Studied({}, own) for model, own in rows.items()}


def test_full_model_that_leaves_more_than_the_reference_misses_its_limit():
    kept = limits(left([1.1 * um for um in REFERENCE_UM["full"]]), "par4-prototype")
    assert [figure.kept for figure in kept] == [True, True, True]
    worse = [*REFERENCE_UM["full"][:-1], 1.2 * REFERENCE_UM["full"][-1]]
    assert not limits(left(worse), "par4-prototype")[-1].kept


def test_full_model_of_other_robots_is_compared_with_perfect_parts():
    assert limits(left([6.0] * 8), "delta")[0].kept
    assert not limits(left([6.0] * 7 + [9.0]), "delta")[0].kept


@pytest.mark.parametrize(("covered", "kept"), [(0.95, True), (0.92, False), (0.98, False)])
def test_coverage_has_limits_on_both_sides(covered, kept):
    kinds = [{"covered": covered, "campaigns": 3}, {"covered": covered, "campaigns": 5}]
    assert coverage(kinds).kept is kept


def test_choice_is_right_where_it_leaves_as_little_as_the_full_model():
    rows = by_model(
        standard=[row(0.005, what="none"), row(0.1), row(0.1)],
        full=[row(0.005, what="none"), row(0.01), row(0.01)],
        auto=[row(0.005, what="none"), row(0.011, "rods"), row(0.01, "full")],
    )
    perfect, enough, halved = choices(rows)
    assert (perfect.value, enough.value, halved.value) == (1.0, 1.0, 2.0)


def test_choice_is_wrong_where_it_leaves_more_or_finds_too_much():
    rows = by_model(
        standard=[row(0.005, what="none"), row(0.1)],
        full=[row(0.005, what="none"), row(0.01)],
        auto=[row(0.005, "full", what="none"), row(0.1, "standard")],
    )
    perfect, enough, _ = choices(rows)
    assert (perfect.value, enough.value) == (0.0, 0.0)
    assert not perfect.kept
    assert not enough.kept


@pytest.mark.slow
def test_study_gives_a_row_for_each_kind_and_model():
    report = plate_tilt.measure(campaigns=8, robot="linear-delta")
    table, kept = report.tables
    assert [len(table.rows), len(kept.rows)] == [8, 8]
    assert {figure.name for figure in report.figures} >= {"22 kept of perfect parts"}
