"""Figures: what is drawn, of any number of shots, and in files of any kind."""

from pathlib import Path

import numpy as np
import pytest
from paper_campaign import new_campaign

from app.report.drawing import new_figure, save, svg_text
from app.report.figures import error_arrows, pair_errors
from app.report.plots import plot_plan
from app.report.tables import PairGroup
from campaigns.errors import WriteFailed
from campaigns.evaluation.model_errors import PositionErrors
from campaigns.files.table import number
from campaigns.identification.pictures import magnification
from campaigns.planning.forecast import Forecast
from drivers.texts import moment

BEFORE_MM, AFTER_MM = np.array([1.0, -2.0, 3.0]), np.array([0.1, 0.0, -0.2])
GROUP = PairGroup("fitted pairs", "o", {"before": BEFORE_MM, "after": AFTER_MM}, (4, 5, 6))


def test_errors_stand_before_and_after_and_after_alone_with_the_largest_by_number() -> None:
    both, after = pair_errors([GROUP])
    drawn = [line.get_ydata() for line in both.axes[0].lines[:2]]
    assert [list(errors) for errors in drawn] == [list(BEFORE_MM), list(AFTER_MM)]
    assert list(after.axes[0].lines[0].get_ydata()) == list(AFTER_MM)
    assert [text.get_text() for text in after.axes[0].texts] == ["6", "4"]
    assert not both.axes[0].texts  # numbers of errors that vanish would hide each other
    svg = svg_text(after, "errors", 'Errors & "more"')
    assert ">fitted pairs</text>" in svg
    assert 'aria-label="Errors &amp; &quot;more&quot;"' in svg


@pytest.mark.parametrize("pairs", [1, 2, 1000])
def test_any_number_of_pairs_of_one_stage_can_be_drawn(pairs: int) -> None:
    errors_mm = {"before": np.linspace(-1.0, 1.0, pairs), "after": None}
    (panel,) = pair_errors([PairGroup("few", "o", errors_mm)])
    assert len(panel.axes[0].lines[0].get_ydata()) == pairs


def test_errors_of_nothing_at_all_can_be_drawn() -> None:
    poses = np.tile([0.0, 0.0, -500.0, 0.0], (4, 1))
    above, aside = error_arrows(PositionErrors(poses, np.zeros((4, 3)), None, np.ones(4, bool)))
    assert "<svg" in svg_text(above, "arrows", "arrows")
    assert aside.axes[0].get_ylabel() == "z, mm"


@pytest.mark.parametrize(("size_mm", "factor"), [(26.0, 4.8), (0.55, 230.0), (125.0, 1.0)])
def test_the_longest_arrow_is_an_eighth_of_the_places(size_mm: float, factor: float) -> None:
    places = np.array([[0.0, -600.0, 0.0], [0.0, 400.0, 0.0]])
    assert magnification(np.array([[0.0, size_mm, 0.0], [0.1, 0.0, 0.0]]), places) == factor


def predicted(*names: str) -> Forecast:
    units = {name: name.rpartition("_")[2] for name in names}
    return Forecast(12, dict.fromkeys(names, 0.01), units, np.array([0.002]), (0.5,) * 4, 20.0)


@pytest.mark.parametrize(
    ("forecast", "shown", "hidden"),
    [
        (
            predicted("arm0.joint_offset_deg", *(f"arm{n}.x_mm" for n in range(20))),
            ["identification", ">arm11.x<", "σ, deg"],
            [">arm12.x<"],
        ),
        (predicted(), ["identification"], ["σ, "]),
    ],
)
def test_the_plans_picture_shows_the_largest_predicted_uncertainties(
    tmp_path: Path, forecast: Forecast, shown: list[str], hidden: list[str]
) -> None:
    path = tmp_path / "plan.svg"
    plot_plan(path, new_campaign(tmp_path / "new").plan(6, 2), forecast)
    text = path.read_text(encoding="utf-8")
    assert [words for words in shown if words not in text] == []
    assert [words for words in hidden if words in text] == []


def test_an_unknown_ending_and_a_missing_folder_are_explained(tmp_path: Path) -> None:
    with pytest.raises(WriteFailed, match=r"\.svg, \.png or \.pdf"):
        save(new_figure(20.0), tmp_path / "plan.xyz")
    with pytest.raises(WriteFailed, match="no such file"):
        save(new_figure(20.0), tmp_path / "nowhere" / "plan.svg")


def test_numbers_and_times_are_written_as_people_read_them() -> None:
    assert [number(-1.5, 1), number(-0.0001, 3), number(None)] == ["−1.5", "0.000", "–"]
    assert number(2.0, 1, signed=True) == "+2.0"
    assert moment("2026-03-02T08:15:30.123+00:00") == "2026-03-02 08:15 UTC"
