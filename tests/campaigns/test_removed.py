"""Removed keys and values are refused with what to use instead; former defaults still open."""

from campaigns import removed
from campaigns.removed import drop_former_defaults, removed_in_file


def test_former_default_of_a_removed_key_is_dropped_and_any_other_value_has_its_remedy(monkeypatch):
    keys = {"tracker.two_faces": (False, "use the tracker's own routine"), "advice": (None, "none")}
    monkeypatch.setattr(removed, "KEYS", keys)
    assert removed_in_file("tracker.two_faces", value=True) == "use the tracker's own routine"
    assert "pointline" in removed_in_file("tracker.driver", "geocom")
    assert removed_in_file("tracker.driver", "emscon") is None
    contents = {"tracker": {"two_faces": False, "url": "x"}, "advice": None}
    drop_former_defaults(contents)
    assert contents == {"tracker": {"url": "x"}}
    contents = {"tracker": {"two_faces": True}}
    drop_former_defaults(contents)
    assert contents == {"tracker": {"two_faces": True}}
