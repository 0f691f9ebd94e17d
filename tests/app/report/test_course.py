"""The course of a campaign: what the page and the terminal show of events, stand and periods."""

from dataclasses import replace

import numpy as np
import pytest
from test_page import identified, rows_of, words_in

from app.report.course import Course
from app.report.record import incidents_section
from app.report.results import course_section
from app.report.tables import size_of
from app.report.terminal_text import show_identification
from campaigns.assessment import Evaluation
from campaigns.fit.events import Event
from campaigns.identification.findings import Finding
from campaigns.identification.result import Excluded, SessionFrame
from campaigns.kinematics.catalog import find_mechanism
from campaigns.shots.shot_sets import ShotSet

WRONG = Event("wrong shot", 7, 7, size=1.5, std=0.02)
UNASSEMBLED = Event("no assembly", 12, 12)
STEP = Event("change", 40, 96, ("encoder 2", "mount 2"), -8.7e-4, 1e-5, is_lasting=True)
CARRIAGES = find_mechanism("linear-delta")
BUMP = Event("change", 20, 27, ("frame",), 0.3, 0.01)


def course_of(evaluation: Evaluation, **changes: object) -> Course:
    course = Course.of(identified(evaluation, **changes).evidence)
    assert course is not None
    return course


def titles(course: Course) -> list[str]:
    return [panel.texts[0].get_text() for panel in course.panels()]


def diagnosed(evaluation: Evaluation, **changes: object) -> object:
    """The diagnosis of a campaign, changed."""
    return replace(evaluation.evidence.identification.judgement.diagnosis, **changes)


def test_a_clean_campaign_has_one_panel_and_two_sentences(evaluation: Evaluation) -> None:
    course = course_of(evaluation)
    assert titles(course) == ["errors of each shot"]
    words = words_in(course_section(evaluation))
    assert "No shot contradicts the others, and no part changed." in words
    assert "Slow motion of the tracker's stand is no more than noise: 0.00" in words
    assert rows_of(course_section(evaluation)) == []


def test_events_stand_in_a_table_with_size_and_remedy(evaluation: Evaluation) -> None:
    events = (WRONG, UNASSEMBLED, BUMP, STEP)
    shown = identified(evaluation, events=events)
    assert rows_of(course_section(shown)) == [
        ["wrong shot", "7", "–", "1.5 ± 0.04 mm", "measure again"],
        ["no assembly", "12", "–", "–", "measure again"],
        [
            *("change", "20 to 27", "the tracker's stand or the robot's base"),
            *("+0.3 ± 0.02 mm", "measure these shots again"),
        ],
        [
            *("change", "from 40 on", "arm 2's encoder or arm 2's mount", "−0.0498 ± 0.0011°"),
            "mend it, and identify from the shots after it alone, `--only-shots 40-`",
        ],
    ]
    assert size_of(STEP, CARRIAGES.joints).endswith(" mm")


def test_events_are_marked_at_their_shots_in_the_order_of_time(evaluation: Evaluation) -> None:
    course = course_of(evaluation, events=(WRONG, UNASSEMBLED, BUMP, STEP))
    axes = course.panels()[0].axes[0]
    marks = {line.get_label(): line for line in axes.lines}
    place_of = {number: place for place, number in enumerate(course.numbers)}
    assert list(marks["wrong"].get_xdata()) == [place_of[7]]
    assert list(marks["wrong"].get_ydata()) == [1.5]
    assert list(marks["no assembly"].get_xdata()) == [place_of[12]]
    assert [text.get_text() for text in axes.texts] == [
        "the tracker's stand or the robot's base +0.3 ± 0.02 mm",
        "arm 2's encoder (or 1 more) −0.0498 ± 0.0011°",
    ]
    spans = [(patch.get_x(), patch.get_x() + patch.get_width()) for patch in axes.patches]
    assert spans == [
        (place_of[20] - 0.5, place_of[27] + 0.5),
        (place_of[40] - 0.5, place_of[96] + 0.5),
    ]
    pairs = marks["hold-out pairs"]
    unseen = evaluation.evidence.identification.residuals.unseen
    drawn_mm = np.maximum(np.abs(unseen.after[:, 0]), 1e-3)  # the axis is logarithmic
    assert list(pairs.get_ydata()) == pytest.approx(drawn_mm)
    assert min(pairs.get_xdata()) > place_of[79], "hold-out pairs were measured last"


def test_shots_measured_in_another_order_stand_in_that_of_time(evaluation: Evaluation) -> None:
    evidence = evaluation.evidence
    backwards = replace(evidence.run.stops, records=tuple(range(len(evidence.run.stops)))[::-1])
    run = replace(evidence.run)
    vars(run)["stops"] = backwards
    course = Course.of(replace(evidence, run=run))
    kept = (ShotSet.IDENTIFICATION, ShotSet.VALIDATION)
    assert list(course.numbers) == [*backwards.of_set(*kept).numbers][::-1]
    ticks = course.panels()[0].axes[0].get_xticklabels()
    assert [ticks[0].get_text(), ticks[-1].get_text()] == ["96", "1"]


def test_shots_of_a_check_that_updated_a_result_stand_alone(evaluation: Evaluation) -> None:
    pedigree = object()
    course = course_of(evaluation, pedigree=pedigree)
    assert course.numbers == course.diagnosis.numbers


def test_the_stand_is_drawn_where_it_moved_more_than_noise(evaluation: Evaluation) -> None:
    count = len(evaluation.evidence.identification.judgement.diagnosis.numbers)
    moved_mm = np.outer(np.linspace(-0.1, 0.1, count), [1.0, 0.0, -0.5])
    diagnosis = diagnosed(evaluation, stand_mm=tuple(map(tuple, (moved_mm + 3.0).tolist())))
    moved = Finding("stand", "the stand moved", None, {"mm": 0.2})
    course = course_of(evaluation, diagnosis=diagnosis, findings=(moved,))
    assert titles(course) == ["errors of each shot", "slow motion of the stand"]
    lines = {line.get_label(): line for line in course.panels()[1].axes[0].lines}
    assert lines["x"].get_ydata() == pytest.approx(1000.0 * moved_mm[:, 0])
    assert lines["z"].get_ydata() == pytest.approx(1000.0 * moved_mm[:, 2])
    assert "no more than noise" not in words_in(course_section(identified(
        evaluation, diagnosis=diagnosis, findings=(moved,)
    )))  # fmt: skip
    # each session has a stand of its own
    numbers = course.diagnosis.numbers
    sessions = tuple(
        SessionFrame(shots, evaluation.evidence.identification.value.frame)
        for shots in (numbers[:30], numbers[30:])
    )
    course = course_of(evaluation, diagnosis=diagnosis, findings=(moved,), sessions=sessions)
    lines = [line for line in course.panels()[1].axes[0].lines if line.get_label() == "x"]
    assert [len(line.get_xdata()) for line in lines] == [30, count - 30]


def test_periods_are_drawn_from_100_to_1_over_turns_or_mm(evaluation: Evaluation) -> None:
    rates = (6.0, 30.0, 60.0)
    quiet = diagnosed(evaluation, rates=rates, rate_log_factors=(-1.0, 4.5, 0.0))
    assert titles(course_of(evaluation, diagnosis=quiet)) == ["errors of each shot"]
    loud = replace(quiet, rate_log_factors=(-1.0, 80.0, 0.0))
    period = Finding("period", "the drives ripple", None, {"rate": 30.0})
    course = course_of(evaluation, diagnosis=loud, findings=(period,))
    axes = course.panels()[1].axes[0]
    assert list(axes.lines[0].get_xdata()) == list(rates)
    assert [line.get_ydata()[0] for line in axes.lines[1:]] == [0.0, pytest.approx(np.log(100.0))]
    assert [text.get_text() for text in axes.texts] == ["30"]
    carriages = replace(course, mechanism=CARRIAGES).panels()[1].axes[0]
    assert carriages.get_xlabel() == "period, mm"
    assert list(carriages.lines[0].get_xdata()) == pytest.approx(2.0 * np.pi / np.array(rates))


def test_unexplained_errors_are_arrows_in_the_base_frame(evaluation: Evaluation) -> None:
    identification = evaluation.evidence.identification
    count = len(identification.judgement.diagnosis.numbers)
    rotation = identification.value.frame.tracker_from_base.rotation
    in_tracker = np.tile(rotation @ [0.2, 0.0, 0.0], (count, 1))
    diagnosis = diagnosed(evaluation, unexplained_mm=tuple(map(tuple, in_tracker.tolist())))
    course = course_of(evaluation, diagnosis=diagnosis)
    assert course.unexplained_mm == pytest.approx(np.tile([0.2, 0.0, 0.0], (count, 1)))
    assert titles(course)[1:] == [
        "unexplained, from above: 440 × error",
        "unexplained, from the side: 440 × error",
    ]


def test_places_of_left_out_shots_are_those_of_wrong_ones(evaluation: Evaluation) -> None:
    course = course_of(evaluation, events=(UNASSEMBLED, WRONG))
    row = course.diagnosis.numbers.index(7)
    assert course.left_out_mm == pytest.approx(np.array([course.diagnosis.places_mm[row]]))
    assert len(course_of(evaluation).left_out_mm) == 0


def test_the_record_lists_only_what_the_course_does_not(evaluation: Evaluation) -> None:
    lost = Excluded("its other shot was lost", pair=3)
    wrong = Excluded("1.500 mm off where all others put it", shot=7, size_mm=1.5)
    section = incidents_section(identified(evaluation, events=(WRONG,), excluded=(wrong, lost)))
    assert rows_of(section)[0] == ["pair 3", "its other shot was lost"]
    assert "left out, 1: see Course of the campaign." in words_in(section)
    section = incidents_section(identified(evaluation, events=(WRONG,), excluded=(wrong,)))
    assert "left out no shot" not in words_in(section)


class Screen:
    """A terminal that keeps its lines."""

    is_verbose = False
    is_small = False

    def __init__(self) -> None:
        self.lines: list[str] = []

    def say(self, text: str, style: str = "") -> None:
        self.lines.append(text)

    def rows(self, *_: object) -> None:
        """Tables are not looked at."""


def test_a_small_screen_shows_the_verdict_first_and_fewer_shares(evaluation: Evaluation) -> None:
    table = evaluation.evidence.campaign.robot.mechanism.parameters
    whole, small = Screen(), Screen()
    small.is_small = True
    for screen in (whole, small):
        show_identification(screen, evaluation.evidence.identification, table)
    assert small.lines[0] == whole.lines[0] == "verdict: pass"
    assert len(small.lines) < len(whole.lines) < 14
    assert small.lines[-1].endswith("--verbose")


def test_each_wrong_shot_has_one_line_on_the_terminal(evaluation: Evaluation) -> None:
    excluded = (
        Excluded("1.500 mm off where all others put it", shot=7, size_mm=1.5),
        Excluded("the robot cannot be assembled at its joints", shot=12),
    )
    counted = Finding("wrong-shots", "left out: shot 7 contradicts all others", None, {"count": 2})
    shown = identified(
        evaluation, events=(WRONG, UNASSEMBLED), excluded=excluded, findings=(counted,)
    )
    table = evaluation.evidence.campaign.robot.mechanism.parameters
    screen = Screen()
    show_identification(screen, shown.evidence.identification, table)
    assert [line for line in screen.lines if "left out" in line] == [
        "left out: shot 7: 1.5 ± 0.04 mm off where all others put it: measure again",
        "left out: shot 12: the robot cannot be assembled at its joints: measure again",
    ]
    # what they have in common is said beside them
    series = replace(counted, numbers={"count": 2, "pattern": "series"})
    shown = identified(shown, findings=(series,))
    screen = Screen()
    show_identification(screen, shown.evidence.identification, table)
    assert counted.says in screen.lines
