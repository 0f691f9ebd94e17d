"""Figures and texts: what is drawn, and that drawing leaves no trace."""

import re
import sys
from pathlib import Path

import matplotlib as mpl
import numpy as np
import pytest
from paper_campaign import NOMINAL, PaperCampaign

from app.report.figures.distances import pair_errors
from app.report.figures.drawing import new_figure, save, svg_text
from app.report.figures.picture import AFTER, Picture, ticks
from app.report.figures.plan import axes_in_space, one_scale
from app.report.figures.workspace import error_arrows, magnification, plate_tilt
from app.report.groups import PairGroup
from app.report.page import page_of
from app.report.page_tree import Node, line_of, page_tree, shapes
from app.report.plots import plot_plan, plot_residuals
from app.report.rendering import moment
from app.report.results_sections import percent_gained
from campaigns.errors import WriteFailed
from campaigns.evaluation.summary import binned_medians
from campaigns.evidence import evaluate, gather
from campaigns.files.table import number
from campaigns.identification.identify import identify
from campaigns.identification.options import IdentificationOptions, Model
from campaigns.planning.forecast import Forecast

GROUP = PairGroup("fitted pairs", "o", np.array([1.0, -2.0, 3.0]), np.array([0.1, 0.0, -0.1]))


def test_ids_of_two_figures_on_one_page_never_meet() -> None:
    figure = new_figure(40.0)
    figure.subplots().plot([1.0, 2.0], "o", clip_on=True)
    one, other = (svg_text(figure, name, name) for name in ("one", "other"))
    ids = [set(re.findall(r'\bid="([^"]+)"', svg)) for svg in (one, other)]
    assert not ids[0] & ids[1]
    used = set(re.findall(r'(?:url\(|href=")#([^)"]+)', one))
    assert used <= ids[0]


def test_text_in_a_figure_stays_text() -> None:
    svg = pair_errors([GROUP]).svg('Errors & "more"')
    assert ">fitted pairs</text>" in svg
    assert 'aria-label="Errors &amp; &quot;more&quot;"' in svg


def settings() -> dict[str, object]:
    """All but the backend: asking for it would choose one."""
    return {name: mpl.rcParams[name] for name in mpl.rcParams if name != "backend"}


def test_drawing_leaves_matplotlibs_settings_and_no_pyplot_behind(tmp_path: Path) -> None:
    before = settings()
    save(pair_errors([GROUP]), tmp_path / "errors.png")
    assert settings() == before
    assert "matplotlib.pyplot" not in sys.modules


def test_a_page_says_before_each_figure_which_of_how_many_it_is(whole: PaperCampaign) -> None:
    told: list[tuple[str, int, int]] = []
    made = page_of(
        evaluate(whole.campaign), "2026-03-02T09:30:00+00:00", lambda *at: told.append(at)
    )
    assert [n for _, n, _ in told] == [*range(1, len(made.outline.drawings) + 1)]
    assert {total for *_, total in told} == {len(made.outline.drawings)}
    assert told[0][0] == "Errors of position, shot by shot"
    assert "<!--figure" not in made.html


@pytest.mark.parametrize("pairs", [1, 2, 1000])
def test_any_number_of_pairs_can_be_drawn(pairs: int) -> None:
    errors = np.linspace(-1.0, 1.0, pairs)
    shown = shapes_of(pair_errors([PairGroup("few", "o", errors, None)]))
    assert sum(shape.tag == "circle" for shape in shown) == pairs + 1  # and the legend's


def test_errors_of_nothing_at_all_can_be_drawn() -> None:
    poses = np.tile([0.0, 0.0, -500.0, 0.0], (4, 1))
    assert inside(error_arrows(poses, np.zeros((4, 3)), None))


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


def expected(*names: str) -> Forecast:
    units = {name: name.rpartition("_")[2] for name in names}
    return Forecast(12, dict.fromkeys(names, 0.01), units, np.array([0.002]), (0.5,) * 4)


ANGLE = "arm0.joint_offset_deg"
KNOWN = expected("arm1.x_mm", "plate_mm", ANGLE)


@pytest.mark.parametrize("ending", ["svg", "png", pytest.param("pdf", marks=pytest.mark.long)])
def test_the_plan_is_drawn_in_the_format_of_the_name(
    whole: PaperCampaign, tmp_path: Path, ending: str
) -> None:
    path = tmp_path / f"plan.{ending}"
    plot_plan(path, whole.plan(6, 2), KNOWN)
    start = path.read_bytes()[:400]
    assert {"svg": b"<svg", "png": b"\x89PNG", "pdf": b"%PDF"}[ending] in start


@pytest.mark.parametrize(
    ("forecast", "shown", "hidden"),
    [
        (KNOWN, ["identification", ">arm1.x<", "σ, deg"], []),
        (expected(), ["identification"], ["predicted σ"]),
        (expected(ANGLE), [">arm0.joint_offset<"], ["predicted σ, mm"]),
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


def test_an_unknown_ending_and_a_missing_folder_are_explained(tmp_path: Path) -> None:
    with pytest.raises(WriteFailed, match=r"\.svg, \.png or \.pdf"):
        save(pair_errors([GROUP]), tmp_path / "plan.xyz")
    with pytest.raises(WriteFailed, match="no such file"):
        save(pair_errors([GROUP]), tmp_path / "nowhere" / "plan.svg")


@pytest.mark.parametrize(
    ("model", "fitted"), [("full", "fitted shots, length of the error"), ("paper", "fitted pairs")]
)
def test_what_was_fitted_and_what_was_not_is_drawn(
    whole: PaperCampaign, tmp_path: Path, model: Model, fitted: str
) -> None:
    shots, path = gather(whole.campaign).run.shots, tmp_path / "residuals.svg"
    options = IdentificationOptions(model=model)
    plot_residuals(path, identify(NOMINAL.robot.kinematics, shots, options))
    text = path.read_text()
    assert f">{fitted}</text>" in text
    assert ">hold-out pairs, error of distance</text>" in text


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


def test_the_plate_s_lean_is_drawn_towards_where_the_tool_goes() -> None:
    """Turned about x by 2 mrad, the lower end of a tool goes towards +y: upwards on paper."""
    poses = np.array([[0.0, 0.0, -500.0, 0.0], [100.0, 0.0, -500.0, 0.0], [0.0, 90.0, -500.0, 0.0]])
    picture = plate_tilt(poses, np.array([[2e-3, 0.0, 0.0], [1e-3, 0.0, 0.0], [0.0, 0.0, 5e-3]]))
    assert "from above: the longest is 2.00 mrad" in picture.svg("")
    shafts = [
        np.diff(line, axis=0)[0]
        for shape in shapes_of(picture)
        if shape.tag == "polyline" and shape.attributes["stroke"] == AFTER
        if len(line := line_of(shape)) == 2
    ]
    assert shafts[0][0] == shafts[1][0] == pytest.approx(0.0)
    assert shafts[0][1] == pytest.approx(2.0 * shafts[1][1], abs=0.2)
    assert shafts[0][1] < 0.0
    assert not shafts[2].any()


def test_ticks_are_round_and_lie_inside() -> None:
    assert ticks((-0.31, 0.52), 5) == [
        (pytest.approx(n / 5), words)
        for n, words in ((-1, "−0.2"), (0, "0.0"), (1, "0.2"), (2, "0.4"))
    ]
    assert [words for _, words in ticks((0.0, 10.0), 4)] == ["0.0", "2.5", "5.0", "7.5", "10.0"]
    assert [words for _, words in ticks((-930.0, -320.0), 4)] == ["−800", "−600", "−400"]


def test_every_figure_stays_inside_its_picture(whole: PaperCampaign) -> None:
    html = page_of(evaluate(whole.campaign), "2026-03-02T09:30:00+00:00").html
    figures = [*page_tree(html).find("figure")]
    assert len(figures) == 11
    assert [figure.attributes["id"] for figure in figures if not inside(figure)] == []


def test_a_number_on_a_page_has_one_place_for_each_value() -> None:
    """What lies twice as far is drawn twice as far, upwards."""
    panel = Picture(60.0).panels(1, 1)[0][0]
    panel.axes((0.0, 4.0), (0.0, 2.0))
    (x0, y0), (x1, y1), (x2, y2) = panel.places(
        np.array([0.0, 1.0, 2.0]), np.array([0.0, 1.0, 2.0])
    )
    assert (x2 - x0, y2 - y0) == pytest.approx((2 * (x1 - x0), 2 * (y1 - y0)))
    assert (x1 > x0, y1 < y0) == (True, True)


def shapes_of(picture: Picture) -> list[Node]:
    return [*shapes(next(page_tree(picture.svg("")).find("svg")))]


def inside(figure: Picture | Node) -> bool:
    """Whether every shape has a place, and one within the picture."""
    svg = next((figure if isinstance(figure, Node) else page_tree(figure.svg(""))).find("svg"))
    _, _, width, height = map(float, svg.attributes["viewbox"].split())
    places = []
    for shape in shapes(svg):
        of = shape.attributes
        if shape.tag in {"polyline", "polygon"}:
            places += line_of(shape)
        else:
            x, y = ("cx", "cy") if shape.tag == "circle" else ("x", "y")
            places.append((float(of[x]), float(of[y])))
    return all(-1.0 <= x <= width + 1.0 and -1.0 <= y <= height + 1.0 for x, y in places)
