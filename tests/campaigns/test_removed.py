"""Removed names are refused with what to use instead; former defaults in old files still open."""

import pytest

from campaigns import removed
from campaigns.removed import drop_former_defaults, removed_in_command, removed_in_file


@pytest.fixture(autouse=True)
def _table(monkeypatch):
    instead = {
        "juggle": "read the report",
        "plan --spin": "move place_mm and plan again",
        "--bend": "leave it out",
        "--model rods": "use --model full",
        "driver: geocom": "use pointline",
    }
    monkeypatch.setattr(removed, "INSTEAD", instead)
    keys = {"tracker.two_faces": (False, "use the tracker's own routine"), "advice": (None, "none")}
    monkeypatch.setattr(removed, "KEYS", keys)


@pytest.mark.parametrize(
    ("typed", "name"),
    [
        ("juggle c", "juggle"),
        ("plan c --spin", "plan --spin"),
        ("identify c --bend=huber", "--bend"),
        ("identify --model rods c", "--model rods"),
        ("identify --model=rods c", "--model rods"),
    ],
)
def test_removed_name_is_found_in_what_was_typed(typed, name):
    assert removed_in_command(typed.split()) == (name, removed.INSTEAD[name])


@pytest.mark.parametrize("typed", ["", "run c", "report --spin", "plan juggle --model full"])
def test_other_words_are_not_taken_for_removed_ones(typed):
    assert removed_in_command(typed.split()) is None


def test_command_line_refuses_a_removed_name_with_its_remedy(pkmcal):
    code, out, err = pkmcal("juggle", "c")
    assert (code, out, err) == (2, "", "pkmcal: 'juggle' was removed → read the report\n")


def test_former_default_of_a_removed_key_is_dropped_and_any_other_value_has_its_remedy():
    assert removed_in_file("tracker.two_faces", value=True) == "use the tracker's own routine"
    assert removed_in_file("tracker.driver", "geocom") == "use pointline"
    assert removed_in_file("tracker.driver", "emscon") is None
    contents = {"tracker": {"two_faces": False, "url": "x"}, "advice": None}
    drop_former_defaults(contents)
    assert contents == {"tracker": {"url": "x"}}
    contents = {"tracker": {"two_faces": True}}
    drop_former_defaults(contents)
    assert contents == {"tracker": {"two_faces": True}}
