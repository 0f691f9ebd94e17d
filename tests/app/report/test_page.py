"""The page: what is on it, what it says when something is missing, and what it must never hold."""

import re
import shutil
from dataclasses import replace
from html import unescape
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest
from paper_campaign import CONTROLLER, LOAD_BEGUN, NOMINAL, PaperCampaign, new_campaign

from app.cli.report import report
from app.report import model_sections, record_sections
from app.report.page import Page, page_of
from campaigns.campaign import open_campaign
from campaigns.errors import JournalFailed, OutputExists
from campaigns.evaluation.diagnostics import Doubt, nests_told
from campaigns.evidence import Evaluation, MeasuredSeries, evaluate, gather
from campaigns.files.table import texts
from campaigns.identification.result import ComparedModel, Excluded, HoldOut, RobotScatter
from campaigns.journal.records import Event, Intent, PairVoided, Rejected, SeriesStarted
from campaigns.mechanisms.par4 import PAR4
from campaigns.settings.sections import AcceptanceConfig, NestConfig, PeopleConfig
from campaigns.shots.import_export import ImportedFile, append_import
from campaigns.shots.shot_sets import ShotSet
from campaigns.shots.shots_csv import ShotRow
from drivers.values import Identity, Pose

FIGURES = {
    *("shot-errors", "pair-errors", "histogram", "arrows", "against-position", "straightness"),
    *("rotation", "repeatability", "correlations", "over-time"),
}
EVIL = "<script>alert('θ & \"more\"')</script>"
MEGABYTE = 1_000_000
MADE_UTC = "2026-03-02T09:30:00.000+00:00"


def page(paper: PaperCampaign) -> Page:
    return page_of(evaluate(open_campaign(paper.folder)), MADE_UTC)


def html(paper: PaperCampaign) -> str:
    return page(paper).html


def figures(found: Page) -> set[str]:
    return set(found.outline.figures)


def missing(found: Page) -> str:
    return " ".join(found.outline.missing)


def words_of(text: str) -> str:
    """Texts of a page between its tags."""
    return " ".join(unescape(re.sub(r"<[^>]*>", " ", text)).split())


def words_on(found: Page, section: str = "") -> str:
    """The same of a page, or of one of its sections."""
    start = found.html.index(f'<section id="{section}">') if section else 0
    return words_of(found.html[start:].partition("</section>" if section else "</html>")[0])


def rows_in(found: Page, section: str) -> list[list[str]]:
    """Cells of a section's tables."""
    start = found.html.index(f'<section id="{section}">')
    text = found.html[start:].partition("</section>")[0]
    rows = re.findall(r"<tr>(.*?)</tr>", text, re.DOTALL)
    cells = (re.findall(r"<td[^>]*>(.*?)</td>", row, re.DOTALL) for row in rows)
    return [[unescape(cell) for cell in row] for row in cells if row]


def identified(paper: PaperCampaign, **changes: object) -> Page:
    """Page of a campaign whose identification says something else."""
    evidence = gather(paper.campaign)
    found = replace(evidence.identification, **changes)
    return page_of(Evaluation(replace(evidence, identification=found)), MADE_UTC)


class Outline(HTMLParser):
    """Tags and the ids, as a browser would see them."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.tags: list[str] = []
        self.ids: list[str] = []
        self.links: list[str] = []
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        found = dict(attrs)
        self.tags.append(tag)
        self.ids += [found["id"]] if "id" in found else []
        self.links += [found[name] for name in ("href", "src", "xlink:href") if name in found]


@pytest.fixture(scope="module")
def whole_html(whole: PaperCampaign) -> str:
    return html(whole)


def test_a_whole_campaign_has_every_figure_and_lacks_nothing(whole: PaperCampaign) -> None:
    found = page(whole)
    assert figures(found) == FIGURES
    assert found.outline.missing == {}


def test_shots_have_a_figure_only_where_positions_were_fitted(by_distances: PaperCampaign) -> None:
    assert figures(page(by_distances)) == FIGURES - {"shot-errors"}


def test_the_page_says_how_sure_it_is_and_the_verdict_first(whole_html: str) -> None:
    for words in (
        "scatter as the tracker states (χ²",
        "Predicted error of position",
        "residuals of the fitted coordinates",
    ):
        assert words in whole_html
    ids = Outline(whole_html).ids
    assert ids.index("verdict") < min(
        ids.index(name) for name in ("limits", "gain", "iso9283", "parameters", "provenance")
    )
    text = words_of(whole_html)
    row = re.search(
        r"repeatability, radius of the sphere [\d.]+ [\d.]+ [\d.]+ (no change|\d)", text
    )
    assert row is not None
    assert row[1] == "no change"
    box = whole_html[whole_html.index('id="verdict"') :].partition("</section>")[0]
    assert '<p class="decision">No limit asked for</p>' in box
    assert "Measured before and after: distances, mean error" in box
    assert 'class="no-limit-asked-for"' in box


def test_the_page_asks_nothing_of_a_network(whole_html: str) -> None:
    outline = Outline(whole_html)
    assert {link[:1] for link in outline.links} <= {"#", "d"}  # within the page, or `data:,`
    assert not {"img", "iframe", "object"} & set(outline.tags)
    assert "script" not in outline.tags
    style = whole_html[whole_html.index("<style>") : whole_html.index("</style>")]
    assert "@import" not in style
    assert "url(" not in style


def test_every_id_is_used_once_and_every_link_has_its_target(whole_html: str) -> None:
    outline = Outline(whole_html)
    assert len(outline.ids) == len(set(outline.ids))
    targets = {link[1:] for link in outline.links if link.startswith("#")}
    targets |= set(re.findall(r"url\(#([^)]+)\)", whole_html))
    assert targets <= set(outline.ids)


def test_the_page_is_small_enough_to_be_mailed(whole_html: str) -> None:
    assert len(whole_html.encode()) < 3 * MEGABYTE


def test_the_same_campaign_gives_the_same_words(whole: PaperCampaign) -> None:
    assert html(whole) == html(whole)


@pytest.mark.long
def test_the_same_campaign_gives_the_same_figures(whole: PaperCampaign, whole_html: str) -> None:
    assert html(whole) == whole_html


def test_what_people_wrote_is_shown_as_text_without_hidden_characters(tmp_path: Path) -> None:
    people = PeopleConfig(operator="Ann\x1b[2J\u202egpj", site=EVIL, notes=EVIL)
    paper = new_campaign(tmp_path / "evil", people=people)
    robot = tmp_path / "evil" / "robot.yaml"
    named = robot.read_text().replace("name: par4-prototype", 'name: "<script>alert(1)</script>"')
    robot.write_text(named)
    series = paper.measure("before", (), finished=False)
    with paper.journal() as journal:
        for note in (EVIL, "`<b>bold</b>`", "\u2066turned\x07\x9b"):
            journal.append(Event("operator note", note), series=series)
    text = html(paper)
    assert "script" not in Outline(text).tags
    assert "<h1>&lt;script&gt;alert(1)&lt;/script&gt;</h1>" in text
    assert text.count("&lt;script&gt;alert(&#39;θ &amp;") >= 3
    assert "<b>bold" not in text
    assert "Ann?[2J?gpj" in text
    assert "?turned??" in text
    assert not set("\x1b\x07\x9b\u202e\u2066") & set(text)


def test_a_campaign_without_a_journal_says_that_nothing_was_measured(tmp_path: Path) -> None:
    found = page(new_campaign(tmp_path / "empty"))
    assert figures(found) == set()
    assert "no journal" in missing(found)
    assert found.evaluation.verdict.decision == "not decided"


def test_without_validation_the_rest_is_shown_and_the_lack_is_named(tmp_path: Path) -> None:
    paper = new_campaign(tmp_path / "run")
    paper.run()
    paper.identify()
    found = page(paper)
    assert figures(found) == FIGURES - {"straightness", "rotation", "repeatability"}
    assert "validate --stage before" in missing(found)
    assert "validate --stage after" in missing(found)


def test_without_identification_errors_before_are_shown(tmp_path: Path) -> None:
    paper = new_campaign(tmp_path / "run")
    paper.run()
    found = page(paper)
    assert figures(found) == {"pair-errors", "histogram", "arrows", "over-time"}
    assert "pkmcal identify" in missing(found)
    assert "Nothing has been identified" in " ".join(found.evaluation.verdict.reasons)


def test_one_test_alone_is_shown(tmp_path: Path) -> None:
    for test in (ShotSet.ROTATION, ShotSet.STRAIGHTNESS, ShotSet.REPEATABILITY):
        paper = new_campaign(tmp_path / test.value)
        paper.validate("after", frozenset({test}))
        assert test.value in figures(page(paper))


def test_a_shot_or_two_are_enough_for_a_page(tmp_path: Path) -> None:
    for count, words in ((1, "unfinished"), (2, "Too few shots")):
        paper = new_campaign(tmp_path / str(count))
        paper.measure("run", paper.plan(1, 0)[:count], finished=False)
        assert words in html(paper)


def test_a_crashed_run_is_named_and_what_it_measured_is_shown(tmp_path: Path) -> None:
    paper = new_campaign(tmp_path / "crashed")
    paper.measure("run", paper.plan(20, 4)[:30], finished=False, stopped=False)
    found = page(paper)
    assert "without a stop record" in missing(found)
    assert "pair-errors" in figures(found)


def test_rejected_shots_and_voided_pairs_stand_with_their_reasons(tmp_path: Path) -> None:
    paper = new_campaign(tmp_path / "rejected")
    series = paper.measure("run", paper.plan(2, 0), finished=False)
    with paper.journal() as journal:
        target = Pose(1.0, 2.0, 3.0, 0.0)
        intent = Intent(1, 2, "identification", target, (0.0,) * 4, "joints", 0)
        journal.append(intent, series=series)
        journal.append(Rejected(1, 2, "beam broken: somebody walked through it"), series=series)
        journal.append(PairVoided(0, (1, 2), "its other shot was lost"), series=series)
    text = words_on(page(paper))
    assert "beam broken: somebody walked through it" in text
    assert "its other shot was lost" in text
    assert "Shots lost with the beam: 1." in text


def test_a_changed_parameter_file_takes_the_verdict_away(whole: PaperCampaign, tmp_path) -> None:
    paper = replace(whole, folder=shutil.copytree(whole.folder, tmp_path / "good"))
    settings = paper.folder / "campaign.yaml"
    asked = re.sub(r"distance_mean_mm:.*", "distance_mean_mm: 0.1", settings.read_text())
    settings.write_text(asked)
    assert page(paper).evaluation.verdict.decision == "pass"
    (paper.folder / "robot-compensated.yaml").write_text(NOMINAL.document.text)
    verdict = page(paper).evaluation.verdict
    assert verdict.decision == "not decided"
    assert "the parameter file contains the identified parameters" in " ".join(verdict.reasons)


def test_an_unreadable_plan_and_parameter_file_are_named(whole: PaperCampaign, tmp_path) -> None:
    folder = shutil.copytree(whole.folder, tmp_path / "copy")
    (folder / "plan.csv").write_text("no plan\n")
    (folder / "robot-compensated.yaml").write_text("no: robot\n")
    found = page(replace(whole, folder=folder))
    assert "plan.csv" in missing(found)
    assert "robot-compensated.yaml" in missing(found)
    assert figures(found) == FIGURES


def test_a_journal_of_another_version_shows_what_can_be_read(tmp_path: Path) -> None:
    paper = new_campaign(tmp_path / "old")
    golden = Path(__file__).parents[2] / "data" / "journal-v1.db"
    shutil.copy(golden, paper.campaign.journal_path)
    found = page(paper)
    assert "identification" in missing(found)
    assert "3.1 mm from the prediction" in found.html


def test_an_identification_without_correlations_says_so(whole: PaperCampaign) -> None:
    found = identified(whole, covariance=None)
    assert figures(found) == FIGURES - {"correlations"}
    assert "There are no correlations" in missing(found)


def test_everything_that_an_identification_says_stands_in_words(whole: PaperCampaign) -> None:
    shown = identified(
        whole,
        converged=False,
        condition=None,
        priors={"arm0.arm_mm": 0.25, "plate_mm": 1.0},
        models=(ComparedModel("with tilts", 30, -123.4, None, False, "left: no gain"),),
        unobservable=(("arm1.x_mm", "arm1.y_mm"),),
        known_by_priors_alone=(("plate_mm",),),
        excluded=(Excluded("too far", shot=3), Excluded("its other shot was lost", pair=7)),
    )
    text = words_on(shown)
    for sentence in (
        "it did not converge after",
        "with rank 22 of 22 and",
        "about the nominal values (1 σ, mm and deg): arm0.arm_mm ± 0.25, plate_mm ± 1.",
        "with tilts 30 −123 – left: no gain",
        "Not determined by these shots, and fixed: arm1.x_mm, arm1.y_mm.",
        "Known from the priors alone: plate_mm.",
        "shot 3 too far",
        "pair 7 its other shot was lost",
    ):
        assert sentence in text
    assert "Not determined by these shots" in missing(shown)


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        ({"chi": 1.2}, "explains: the model leaves nothing that this tracker could see."),
        ({"chi": 3.0, "repeatability_mm": None}, "explains. Repeatability was not measured, so"),
        ({"chi": 3.0, "repeatability_mm": 9.0}, "explains; the robot's repeatability accounts"),
        (
            {"chi": 3.0, "repeatability_mm": 0.3, "instrument_mm": 0.1, "residual_mm": 0.5},
            "and more than its repeatability accounts for. 0.400 mm (1 σ) remain that neither",
        ),
    ],
)
def test_what_is_left_over_is_put_down_to_its_cause(
    whole: PaperCampaign, changes: dict[str, float | None], sentence: str
) -> None:
    found = evaluate(whole.campaign)
    vars(found)["budget"] = replace(found.budget, **changes)  # as if it had been worked out
    assert sentence in words_on(page_of(found, MADE_UTC), "remainder")


def test_only_what_no_parameter_expresses_is_named_as_assumed(whole: PaperCampaign) -> None:
    parameters = gather(whole.campaign).identification.parameters
    free = replace(parameters["plate_mm"], std=None)
    space = whole.campaign.robot.mechanism.parameters

    def assumed(*names: str) -> str:
        shown = identified(whole, parameters=parameters | dict.fromkeys(names, free))
        return words_on(shown, "remainder")

    heat, play = " and do not grow with heat", "gears have no backlash"
    rods, level = "two rods of a forearm are alike", "the plate stays parallel to the base"
    axes = "motor axes and rails point as drawn"
    tilts = [name for name in space.extensions if name not in space.skews]
    whole_sentence = f"do not bend{heat}; the {rods}; {axes}; {level}; {play}. Parameters marked"
    assert whole_sentence in assumed()
    for names, gone in (
        (tilts, (axes, level)),
        (space.skews, (rods, level)),
        (space.backlashes, (play,)),
    ):
        kept = {heat, play, rods, axes, level} - {*gone}
        text = assumed(*names)
        assert not any(each in text for each in gone)
        assert all(each in text for each in kept)


def test_a_tracker_that_states_nothing_is_shown_as_that(whole: PaperCampaign) -> None:
    evidence = gather(whole.campaign)
    run = evidence.run.shots
    silent = replace(
        run,
        stated_covariance_mm2=np.full_like(run.stated_covariance_mm2, np.nan),
        temperature_degC=np.full_like(run.temperature_degC, np.nan),
    )
    measured = MeasuredSeries(evidence.run.series, lambda: silent)
    shown = page_of(Evaluation(replace(evidence, run=measured)), MADE_UTC)
    assert "run not stated – – – 0." in words_on(shown)


def test_a_foreign_message_is_told_as_it_is_and_shown_as_text(whole: PaperCampaign) -> None:
    message = "plan.csv:1: '<b>&amp;</b>' is no \"number\""
    evidence = replace(gather(whole.campaign), spoilt=(message,))
    shown = page_of(Evaluation(evidence), MADE_UTC)
    assert missing(shown) == f"Cannot be read: {message}."
    text = shown.html
    assert "&lt;b&gt;&amp;amp;&lt;/b&gt;" in text
    assert "<b>&" not in text


def test_a_damaged_journal_is_refused(tmp_path: Path) -> None:
    paper = new_campaign(tmp_path / "damaged")
    paper.campaign.journal_path.write_bytes(b"not a database" * 100)
    with pytest.raises(JournalFailed):
        page(paper)


def test_a_simulated_cell_is_called_that(tmp_path: Path) -> None:
    paper = new_campaign(tmp_path / "real")
    assert "Simulated cell" not in html(paper)
    settings = tmp_path / "real" / "campaign.yaml"
    real = settings.read_text()
    settings.write_text(re.sub(r"tcp://\S+", "sim://cell", real))
    assert "Simulated cell" in html(paper)
    settings.write_text(real)
    tracker = Identity("Leica", "SIM-LT", "390001", "1.0", "emScon")
    started = SeriesStarted("before", "p", {}, "0.1.0", "r", CONTROLLER, tracker, None)
    with paper.journal() as journal:
        journal.start_series(started)
    assert "Simulated: the tracker of series 1." in html(paper)


def test_an_import_names_its_files_and_is_never_called_simulated(tmp_path: Path) -> None:
    paper = new_campaign(tmp_path / "imported")
    settings = paper.folder / "campaign.yaml"
    settings.write_text(re.sub(r"tcp://\S+", "sim://cell", settings.read_text()))
    planned = paper.plan(2, 0)[1:-1]
    rows = tuple(ShotRow(s.pair, s.joints, (1000.0 + s.shot, 2.0, 3.0), s.purpose) for s in planned)
    file = ImportedFile("points of May.csv", "5e" * 32)
    with paper.journal() as journal:
        for files in ((), (file,)):
            append_import(journal, rows, NOMINAL.robot.kinematics, "r", {}, files)
    words = words_of(html(paper))
    assert "Simulated" not in words
    assert f"2 points of May.csv {'5e' * 32}" in words
    assert "1 not recorded by the software that imported them" in words
    assert "plan as measured" not in words


def test_every_doubt_stands_with_its_name_sentence_and_numbers(whole: PaperCampaign) -> None:
    doubts = (
        Doubt("common-scale", "all lengths grew", "fail", {"share": 0.0101, "p": 1e-9}),
        Doubt("large-change", "arm 2 is long", "fail", {"beyond": 1.0}, accepted=True),
        Doubt("careful-statement", "too quiet", None, {"birge_ratio": 0.1, "kind": "stated"}),
    )
    text = words_on(identified(whole, doubts=doubts))
    for row in (
        "common-scale all lengths grew share 0.0101, p 1e−09 verdict: fail",
        "large-change arm 2 is long beyond 1 accepted all the same",
        "careful-statement too quiet birge_ratio 0.1, kind stated no effect",
        "Accepted all the same: arm 2 is long.",
    ):
        assert row in text
    assert "The identification states no doubt." not in text
    assert "The identification states no doubt." in words_on(identified(whole, doubts=()))


def test_what_nests_tell_stands_with_its_deviation(whole: PaperCampaign) -> None:
    doubts = (
        nests_told("stand", 0.314, 0.0074, (163, 177)),
        nests_told("robot", 0.5, 0.1, (0, 84)),
    )
    rows = rows_in(identified(whole, doubts=doubts), "tracker")
    what_to_do = [record_sections.MOVED[kind][1] for kind in ("stand", "robot")]
    assert rows[-2:] == [
        ["the tracker's stand", "0.314", "0.0074", "163 and 177", what_to_do[0]],
        ["the robot, at its drift pose", "0.500", "0.1000", "0 and 84", what_to_do[1]],
    ]


@pytest.mark.parametrize("count", [2, 3])
def test_three_nests_that_tell_of_no_motion_are_named(whole: PaperCampaign, count: int) -> None:
    evidence = gather(whole.campaign)
    nests = tuple(NestConfig(name=name) for name in "ABC"[:count])
    config = whole.campaign.config.model_copy(update={"nests": nests})
    with_nests = replace(evidence, campaign=replace(evidence.campaign, config=config))
    text = words_on(page_of(Evaluation(with_nests), MADE_UTC), "tracker")
    assert ("The nests show no significant motion of stand or robot." in text) is (count == 3)


def test_the_robots_scatter_and_the_hold_out_test_stand_in_words(whole: PaperCampaign) -> None:
    scatter = RobotScatter(point_mm=0.14, says="the point scatters by 0.14 ± 0.005 mm")
    text = words_on(identified(whole, robot_scatter=scatter))
    assert "The robot's own scatter: the point scatters by 0.14 ± 0.005 mm. Every σ" in text
    held = HoldOut(8, 12.34, 0.031, 1.24)
    text = words_on(identified(whole, hold_out=held, doubts=()))
    assert "8 pairs that were never fitted are 1.24 times as far off as their σ predict" in text
    assert "(χ² 12.3, p = 0.031). That agrees with these σ." in text
    doubt = Doubt("hold-out", "the model lacks something", "not decided", {"ratio": 4.0})
    text = words_on(identified(whole, hold_out=replace(held, ratio=4.0), doubts=(doubt,)))
    assert "That is not believable: see Doubts." in text
    assert "Hold-out test" not in words_on(identified(whole, hold_out=None))


def test_a_load_without_an_end_stands_above_the_verdict(tmp_path: Path) -> None:
    paper = new_campaign(tmp_path / "loading")
    assert 'class="alarm"' not in html(paper)
    with paper.journal() as journal:
        journal.append(LOAD_BEGUN)
    text = html(paper)
    alarm = text.index("A load of robot-compensated.yaml was begun at")
    assert text.index('class="alarm"') < alarm < text.index('id="verdict"')


def test_a_parameter_within_its_uncertainty_shows_no_change(whole: PaperCampaign) -> None:
    parameters = gather(whole.campaign).identification.parameters
    found = {
        "arm0.x_mm": replace(
            parameters["plate_mm"], nominal=1.0, value=1.19, std=0.1, total_std=0.1
        ),
        "plate_mm": replace(
            parameters["plate_mm"], nominal=1.0, value=1.21, std=0.1, total_std=0.1
        ),
    }
    usual, with_few = (
        texts(model_sections.parameters(interval, PAR4.parameters), found.items())
        for interval in (1.96, 2.3)
    )
    assert [row[-1] for row in usual] == ["no change shown", ""]
    assert [row[6] for row in usual] == ["0.1960", "0.1960"]
    assert [row[-1] for row in with_few] == ["no change shown"] * 2


def test_only_figures_of_the_cube_have_a_symbol_of_the_standard(whole: PaperCampaign) -> None:
    ap, rp, *rows = rows_in(page(whole), "iso9283")
    assert ap[0].startswith("pose accuracy AP")
    assert rp[0].startswith("pose repeatability RP")
    poses = [row for row in rows if row[1][:1] == "P"]
    assert [row[:2] for row in poses] == [
        [stage, f"P{n}"] for stage in ("before", "after") for n in range(1, 6)
    ]
    assert ap[4] in {row[6] for row in poses[5:]}
    for *ours, theirs in rows[: -len(poses)]:
        assert not re.search(r"\b(AP|RP|vAP|AD|RD|AT)\b", " ".join(ours))
        assert re.match(r"(AP|RP|vAP|AD|RD|AT) \(", theirs)


def test_a_limit_stands_with_its_margin(tmp_path: Path) -> None:
    limits = AcceptanceConfig(distance_mean_mm=0.5)
    paper = new_campaign(tmp_path / "margin", acceptance=limits)
    paper.validate("after", frozenset({ShotSet.VALIDATION}))
    first = rows_in(page(paper), "limits")[0]
    error, margin = float(first[1]), float(first[4].replace("−", "-"))
    assert first[0] == "distances, mean error"
    assert margin == pytest.approx(0.5 - error, abs=0.001)


def test_an_older_report_is_replaced_and_no_other_file(tmp_path: Path) -> None:
    paper = new_campaign(tmp_path / "paper")
    for _ in range(2):
        assert report(paper.campaign)[1] == paper.folder / "report.html"
    other = tmp_path / "thesis.html"
    other.write_text("<html>years of work</html>")
    with pytest.raises(OutputExists):
        report(paper.campaign, other)
    assert other.read_text() == "<html>years of work</html>"
