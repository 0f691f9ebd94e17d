"""The page: what is on it, what it says when something is missing, and what it must never hold."""

import re
import shutil
from dataclasses import replace
from html import unescape
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest
from changed_results import with_fields
from paper_campaign import LOAD_BEGUN, NOMINAL, PaperCampaign, new_campaign

from app.cli.report import report
from app.report.page import Page, page_of
from app.report.record import incidents_section, tracker_section
from app.report.results import (
    budget_section,
    gain_section,
    limits_section,
    motion_tests_section,
    parameters_section,
)
from app.report.section import Section
from app.report.tables import correlations, parameters, undetermined_in_words, undetermined_rows
from campaigns.assessment import Evaluation, evaluate
from campaigns.campaign import open_campaign
from campaigns.errors import OutputExists
from campaigns.evidence import Incident, MeasuredSeries, gather
from campaigns.files.table import texts
from campaigns.identification.findings import Finding, HoldOut
from campaigns.identification.result import (
    Excluded,
    Frame,
    ParameterCovariance,
    Pedigree,
    Scatter,
    SessionFrame,
)
from campaigns.journal.records import Event, Intent, PairVoided, Rejected
from campaigns.kinematics.catalog import PAR4
from campaigns.settings.sections import AcceptanceConfig, PeopleConfig
from campaigns.shots.import_export import ImportedFile, ImportedSeries, append_import
from campaigns.shots.shot_sets import ShotSet
from campaigns.shots.shots_csv import ShotRow
from drivers.values import Pose

FIGURES = {
    *("pair-errors", "arrows", "against-position", "straightness"),
    *("rotation", "repeatability", "correlations", "over-time", "course-of-shots"),
}
EVIL = "<script>alert('θ & \"more\"')</script>"
MADE_UTC = "2026-03-02T09:30:00.000+00:00"


def page(paper: PaperCampaign) -> Page:
    return page_of(evaluate(open_campaign(paper.folder)), MADE_UTC)


def html(paper: PaperCampaign) -> str:
    return page(paper).html


def figures(page: Page) -> set[str]:
    return set(page.figures)


def missing(page: Page) -> str:
    return " ".join(page.missing)


def words_of(text: str) -> str:
    """Texts of a page between its tags."""
    return " ".join(unescape(re.sub(r"<[^>]*>", " ", text)).split())


def words_on(page: Page, section: str = "") -> str:
    """Texts of a page, or of one of its sections."""
    start = page.html.index(f'<section id="{section}">') if section else 0
    return words_of(page.html[start:].partition("</section>" if section else "</html>")[0])


def identified(evaluation: Evaluation, **changes: object) -> Evaluation:
    """A campaign with another identification; without correlations, whose figure takes a while."""
    evidence = evaluation.evidence
    result = with_fields(evidence.identification, **({"covariance": None} | changes))
    return Evaluation(replace(evidence, identification=result))


def rows_of(section: Section) -> list[list[str]]:
    """Cells of a section's tables."""
    return [[*row] for block in section.blocks if block.form == "table" for row in block.rows]


def words_in(section: Section) -> str:
    """Paragraphs of a section, and the cells of its tables."""
    texts = [text for block in section.blocks for text in (block.title, block.text)]
    return " ".join([*texts, *(cell for row in rows_of(section) for cell in row)])


class Outline(HTMLParser):
    """Tags and the ids, as a browser would see them."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.tags: list[str] = []
        self.ids: list[str] = []
        self.links: list[str] = []
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        values = dict(attrs)
        self.tags.append(tag)
        self.ids += [values["id"]] if "id" in values else []
        self.links += [values[name] for name in ("href", "src", "xlink:href") if name in values]


@pytest.fixture(scope="module")
def whole_page(evaluation: Evaluation) -> Page:
    return page_of(evaluation, MADE_UTC)


def test_a_whole_campaign_has_every_figure_and_the_verdict_first(whole_page: Page) -> None:
    assert figures(whole_page) == FIGURES
    assert [text[:15] for text in whole_page.missing] == ["No traceability"]
    ids = Outline(whole_page.html).ids
    assert ids.index("verdict") < min(
        ids.index(name) for name in ("limits", "gain", "tests", "parameters", "provenance")
    )
    head = '<section id="verdict" class="no-limits-specified">'
    box = words_of(whole_page.html.partition(head)[2].partition("</section>")[0])
    assert "No limits specified" in box
    assert "Measured before and after: distances, mean error" in box
    text = words_of(whole_page.html)
    assert "JCGM 106:2012" in text
    assert "U contains the instrument and the robot's scatter" in text
    for words in (
        "Robot repeatability: ",
        "Predicted σ of positions over the workspace: 0.0",
        "Uncertainty budget of positions",
        "Valid for 100 % of the workspace",
    ):
        assert words in text
    assert re.search(r"radius of the sphere [\d.]+ [\d.]+ no change[^\d]*[\d.]+", text)


def test_the_page_links_to_nothing_but_its_own_parts_each_with_one_id(whole_page: Page) -> None:
    outline = Outline(whole_page.html)
    assert {link[:1] for link in outline.links} <= {"#", "d"}  # within the page, or `data:,`
    assert not {"img", "iframe", "object", "script"} & set(outline.tags)
    style = whole_page.html.partition("<style>")[2].partition("</style>")[0]
    assert "@import" not in style
    assert "url(" not in style
    assert len(outline.ids) == len(set(outline.ids))
    targets = {link[1:] for link in outline.links if link.startswith("#")}
    targets |= set(re.findall(r"url\(#([^)]+)\)", whole_page.html))
    assert targets <= set(outline.ids)


def test_events_and_names_are_shown_as_text_without_hidden_characters(tmp_path: Path) -> None:
    people = PeopleConfig(operator="Ann\x1b[2J\u202egpj", site=EVIL, notes=EVIL)
    paper = new_campaign(tmp_path / "evil", people=people)
    robot = tmp_path / "evil" / "robot.yaml"
    named = robot.read_text().replace("name: par4-prototype", 'name: "<script>alert(1)</script>"')
    robot.write_text(named)
    series = paper.measure("before", paper.plan(1, 0)[:1], finished=False)
    with paper.journal() as journal:
        for note in (EVIL, "`<b>bold</b>`", "\u2066turned\x07\x9b"):
            journal.append(Event("operator note", note), series=series)
        target = Pose(1.0, 2.0, 3.0, 0.0)
        intent = Intent(1, 2, "identification", target, (0.0,) * 4, "joints", 0)
        journal.append(intent, series=series)
        journal.append(Rejected(1, 2, "beam broken: somebody walked by"), series=series)
        journal.append(PairVoided(0, (1, 2), "its other shot was lost"), series=series)
    text = html(paper)
    assert "script" not in Outline(text).tags
    assert "<h1>&lt;script&gt;alert(1)&lt;/script&gt;</h1>" in text
    assert text.count("&lt;script&gt;alert(&#39;θ &amp;") >= 3
    assert "<b>bold" not in text
    assert not set("\x1b\x07\x9b\u202e\u2066") & set(text)
    for words in (
        "Ann?[2J?gpj",
        "?turned??",
        "beam broken: somebody walked by",
        "its other shot was lost",
        "Shots lost with the beam: 1.",
    ):
        assert words in text


def test_a_page_shows_what_a_campaign_has_and_names_what_it_lacks(tmp_path: Path) -> None:
    paper = new_campaign(tmp_path / "grows")
    empty = page(paper)
    assert figures(empty) == set()
    assert "no journal" in missing(empty)
    assert empty.evaluation.verdict.decision == "not decided"
    paper.run()
    measured = page(paper)
    assert figures(measured) == {"pair-errors", "arrows", "over-time"}
    assert "pkmcal identify" in missing(measured)
    assert "Nothing has been identified" in " ".join(measured.evaluation.verdict.reasons)
    paper.identify("paper")
    result = page(paper)
    tests = {"straightness", "rotation", "repeatability"}
    assert figures(result) == FIGURES - tests - {"course-of-shots"}, "the paper has no diagnosis"
    assert 'id="budget"' in result.html
    assert "validate --stage before" in missing(result)
    assert "validate --stage after" in missing(result)


def test_one_test_alone_is_shown_and_an_equal_campaign_gives_an_equal_page(tmp_path: Path) -> None:
    for test in (ShotSet.ROTATION, ShotSet.STRAIGHTNESS, ShotSet.REPEATABILITY):
        paper = new_campaign(tmp_path / test.value)
        paper.validate("after", frozenset({test}))
        section = motion_tests_section(evaluate(paper.campaign))
        assert [block.name for block in section.blocks if block.name] == [test.value]
    assert html(paper) == html(paper)


@pytest.mark.parametrize(
    ("count", "stopped", "words"),
    [(1, True, "unfinished"), (2, True, "Too few shots"), (3, False, "without a stop record")],
)
def test_a_few_shots_are_enough_for_a_page(
    tmp_path: Path, count: int, stopped: bool, words: str
) -> None:
    paper = new_campaign(tmp_path / "few")
    paper.measure("run", paper.plan(1, 0)[:count], finished=False, stopped=stopped)
    result = page(paper)
    assert words in result.html
    assert ("pair-errors" in figures(result)) == (count == 3)


def test_a_changed_parameter_file_takes_the_verdict_away(whole: PaperCampaign, tmp_path) -> None:
    paper = whole.copy_to(tmp_path / "good", acceptance=AcceptanceConfig(distance_mean_mm=0.1))
    assert evaluate(paper.campaign).verdict.decision == "pass"
    (paper.folder / "robot-compensated.yaml").write_text(NOMINAL.document.text)
    verdict = evaluate(paper.campaign).verdict
    assert verdict.decision == "not decided"
    assert "parameter file does not contain the identified parameters" in " ".join(verdict.reasons)


def test_unreadable_files_and_lacking_correlations_are_named(whole, tmp_path: Path) -> None:
    folder = shutil.copytree(whole.folder, tmp_path / "<b>&")
    (folder / "plan.csv").write_text("no plan\n")
    (folder / "robot-compensated.yaml").write_text("no: robot\n")
    result = page_of(identified(Evaluation(gather(open_campaign(folder)))), MADE_UTC)
    assert "plan.csv" in missing(result)
    assert "robot-compensated.yaml" in missing(result)
    assert "The identification states no correlations." in result.missing
    assert figures(result) == FIGURES - {"correlations"}
    assert "&lt;b&gt;&amp;" in result.html
    assert "<b>&" not in result.html


def test_a_journal_of_another_version_shows_what_can_be_read(tmp_path: Path) -> None:
    paper = new_campaign(tmp_path / "old")
    golden = Path(__file__).parents[2] / "data" / "journal-v1.db"
    shutil.copy(golden, paper.campaign.journal_path)
    result = page(paper)
    assert "identification" in missing(result)
    assert "3.1 mm from the prediction" in result.html


def test_everything_that_an_identification_says_stands_on_the_page(evaluation: Evaluation) -> None:
    pedigree = Pedigree(updates="c0ffee" * 8, series=(2, 5), shots=8, position_std_before_mm=0.02)
    shown = identified(
        evaluation,
        converged=False,
        iterations=40,
        scatter=Scatter(0.14, 0.01, {}, "robot repeatability: 0.14 mm"),
        undetermined=(("scale",), ("arm1.x_mm", "arm1.y_mm")),
        tracker={"constant": (0.0123, 0.004), "scale": (-3.0, 9.8)},
        excluded=(Excluded("too far", shot=3), Excluded("its other shot was lost", pair=7)),
        reference_degC=22.5,
        pedigree=pedigree,
        hold_out=HoldOut(8, 12.34, 0.031, 1.24),
    )
    sections = (parameters_section, tracker_section, incidents_section, gain_section)
    text = " ".join(words_in(section(shown)) for section in sections)
    for sentence in (
        "Model full: the fit did not converge in 40 iterations.",
        "Robot repeatability: 0.14 mm.",
        "Parameters are those at 22.5 °C.",
        "Made of the set c0ffeec0ffee by 8 shots of a check (series 2, 5); σ of positions was",
        "Determined by no shot, and kept at nominal",
        "arm1.x_mm, arm1.y_mm",
        "the reflector's constant +0.0123 0.0040 mm",
        "the tracker's scale −3.0 9.8 ppm",
        "shot 3 too far",
        "pair 7 its other shot was lost",
        "8 hold-out pairs are 1.24 times as far off as their σ predict (χ² 12.3, p = 0.031",
        "that agrees with these σ.",
    ):
        assert sentence in text


def test_motions_of_the_base_are_named_and_the_datum_has_no_correlations(
    evaluation: Evaluation,
) -> None:
    arms = ("arm0.x_mm", "arm1.x_mm"), ("arm0.y_mm", "arm1.y_mm")
    names = (*arms[0], *arms[1], "arm0.arm_mm", "arm0.forearm_mm", "arm0.axis_tilt_deg")
    matrix = np.full((7, 7), 0.9) + 0.1 * np.eye(7)
    covariance = ParameterCovariance(names, tuple(map(tuple, matrix.tolist())))
    motions = "shift of the base along x", ""
    shown = identified(evaluation, undetermined=arms, motions=motions, covariance=covariance)
    result = shown.evidence.identification
    assert [*undetermined_rows(result)] == [
        ("shift of the base along x", "arm0.x_mm, arm1.x_mm"),
        ("combination", "arm0.y_mm, arm1.y_mm"),
    ]
    assert "shift of the base along x" in words_in(parameters_section(shown))
    assert [*undetermined_in_words(result)] == [
        "not observable: shift of the base along x: kept at nominal",
        "1 parameter combination is not observable: kept at nominal (the report lists them)",
    ]
    pairs = [{pair.first, pair.second} for pair in correlations(result)]
    assert pairs == [{"arm0.arm_mm", "arm0.forearm_mm"}], "neither the datum nor small parts"
    older = identified(evaluation, undetermined=arms, motions=()).evidence.identification
    assert [what for what, _ in undetermined_rows(older)] == ["combination"] * 2


@pytest.mark.usefixtures("undrawn")
def test_a_warning_of_the_series_stands_beside_the_verdict(evaluation: Evaluation) -> None:
    evidence = evaluation.evidence
    series = evidence.run.series.number

    def with_events(*events: Event, of: int = series) -> Evaluation:
        incidents = tuple(Incident(MADE_UTC, of, event) for event in events)
        journal = replace(evidence.journal, incidents=incidents)
        return Evaluation(replace(evidence, journal=journal))

    moves, settled = Event("settling", "it <b>moves</b>"), Event("settling", "no drift", (7, 9, 11))
    changed = Event("robot changed", "it has changed")
    html = page_of(with_events(settled, moves, changed), MADE_UTC).html
    verdict = html[html.index('id="verdict"') : html.index("<nav")]
    assert "Warning: it &lt;b&gt;moves&lt;/b&gt;." in verdict
    assert "Warning: it has changed." in verdict
    assert with_events(moves, settled).evidence.warnings == ()
    assert with_events(moves, of=evidence.after[-1].series.number).evidence.warnings
    assert with_events(moves, of=99).evidence.warnings == ()


def test_each_session_s_frame_stands_with_its_shots(evaluation: Evaluation) -> None:
    frame = Frame(2400.0, 250.0, -150.0, 140.0, 4.0, -3.0)
    sessions = (SessionFrame((0, 1, 2), frame), SessionFrame((3, 4)), SessionFrame((5, 9), frame))
    values = ["2400.000", "250.000", "−150.000", "140.0000", "4.0000", "−3.0000"]
    for changes, shots in (
        ({"frame": frame}, ["all"]),
        ({"frame": frame, "sessions": sessions}, ["0 to 2", "5 to 9"]),
    ):
        rows = rows_of(tracker_section(identified(evaluation, **changes)))
        assert rows[-len(shots) :] == [[numbers, *values] for numbers in shots]


def test_a_tracker_that_states_nothing_is_shown_as_that(evaluation: Evaluation) -> None:
    evidence = evaluation.evidence
    run = evidence.run.shots
    silent = replace(
        run,
        stated_covariance_mm2=np.full_like(run.stated_covariance_mm2, np.nan),
        temperature_degC=np.full_like(run.temperature_degC, np.nan),
    )
    measured = MeasuredSeries(evidence.run.series, evidence.campaign.robot.mechanism)
    vars(measured)["shots"] = silent
    row = rows_of(tracker_section(Evaluation(replace(evidence, run=measured))))[1]
    assert row[3:6] == ["limits: not recorded", "–", "–"]
    assert 0.005 < float(row[1]) < float(row[2]), "by the limits, which grow with distance"


def test_an_import_names_its_files_and_is_never_called_simulated(tmp_path: Path) -> None:
    paper = new_campaign(tmp_path / "imported")
    settings = paper.folder / "campaign.yaml"
    settings.write_text(re.sub(r"tcp://\S+", "sim://cell", settings.read_text()))
    planned = paper.plan(2, 0)[1:-1]
    rows = tuple(ShotRow(s.pair, s.joints, (1000.0 + s.shot, 2.0, 3.0), s.purpose) for s in planned)
    file = ImportedFile("points of May.csv", "5e" * 32)
    with paper.journal() as journal:
        for files in ((), (file,)):
            append_import(journal, rows, NOMINAL.robot.kinematics, ImportedSeries("r", {}, files))
    words = words_of(html(paper))
    assert "Simulated" not in words
    assert f"2 points of May.csv {'5e' * 32}" in words
    assert "1 not recorded by the software that imported them" in words
    assert "plan as measured" not in words


def test_every_finding_stands_with_its_sentence_and_consequence(evaluation: Evaluation) -> None:
    findings = (
        Finding("change", "arm 0 changed", "fail", {"size": 0.0101}),
        Finding("beyond-tolerance", "arm 2 is long", "fail", accepted=True),
        Finding("wrong-shots", "left out: shots 7", None),
    )
    changed = identified(evaluation, findings=findings)
    assert rows_of(parameters_section(changed))[:3] == [
        ["change", "arm 0 changed", "verdict: fail"],
        ["beyond-tolerance", "arm 2 is long", "accepted"],
        ["wrong-shots", "left out: shots 7", "reported only"],
    ]
    assert "Accepted all the same: arm 2 is long." in " ".join(changed.verdict.reasons)
    bare = identified(evaluation, findings=(), budget=(), hold_out=HoldOut(8, 12.3, 1e-5, 1.2))
    assert "has no findings" in words_in(parameters_section(bare))
    assert "that contradicts these σ." in words_in(gain_section(bare))
    assert budget_section(bare).blocks == []


def test_a_load_without_an_end_stands_above_the_verdict(tmp_path: Path) -> None:
    paper = new_campaign(tmp_path / "loading")
    assert 'class="alarm"' not in html(paper)
    with paper.journal() as journal:
        journal.append(LOAD_BEGUN)
    text = html(paper)
    alarm = text.index("A load of robot-compensated.yaml was begun at")
    assert text.index('class="alarm"') < alarm < text.index('id="verdict"')


def test_a_parameter_says_whether_it_was_fitted_determined_and_changed(
    evaluation: Evaluation,
) -> None:
    fitted = evaluation.evidence.identification.value.parameters["plate_mm"]
    plate = replace(fitted, nominal=1.0, std=0.1)
    values = {
        "arm0.x_mm": replace(plate, value=1.19),
        "arm0.y_mm": replace(plate, value=1.21),
        "arm0.z_mm": replace(plate, value=1.0, std=None),
        "plate_mm": replace(plate, value=1.0, std=None, free=False),
    }
    rows = texts(parameters(PAR4.parameters), values.items())
    assert rows[0] == ("arm0.x", "mm", "1.00", "1.19", "+0.19", "0.10", "≤ U")
    assert [row[-1] for row in rows[1:]] == ["", "not determined", "held"]


def test_ap_and_rp_stand_pose_by_pose_and_worst_first(evaluation: Evaluation) -> None:
    ap, rp, *rows = rows_of(motion_tests_section(evaluation))
    assert ap[0].startswith("pose accuracy AP")
    assert rp[0].startswith("pose repeatability RP")
    poses = [row for row in rows if row[1][:1] == "P"]
    assert [row[:2] for row in poses] == [
        [stage, f"P{n}"] for stage in ("before", "after") for n in range(1, 6)
    ]
    assert ap[4] in {row[6] for row in poses[5:]}


def test_a_limit_stands_with_its_margin(tmp_path: Path) -> None:
    limits = AcceptanceConfig(distance_mean_mm=0.5)
    paper = new_campaign(tmp_path / "margin", acceptance=limits)
    paper.validate("after", frozenset({ShotSet.VALIDATION}))
    first = rows_of(limits_section(evaluate(paper.campaign)))[0]
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


def test_visits_of_the_drift_pose_have_one_row_of_each_series(evaluation: Evaluation) -> None:
    evidence = evaluation.evidence
    words = "the drift pose is {} mm from where it was first, limit 1 mm"
    drifts = [
        Event("drift check", f"shot {n}: {words.format(d)}") for n, d in ((3, 0.012), (9, 0.058))
    ]
    nest = Event("drift check", "shot 4: nest A is 0.010 mm from where it was first, limit 1 mm")
    incidents = [Incident(MADE_UTC, 1, event) for event in (drifts[0], nest, drifts[1], nest)]
    incidents.append(Incident(MADE_UTC, 2, drifts[0]))
    journal = replace(evidence.journal, incidents=tuple(incidents))
    text = words_in(incidents_section(Evaluation(replace(evidence, journal=journal))))
    assert f"largest of 2 drifts: shot 9: {words.format(0.058)}" in text
    assert text.count("nest A") == 2
    assert text.count("the drift pose") == 2, "one row of each series"
    assert f"2 drift check shot 3: {words.format(0.012)}" in text, "a single visit has no count"
