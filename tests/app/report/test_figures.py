"""Figures and texts: what is drawn, and that drawing leaves no trace."""

import re
import sys
from pathlib import Path

import matplotlib as mpl
import numpy as np
import pytest
from paper_campaign import MECHANISM, NOMINAL, PaperCampaign

from app.report.figures.distances import pair_errors
from app.report.figures.drawing import new_figure, save, svg_text
from app.report.figures.space import axes_in_space, one_scale
from app.report.figures.workspace import error_arrows, magnification, plate_tilt
from app.report.groups import PairGroup
from app.report.plots import plot_plan, plot_residuals
from app.report.rendering import moment
from app.report.results_sections import percent_gained
from app.terminal_picture import bar, histogram_lines
from campaigns.errors import WriteFailed
from campaigns.estimation.estimators import Estimator
from campaigns.estimation.information import Uncertainty
from campaigns.evaluation.summary import binned_medians
from campaigns.evidence import gather
from campaigns.files.table import number
from campaigns.identification.identify import identify
from campaigns.identification.options import IdentificationOptions
from campaigns.identification.parameter_selection import select_parameters
from campaigns.planning.predicted_uncertainty import Forecast

GROUP = PairGroup("fitted pairs", "o", np.array([1.0, -2.0, 3.0]), np.array([0.1, 0.0, -0.1]))


def test_ids_of_two_figures_on_one_page_never_meet() -> None:
    one, other = (svg_text(pair_errors([GROUP]), name, name) for name in ("one", "other"))
    ids = [set(re.findall(r'\bid="([^"]+)"', svg)) for svg in (one, other)]
    assert not ids[0] & ids[1]
    used = set(re.findall(r'(?:url\(|href=")#([^)"]+)', one))
    assert used <= ids[0]


def test_text_in_a_figure_stays_text() -> None:
    svg = svg_text(pair_errors([GROUP]), "one", 'Errors & "more"')
    assert ">fitted pairs</text>" in svg
    assert 'aria-label="Errors &amp; &quot;more&quot;"' in svg


def settings() -> dict[str, object]:
    """All but the backend: asking for it would choose one."""
    return {name: mpl.rcParams[name] for name in mpl.rcParams if name != "backend"}


def test_drawing_leaves_matplotlibs_settings_and_no_pyplot_behind() -> None:
    before = settings()
    svg_text(pair_errors([GROUP]), "one", "Errors")
    assert settings() == before
    assert "matplotlib.pyplot" not in sys.modules


@pytest.mark.parametrize("pairs", [1, 2, 1000])
def test_any_number_of_pairs_can_be_drawn(pairs: int) -> None:
    errors = np.linspace(-1.0, 1.0, pairs)
    assert svg_text(pair_errors([PairGroup("few", "o", errors, None)]), "n", "n")


def test_errors_of_nothing_at_all_can_be_drawn() -> None:
    poses = np.tile([0.0, 0.0, -500.0, 0.0], (4, 1))
    assert svg_text(error_arrows(poses, np.zeros((4, 3)), None), "n", "n")


@pytest.mark.parametrize(("size_mm", "factor"), [(26.0, 5.0), (0.5, 200.0), (130.0, 1.0)])
def test_arrows_are_magnified_by_a_round_factor(size_mm: float, factor: float) -> None:
    assert magnification(np.array([[0.0, size_mm, 0.0], [0.1, 0.0, 0.0]])) == factor


def test_points_in_space_are_drawn_to_one_scale_without_pyplot() -> None:
    axes = axes_in_space(new_figure(60.0), (1, 1, 1))
    one_scale(axes, np.array([[-300.0, 0.0, -600.0], [300.0, 200.0, -500.0]]))
    extent = np.ptp([axes.get_xlim(), axes.get_ylim(), axes.get_zlim()], axis=1)
    aspect = axes.get_box_aspect()
    assert extent == pytest.approx([600.0, 200.0, 100.0])
    assert aspect / aspect[0] == pytest.approx(extent / extent[0])
    assert "matplotlib.pyplot" not in sys.modules


def test_medians_follow_a_rise() -> None:
    places, medians = binned_medians(np.arange(60.0), 2.0 * np.arange(60.0), 6)
    assert np.allclose(medians, 2.0 * places)
    assert len(places) == 6


def expected(shots: int, *names: str, std: float = 0.01) -> Forecast:
    units = MECHANISM.parameters.units(names)
    known = Uncertainty.of(names, units, std**2 * np.eye(len(names)), source="predicted")
    return Forecast(shots, known, np.array([0.002]))


ANGLE = "arm0.joint_offset_deg"
KNOWN = expected(12, "arm1.x_mm", "plate_mm", ANGLE)


@pytest.mark.parametrize("ending", ["svg", "png", "pdf"])
def test_the_plan_is_drawn_in_the_format_of_the_name(
    whole: PaperCampaign, tmp_path: Path, ending: str
) -> None:
    path = tmp_path / f"plan.{ending}"
    plot_plan(path, whole.plan(6, 2), KNOWN, [])
    start = path.read_bytes()[:400]
    assert {"svg": b"<svg", "png": b"\x89PNG", "pdf": b"%PDF"}[ending] in start


@pytest.mark.parametrize(
    ("told", "curve", "shown", "hidden"),
    [
        (KNOWN, [], ["identification", "arm1.x", "predicted σ, deg"], ["worst length"]),
        (
            KNOWN,
            [expected(shots, "plate_mm", ANGLE) for shots in (12, 24)],
            ["worst length", "position, mean", "worst angle", "this plan", ">24<"],
            [],
        ),
        (expected(12, "plate_mm", std=np.inf), [], ["identification"], ["predicted σ"]),
        (expected(12, ANGLE), [], [">arm0.joint_offset<"], ["predicted σ, mm"]),
    ],
)
def test_the_plans_picture_shows_what_is_known_of_it(
    whole: PaperCampaign,
    tmp_path: Path,
    told: Forecast,
    curve: list[Forecast],
    shown: list[str],
    hidden: list[str],
) -> None:
    path = tmp_path / "plan.svg"
    plot_plan(path, whole.plan(6, 2), told, curve)
    text = path.read_text(encoding="utf-8")
    assert [words for words in shown if words not in text] == []
    assert [words for words in hidden if words in text] == []


def test_an_unknown_ending_and_a_missing_folder_are_explained(tmp_path: Path) -> None:
    with pytest.raises(WriteFailed, match=r"\.svg, \.png or \.pdf"):
        save(pair_errors([GROUP]), tmp_path / "plan.xyz")
    with pytest.raises(WriteFailed, match="no such file"):
        save(pair_errors([GROUP]), tmp_path / "nowhere" / "plan.svg")


@pytest.mark.parametrize(
    ("estimator", "fitted"),
    [
        (Estimator.POINTS, "fitted shots, length of the error"),
        (Estimator.DISTANCES, "fitted pairs"),
    ],
)
def test_what_was_fitted_and_what_was_not_is_drawn(
    whole: PaperCampaign, tmp_path: Path, estimator: Estimator, fitted: str
) -> None:
    shots, path = gather(whole.campaign).run.shots, tmp_path / "residuals.svg"
    options = IdentificationOptions(estimator=estimator)
    selection = select_parameters(MECHANISM.parameters)
    plot_residuals(path, identify(NOMINAL.robot.kinematics, shots, selection, options))
    text = path.read_text()
    assert f">{fitted}</text>" in text
    assert ">unseen pairs, error of distance</text>" in text


def test_the_histogram_in_letters_counts_every_error() -> None:
    errors = np.random.default_rng(1).normal(0.05, 0.1, 60)
    lines = histogram_lines(errors.tolist())
    assert sum(int(line.rsplit(" ", 1)[1]) for line in lines) == 60
    assert max(line.count("█") for line in lines) == 40
    assert len({line.index("mm") for line in lines}) == 1


@pytest.mark.parametrize("errors", [[0.0], [0.0, 0.0], [1e-300]])
def test_the_histogram_of_next_to_nothing_is_short(errors: list[float]) -> None:
    assert all(len(line) < 100 for line in histogram_lines(errors))


def test_no_errors_give_no_histogram() -> None:
    assert histogram_lines([]) == []


@pytest.mark.parametrize(("part", "shown"), [(0.0, "    "), (1.0, "████"), (0.53, "██▏ ")])
def test_a_bar_counts_eighths(part: float, shown: str) -> None:
    assert bar(part, 4) == shown


def test_numbers_are_written_with_a_true_minus_and_no_negative_nothing() -> None:
    assert number(-1.5, 1) == "−1.5"
    assert number(-0.0001, 3) == "0.000"
    assert number(2.0, 1, signed=True) == "+2.0"
    assert number(None) == "–"


def test_gain_is_told_only_where_there_was_something() -> None:
    assert percent_gained(2.0, 0.5) == "75 %"
    assert percent_gained(0.5, 2.0) == "−300 %"
    assert percent_gained(0.0, 2.0) == percent_gained(None, 2.0) == "–"


def test_moments_are_cut_to_the_minute() -> None:
    assert moment("2026-03-02T08:15:30.123+00:00") == "2026-03-02 08:15 UTC"


def test_the_plate_s_lean_is_drawn_towards_where_the_tool_goes():
    """Turned about x by 2 mrad, the lower end of a tool goes towards +y."""
    poses = np.array([[0.0, 0.0, -500.0, 0.0], [100.0, 0.0, -500.0, 0.0], [0.0, 90.0, -500.0, 0.0]])
    figure = plate_tilt(poses, np.array([[2e-3, 0.0, 0.0], [1e-3, 0.0, 0.0], [0.0, 0.0, 5e-3]]))
    above, along = figure.axes
    assert "2.00 mrad" in above.get_title(loc="left")
    [arrows] = [each for each in above.collections if hasattr(each, "U")]
    assert pytest.approx([0.0, 0.0, 0.0]) == arrows.U
    assert arrows.V[0] == pytest.approx(2.0 * arrows.V[1])
    assert arrows.V[0] > 0.0
    assert along.lines[0].get_ydata() == pytest.approx([2.0, 1.0, 0.0])
