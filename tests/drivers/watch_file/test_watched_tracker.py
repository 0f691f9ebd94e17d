"""A tracker whose software writes into a file: which row is the point, and which is none."""

from functools import partial

import pytest
from timed_pipe import HandClock

from campaigns.errors import ShotsInvalid
from campaigns.shots.point_files import data_rows, point_of_row
from campaigns.shots.point_layout import PointFormat
from drivers.declaration import Surroundings
from drivers.errors import Cancelled, ImplausibleAnswer, LinkDown, NotAMeasurement
from drivers.stopping import unheard
from drivers.watch_file import WatchedTracker, WatchSettings, recorded_measurement

POINT = (2000.5, 10.25, -300.125)
ROW = "Main p2 2000.5 10.25 -300.125"


class Software(HandClock):
    """The tracker's software, which does the next thing each time the file is looked at."""

    def __init__(self, path, *doings):
        super().__init__()
        self.path, self.doings = path, [*doings]

    def sleep_s(self, seconds):
        super().sleep_s(seconds)
        if self.doings:
            self.doings.pop(0)(self.path)


def appends(text):
    def write(path):
        with path.open("a", newline="") as file:
            file.write(text)

    return write


def replaces(text):
    return lambda path: path.write_text(text)


def nothing(_path):
    pass


def watched(
    tmp_path, before, *doings, cancelled=lambda: False, encoding=None, announce=unheard, **form
):
    form = PointFormat(**{"unit": "mm", "option": "tracker.watch.", **form})
    path = tmp_path / "points.txt"
    if before is not None:
        path.write_text(before)
    settings = WatchSettings(
        serial="4711",
        path=path,
        wait_s=30.0,
        rows_of=data_rows,
        encoding=encoding,
        point_of=lambda row, text: point_of_row(row, text, path.name, form),
    )
    clock = Software(path, *doings)
    tracker = WatchedTracker(
        Surroundings(
            open_transport=None,
            clock=clock,
            cancelled=cancelled,
            settings=settings,
            announce=announce,
        )
    )
    tracker.connect()
    return clock, tracker


@pytest.mark.parametrize(
    ("before", "doings"),
    [
        ("", [appends(ROW + "\n")]),
        (None, [replaces(f"// made later\n\n{ROW}\n")]),
        ("Main p1 1.0 2.0 3.0\n", [nothing, appends(ROW + "\r\n")]),
        ("Main p1 1.0 2.0 3.0", [appends("\n" + ROW + "\n")]),
        ("Main p1 1.0 2.0", [appends(" 3.0\n"), appends(ROW + "\n")]),
        ("", [appends("Main p2 2000.5 10."), *[nothing] * 50, appends("25 -300.125\n")]),
        (
            "a 1 2 3\n",
            [replaces(""), replaces("a 1 2 3\nMain p2 20"), replaces(f"a 1 2 3\n{ROW}\n")],
        ),
        ("a 1 2 3\nb 4 5 6\n", [lambda path: path.unlink(), replaces(f"{ROW}\na 1 2 3\n")]),
        ("a 1 2 3\n", [appends("# a comment\n"), appends(ROW + "\n")]),
    ],
    ids=[
        *("appended", "made later", "after others", "one without its end", "one under way"),
        *("in pieces", "written anew", "replaced", "comment"),
    ],
)
def test_row_that_comes_after_the_question_is_the_point(tmp_path, before, doings):
    _, tracker = watched(tmp_path, before, *doings)
    measured = tracker.measure()
    assert measured.point_in_tracker_mm == POINT
    assert (measured.covariance_mm2, measured.weather) == (None, None)
    assert measured.raw.endswith(f" = {ROW}")
    assert recorded_measurement(measured.raw) == (POINT, None)


@pytest.mark.parametrize(
    ("before", "doings", "said"),
    [
        (f"{ROW}\n", [], "no new row for 30 s →"),
        ("", [appends(ROW)], "no new row for 30 s; its last line has no line end"),
        (f"a 1 2 3\n{ROW}\n", [appends(ROW + "\n")], "the row is that before"),
        (f"a 1 2 3\n{ROW}\n", [replaces(f"a 1.001 2.001 3.001\n{ROW}\n")], "no new row"),
        ("", [appends(f"{ROW}\nMain p3 1.0 2.0 3.0\n")], "2 new rows at once"),
    ],
    ids=["silence", "no line end", "row of before", "more digits", "two at once"],
)
def test_no_row_an_old_one_or_two_are_no_measurement(tmp_path, before, doings, said):
    clock, tracker = watched(tmp_path, before, *doings)
    with pytest.raises(NotAMeasurement, match=said):
        tracker.measure()
    assert clock.now_s() <= 30.2


def test_row_that_is_measured_twice_is_no_measurement(tmp_path):
    _, tracker = watched(tmp_path, "", appends(ROW + "\n"), appends(ROW + "\n"))
    assert tracker.measure()
    with pytest.raises(NotAMeasurement, match="the row is that before"):
        tracker.measure()


@pytest.mark.parametrize(("codec", "encoding"), [("utf-16", None), ("cp1252", "cp1252")])
def test_other_encodings_are_read(tmp_path, codec, encoding):
    text = "name;x [µm];y [µm];z [µm]\n"
    doing = lambda path: path.write_bytes(f"{text}p;2000500;10250;-300125\n".encode(codec))  # noqa: E731
    _, tracker = watched(tmp_path, None, doing, encoding=encoding)
    assert tracker.measure().point_in_tracker_mm == pytest.approx(POINT, abs=1e-9)


def test_unit_and_columns_are_those_of_the_settings(tmp_path):
    told = {"unit": "m", "columns": ["-", "x", "y", "z"]}
    _, tracker = watched(tmp_path, "", appends("7.5,2.0005,0.01025,-0.300125,9\n"), **told)
    assert tracker.measure().point_in_tracker_mm == pytest.approx(POINT, abs=1e-9)


@pytest.mark.parametrize(
    ("row", "error", "said"),
    [
        ("Main p2 2,500 10,250 -300,125", ShotsInvalid, "give tracker.watch.decimal comma"),
        ("Main p2 2e6 0.0 0.0", ImplausibleAnswer, "possible is 0 to 200000 mm"),
    ],
)
def test_row_that_is_no_point_is_refused(tmp_path, row, error, said):
    with pytest.raises(error, match=said):
        watched(tmp_path, "", appends(row + "\n"))[1].measure()


def test_wish_to_stop_ends_the_wait(tmp_path):
    wishes = []
    _, tracker = watched(
        tmp_path, "", nothing, lambda _: wishes.append(1), cancelled=partial(bool, wishes)
    )
    with pytest.raises(Cancelled):
        tracker.measure()


def test_file_that_cannot_be_is_refused_by_name(tmp_path):
    (tmp_path / "points.txt").mkdir()
    with pytest.raises(LinkDown, match=r"points.txt: is no file but a folder"):
        watched(tmp_path, None)[1].prepare("CCR", 1.0)
    with pytest.raises(LinkDown, match="there is no folder"):
        watched(tmp_path / "elsewhere", None)


def test_it_says_when_to_measure_into_which_file_and_that_it_is_not_there(tmp_path):
    said = []
    _, tracker = watched(tmp_path, None, replaces(f"{ROW}\n"), announce=said.append)
    tracker.prepare("C", 1.0)
    tracker.measure()
    path = tmp_path / "points.txt"
    assert said == [
        f"there is no file {path} yet; it may come later",
        f"measure now: waiting for a row in {path} (0.5 min)",
    ]
