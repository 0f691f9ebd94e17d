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
from app.report.page import Page, page_of
from app.report.record import incidents_section, tracker_section
from app.report.results import (
    gain_section,
    limits_section,
    motion_tests_section,
    parameters_section,
)
from app.report.section import Section
from app.report.tables import parameters
from campaigns.campaign import open_campaign
from campaigns.errors import JournalFailed, OutputExists
from campaigns.evidence import Evaluation, MeasuredSeries, evaluate, gather
from campaigns.files.table import texts
from campaigns.identification.findings import Finding, HoldOut
from campaigns.identification.result import Excluded, Frame, Pedigree, Scatter, SessionFrame
from campaigns.journal.records import Event, Intent, PairVoided, Rejected, SeriesStarted
from campaigns.kinematics.catalog import PAR4
from campaigns.settings.sections import AcceptanceConfig, PeopleConfig
from campaigns.shots.import_export import ImportedFile, ImportedSeries, append_import
from campaigns.shots.shot_sets import ShotSet
from campaigns.shots.shots_csv import ShotRow
from drivers.values import Identity, Pose

FIGURES = {
    *("pair-errors", "arrows", "against-position", "straightness"),
    *("rotation", "repeatability", "correlations", "over-time"),
}
EVIL = "<script>alert('θ & \"more\"')</script>"
MADE_UTC = "2026-03-02T09:30:00.000+00:00"


def page(paper: PaperCampaign) -> Page:
    return page_of(evaluate(open_campaign(paper.folder)), MADE_UTC)


def html(paper: PaperCampaign) -> str:
    return page(paper).html


def figures(found: Page) -> set[str]:
    return set(found.figures)


def missing(found: Page) -> str:
    return " ".join(found.missing)


def words_of(text: str) -> str:
    """Texts of a page between its tags."""
    return " ".join(unescape(re.sub(r"<[^>]*>", " ", text)).split())


def words_on(found: Page, section: str = "") -> str:
    """The same of a page, or of one of its sections."""
    start = found.html.index(f'<section id="{section}">') if section else 0
    return words_of(found.html[start:].partition("</section>" if section else "</html>")[0])


def identified(paper: PaperCampaign, **changes: object) -> Evaluation:
    """What is said of a campaign whose identification says something else."""
    evidence = gather(paper.campaign)
    found = replace(evidence.identification, **changes)
    return Evaluation(replace(evidence, identification=found))


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
        found = dict(attrs)
        self.tags.append(tag)
        self.ids += [found["id"]] if "id" in found else []
        self.links += [found[name] for name in ("href", "src", "xlink:href") if name in found]


@pytest.fixture(scope="module")
def whole_page(whole: PaperCampaign) -> Page:
    return page(whole)


@pytest.fixture(scope="module")
def whole_html(whole_page: Page) -> str:
    return whole_page.html


def test_a_whole_campaign_has_every_figure_and_lacks_nothing(whole_page: Page) -> None:
    assert figures(whole_page) == FIGURES
    assert [text[:15] for text in whole_page.missing] == ["No traceability"]


def test_the_papers_model_has_all_figures_and_no_budget(by_distances: PaperCampaign) -> None:
    found = page(by_distances)
    assert figures(found) == FIGURES
    assert 'id="budget"' not in found.html


def test_the_page_says_how_sure_it_is_and_the_verdict_first(whole_html: str) -> None:
    for words in (
        "Robot repeatability: ",
        "Predicted σ of positions over the workspace: 0.0",
        "Uncertainty budget of positions",
        "Valid for 100 % of the workspace",
    ):
        assert words in whole_html
    ids = Outline(whole_html).ids
    assert ids.index("verdict") < min(
        ids.index(name) for name in ("limits", "gain", "tests", "parameters", "provenance")
    )
    text = words_of(whole_html)
    row = re.search(
        r"repeatability, radius of the sphere [\d.]+ [\d.]+ (no change|\d)[^\d]*[\d.]+", text
    )
    assert row is not None
    assert row[1] == "no change"
    box = whole_html[whole_html.index('id="verdict"') :].partition("</section>")[0]
    assert '<p class="decision">No limits specified</p>' in box
    assert "Measured before and after: distances, mean error" in box
    assert 'class="no-limits-specified"' in box


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


def test_the_same_campaign_gives_the_same_page(whole: PaperCampaign, whole_html: str) -> None:
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
    assert figures(found) == {"pair-errors", "arrows", "over-time"}
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
    assert evaluate(open_campaign(paper.folder)).verdict.decision == "pass"
    (paper.folder / "robot-compensated.yaml").write_text(NOMINAL.document.text)
    verdict = evaluate(open_campaign(paper.folder)).verdict
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
    found = page_of(identified(whole, covariance=None), MADE_UTC)
    assert figures(found) == FIGURES - {"correlations"}
    assert found.missing[:-1] == ("The identification states no correlations.",)


def test_everything_that_an_identification_says_stands_on_the_page(whole: PaperCampaign) -> None:
    pedigree = Pedigree(updates="c0ffee" * 8, series=(2, 5), shots=8, position_std_before_mm=0.02)
    shown = identified(
        whole,
        converged=False,
        iterations=40,
        scatter=Scatter(0.14, 0.01, {}, "robot repeatability: 0.14 mm"),
        undetermined=(("scale",), ("arm1.x_mm", "arm1.y_mm")),
        tracker={"constant": (0.0123, 0.004), "scale": (-3.0, 9.8)},
        excluded=(Excluded("too far", shot=3), Excluded("its other shot was lost", pair=7)),
        reference_degC=22.5,
        pedigree=pedigree,
    )
    sections = (parameters_section, tracker_section, incidents_section)
    text = " ".join(words_in(section(shown)) for section in sections)
    for sentence in (
        "Model full: the fit did not settle after 40 rounds.",
        "Robot repeatability: 0.14 mm.",
        "Parameters are those at 22.5 °C.",
        "Made of the set c0ffeec0ffee by 8 shots of a check (series 2, 5); σ of positions was",
        "Determined by no shot, and kept at nominal",
        "arm1.x_mm, arm1.y_mm",
        "the reflector's constant +0.0123 0.0040 mm",
        "the tracker's scale −3.0000 9.8000 ppm",
        "shot 3 too far",
        "pair 7 its other shot was lost",
    ):
        assert sentence in text


def test_each_session_s_frame_stands_with_its_shots(whole: PaperCampaign) -> None:
    frame = Frame(2400.0, 250.0, -150.0, 140.0, 4.0, -3.0)
    sessions = (SessionFrame((0, 1, 2), frame), SessionFrame((3, 4)), SessionFrame((5, 9), frame))
    values = ["2400.000", "250.000", "−150.000", "140.0000", "4.0000", "−3.0000"]
    for changes, shots in (
        ({"frame": frame}, ["all"]),
        ({"frame": frame, "sessions": sessions}, ["0 to 2", "5 to 9"]),
    ):
        rows = rows_of(tracker_section(identified(whole, **changes)))
        assert rows[-len(shots) :] == [[own, *values] for own in shots]


def test_a_tracker_that_states_nothing_is_shown_as_that(whole: PaperCampaign) -> None:
    evidence = gather(whole.campaign)
    run = evidence.run.shots
    silent = replace(
        run,
        stated_covariance_mm2=np.full_like(run.stated_covariance_mm2, np.nan),
        temperature_degC=np.full_like(run.temperature_degC, np.nan),
    )
    measured = MeasuredSeries(evidence.run.series, evidence.campaign.robot.mechanism)
    vars(measured)["shots"] = silent
    row = rows_of(tracker_section(Evaluation(replace(evidence, run=measured))))[1]
    assert row[:5] == ["run", "not stated", "–", "–", "–"]


def test_a_foreign_message_is_told_as_it_is_and_shown_as_text(whole: PaperCampaign) -> None:
    message = "plan.csv:1: '<b>&amp;</b>' is no \"number\""
    evidence = replace(gather(whole.campaign), unreadable=(message,))
    shown = page_of(Evaluation(evidence), MADE_UTC)
    assert shown.missing[1:] == (f"Cannot be read: {message}.",)
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
            append_import(journal, rows, NOMINAL.robot.kinematics, ImportedSeries("r", {}, files))
    words = words_of(html(paper))
    assert "Simulated" not in words
    assert f"2 points of May.csv {'5e' * 32}" in words
    assert "1 not recorded by the software that imported them" in words
    assert "plan as measured" not in words


def test_every_finding_stands_with_its_sentence_and_consequence(whole: PaperCampaign) -> None:
    findings = (
        Finding("change", "arm 0 changed", "fail", {"size": 0.0101}),
        Finding("beyond-tolerance", "arm 2 is long", "fail", accepted=True),
        Finding("wrong-shots", "left out: shots 7", None),
    )
    found = identified(whole, findings=findings)
    assert rows_of(parameters_section(found))[:3] == [
        ["change", "arm 0 changed", "verdict: fail"],
        ["beyond-tolerance", "arm 2 is long", "accepted"],
        ["wrong-shots", "left out: shots 7", "reported only"],
    ]
    assert "Accepted all the same: arm 2 is long." in " ".join(found.verdict.reasons)
    assert "has no findings" in words_in(parameters_section(identified(whole, findings=())))


def test_the_hold_out_test_stands_in_words(whole: PaperCampaign) -> None:
    held = HoldOut(8, 12.34, 0.031, 1.24)
    text = words_in(gain_section(identified(whole, hold_out=held)))
    assert "8 hold-out pairs are 1.24 times as far off as their σ predict (χ² 12.3, p = 0." in text
    assert "that agrees with these σ." in text
    bad = replace(held, p=1e-5)
    assert "that contradicts these σ." in words_in(gain_section(identified(whole, hold_out=bad)))
    assert "Hold-out test" not in words_in(gain_section(identified(whole, hold_out=None)))


def test_a_load_without_an_end_stands_above_the_verdict(tmp_path: Path) -> None:
    paper = new_campaign(tmp_path / "loading")
    assert 'class="alarm"' not in html(paper)
    with paper.journal() as journal:
        journal.append(LOAD_BEGUN)
    text = html(paper)
    alarm = text.index("A load of robot-compensated.yaml was begun at")
    assert text.index('class="alarm"') < alarm < text.index('id="verdict"')


def test_a_parameter_says_whether_it_was_fitted_determined_and_changed(
    whole: PaperCampaign,
) -> None:
    one = replace(
        gather(whole.campaign).identification.parameters["plate_mm"], nominal=1.0, std=0.1
    )
    found = {
        "arm0.x_mm": replace(one, value=1.19),
        "arm0.y_mm": replace(one, value=1.21),
        "arm0.z_mm": replace(one, value=1.0, std=None),
        "plate_mm": replace(one, value=1.0, std=None, free=False),
    }
    rows = texts(parameters(PAR4.parameters), found.items())
    assert rows[0] == ("arm0.x", "mm", "1.0000", "1.1900", "+0.1900", "0.1000", "within U")
    assert [row[-1] for row in rows[1:]] == ["", "not determined", "held"]


def test_ap_and_rp_stand_pose_by_pose_and_worst_first(whole: PaperCampaign) -> None:
    ap, rp, *rows = rows_of(motion_tests_section(evaluate(whole.campaign)))
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
