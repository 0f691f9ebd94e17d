"""Figures: what is drawn, of any number of shots, and in files of any kind."""

import re
import sys
from pathlib import Path

import numpy as np
import pytest
from paper_campaign import NOMINAL, PaperCampaign

from app.report.drawing import legend_above, new_figure, new_panel, new_space, save, svg_text
from app.report.figures import error_arrows, histogram, magnification, pair_errors, plate_tilt
from app.report.plots import plot_plan, plot_residuals
from app.report.result_tables import PairGroup, percent_gained
from app.report.section import moment
from campaigns.errors import WriteFailed
from campaigns.evaluation.summary import binned_medians
from campaigns.evidence import gather
from campaigns.files.table import number
from campaigns.identification.identify import identify
from campaigns.identification.options import IdentificationOptions, Model
from campaigns.planning.forecast import Forecast

BEFORE_MM, AFTER_MM = np.array([1.0, -2.0, 3.0]), np.array([0.1, 0.0, -0.2])
GROUP = PairGroup("fitted pairs", "o", BEFORE_MM, AFTER_MM, (4, 5, 6))


def test_ids_of_two_figures_on_one_page_never_meet() -> None:
    axes = new_panel("title")
    axes.plot([1.0, 2.0], "o", label="points")
    legend_above(axes, 1)
    one, other = (svg_text(axes.figure, name, name) for name in ("one", "other"))
    ids = [set(re.findall(r'\bid="([^"]+)"', svg)) for svg in (one, other)]
    assert not ids[0] & ids[1]
    assert set(re.findall(r'(?:url\(|href=")#([^)"]+)', one)) <= ids[0]


def test_errors_stand_before_and_after_and_after_alone_with_the_largest_by_number() -> None:
    both, after = pair_errors([GROUP], "error of distance", "pairs")
    drawn = [line.get_ydata() for line in both.axes[0].lines[:2]]
    assert [list(errors) for errors in drawn] == [list(BEFORE_MM), list(AFTER_MM)]
    assert list(after.axes[0].lines[0].get_ydata()) == list(AFTER_MM)
    assert [text.get_text() for text in after.axes[0].texts] == ["6", "4"]
    svg = svg_text(after, "errors", 'Errors & "more"')
    assert ">fitted pairs</text>" in svg
    assert 'aria-label="Errors &amp; &quot;more&quot;"' in svg


@pytest.mark.parametrize("pairs", [1, 2, 1000])
def test_any_number_of_pairs_of_one_stage_can_be_drawn(pairs: int) -> None:
    group = PairGroup("few", "o", np.linspace(-1.0, 1.0, pairs), None)
    (panel,) = pair_errors([group], "error", "pairs")
    assert len(panel.axes[0].lines[0].get_ydata()) == pairs
    before, after = histogram([group])
    assert sum(bar.get_height() for bar in before.axes[0].patches) == pairs
    assert "not measured" in svg_text(after, "h", "h")


def test_errors_of_nothing_at_all_can_be_drawn() -> None:
    poses = np.tile([0.0, 0.0, -500.0, 0.0], (4, 1))
    (panel,) = error_arrows(poses, np.zeros((4, 3)), None)
    assert "<svg" in svg_text(panel, "arrows", "arrows")


@pytest.mark.parametrize(("size_mm", "factor"), [(26.0, 5.0), (0.5, 200.0), (130.0, 1.0)])
def test_arrows_are_magnified_by_a_round_factor(size_mm: float, factor: float) -> None:
    assert magnification(np.array([[0.0, size_mm, 0.0], [0.1, 0.0, 0.0]])) == factor


def test_points_in_space_are_drawn_to_one_scale_without_pyplot() -> None:
    axes = new_space("", np.array([-300.0, 0.0, -600.0]), np.array([300.0, 200.0, -500.0]))
    extent = np.ptp([axes.get_xlim(), axes.get_ylim(), axes.get_zlim()], axis=1)
    aspect = axes.get_box_aspect()
    assert extent == pytest.approx([600.0, 200.0, 100.0])
    assert aspect / aspect[0] == pytest.approx(extent / extent[0])
    assert "matplotlib.pyplot" not in sys.modules


def test_the_plate_s_lean_is_drawn_towards_where_the_tool_goes() -> None:
    """Turned about x by 2 mrad, the lower end of a tool goes towards +y."""
    poses = np.array([[0.0, 0.0, -500.0, 0.0], [100.0, 0.0, -500.0, 0.0], [0.0, 90.0, -500.0, 0.0]])
    tilt_rad = np.array([[2e-3, 0.0, 0.0], [1e-3, 0.0, 0.0], [0.0, 0.0, 5e-3]])
    above, _ = plate_tilt(poses, tilt_rad)
    (arrows,) = above.axes[0].collections
    assert list(arrows.U) == pytest.approx([0.0, 0.0, 0.0])
    assert list(arrows.V) == pytest.approx([2.0, 1.0, 0.0])
    assert above.texts[0].get_text() == "from above: the longest is 2.00 mrad"


def test_medians_follow_a_rise() -> None:
    places, medians = binned_medians(np.arange(60.0), 2.0 * np.arange(60.0), 6)
    assert np.allclose(medians, 2.0 * places)
    assert len(places) == 6


def expected(*names: str) -> Forecast:
    units = {name: name.rpartition("_")[2] for name in names}
    return Forecast(12, dict.fromkeys(names, 0.01), units, np.array([0.002]), (0.5,) * 4)


@pytest.mark.parametrize(
    ("forecast", "shown", "hidden"),
    [
        (
            expected("arm1.x_mm", "arm0.joint_offset_deg"),
            ["identification", ">arm1.x<", "σ, deg"],
            [],
        ),
        (expected(), ["identification"], ["σ, "]),
        (expected(*(f"arm{n}.x_mm" for n in range(20))), [">arm11.x<"], [">arm12.x<"]),
    ],
)
def test_the_plans_picture_shows_the_predicted_uncertainty(
    whole: PaperCampaign, tmp_path: Path, forecast: Forecast, shown: list[str], hidden: list[str]
) -> None:
    path = tmp_path / "plan.svg"
    plot_plan(path, whole.plan(6, 2), forecast)
    text = path.read_text(encoding="utf-8")
    assert [words for words in shown if words not in text] == []
    assert [words for words in hidden if words in text] == []


@pytest.mark.parametrize("ending", ["png", "pdf"])
def test_a_picture_is_written_in_the_format_of_the_name(tmp_path: Path, ending: str) -> None:
    path = tmp_path / f"picture.{ending}"
    save(new_figure(20.0), path)
    assert path.read_bytes().startswith({"png": b"\x89PNG", "pdf": b"%PDF"}[ending])


def test_an_unknown_ending_and_a_missing_folder_are_explained(tmp_path: Path) -> None:
    with pytest.raises(WriteFailed, match=r"\.svg, \.png or \.pdf"):
        save(new_figure(20.0), tmp_path / "plan.xyz")
    with pytest.raises(WriteFailed, match="no such file"):
        save(new_figure(20.0), tmp_path / "nowhere" / "plan.svg")


@pytest.mark.parametrize(
    ("model", "fitted"), [("full", "fitted shots, length of the error"), ("paper", "fitted pairs")]
)
def test_what_was_fitted_and_what_was_not_is_drawn(
    whole: PaperCampaign, tmp_path: Path, model: Model, fitted: str
) -> None:
    shots, path = gather(whole.campaign).run.shots, tmp_path / "residuals.svg"
    options = IdentificationOptions(model=model)
    plot_residuals(path, identify(NOMINAL.robot.kinematics, shots, options))
    text = path.read_text(encoding="utf-8")
    assert f">{fitted}</text>" in text
    assert ">hold-out pairs, error of distance</text>" in text


def test_numbers_and_times_are_written_as_people_read_them() -> None:
    assert [number(-1.5, 1), number(-0.0001, 3), number(None)] == ["−1.5", "0.000", "–"]
    assert number(2.0, 1, signed=True) == "+2.0"
    assert [percent_gained(2.0, 0.5), percent_gained(0.5, 2.0)] == ["75 %", "−300 %"]
    assert percent_gained(0.0, 2.0) == percent_gained(None, 2.0) == "–"
    assert moment("2026-03-02T08:15:30.123+00:00") == "2026-03-02 08:15 UTC"
