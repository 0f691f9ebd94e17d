"""Single keys of campaign.yaml are changed; every other line stays."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from campaigns.errors import ConfigInvalid
from campaigns.files.yaml_edit import with_key
from campaigns.files.yaml_file import commented_yaml, parse_document
from campaigns.settings.config import (
    SCHEMA,
    CampaignConfig,
    changed_settings,
    new_config,
    new_settings_text,
)

STATED = {
    "name": "c",
    "controller": {"url": "tcp://127.0.0.1:9"},
    "tracker": {"url": "tcp://127.0.0.1:700", "reflector": "CCR"},
}
BY_HAND = """# mine
schema: pkmcal/campaign/1
name: c   # the blue cell
controller:
    url: tcp://127.0.0.1:9

    # asked for by Ann
    serial: '07'
tracker: {url: "tcp://127.0.0.1:700", reflector: CCR}
nests:
- {name: A, place_mm: [1, 2, 3]}
- {name: B, place_mm: [4, 5, 6]}
# the end
"""


def changed(text, key, value):
    return with_key(parse_document(text, "c.yaml"), CampaignConfig, key.split("."), value)


@pytest.mark.parametrize(
    ("key", "value", "line"),
    [
        ("name", "d", "name: d  # the blue cell"),
        ("controller.serial", "08", "    serial: 08"),
        ("controller.speed_percent", 20.0, "    speed_percent: 20.0"),
        ("nests", [], "nests: []"),
        ("plan.shots", 60, "  shots: 60"),
    ],
)
def test_a_key_changes_and_comments_stay(key, value, line):
    document = changed(BY_HAND, key, value)
    lines = document.text.splitlines()
    written = [each.replace("'", "") for each in lines]
    assert line in written
    for comment in ("# mine", "# the blue cell", "    # asked for by Ann", "# the end"):
        assert any(each.endswith(comment) for each in lines), comment
    tree = document.tree
    for step in key.split("."):
        tree = tree[step]
    assert tree == value


def test_a_key_of_a_section_on_one_line_joins_it():
    tree = changed(BY_HAND, "tracker.uncertainty.along_um", 5.0).tree["tracker"]
    assert tree == {
        "url": "tcp://127.0.0.1:700",
        "reflector": "CCR",
        "uncertainty": {"along_um": 5.0},
    }


def leaves(settings, above=""):
    for name, value in settings.items():
        if isinstance(value, dict) and value:
            yield from leaves(value, f"{above}{name}.")
        else:
            yield f"{above}{name}", value


LEAVES = dict(leaves(new_config(STATED).model_dump(mode="json")))


@given(key=st.sampled_from(sorted(LEAVES)), is_short=st.booleans())
def test_any_key_of_a_new_file_is_set_and_no_other_line_changes(key, is_short):
    config = new_config(STATED)
    text = new_settings_text(config) if is_short else commented_yaml(SCHEMA, config)
    document = changed(text, key, [7.0])
    tree = dict(leaves(document.tree))
    assert tree.pop(key) == [7.0]
    before = dict(leaves(parse_document(text, "").tree))
    before.pop(key, None)
    assert {name: tree[name] for name in before} == before
    kept = [line for line in text.splitlines() if line in document.text.splitlines()]
    assert len(kept) >= len(text.splitlines()) - 1


def test_wrong_keys_and_values_are_refused_by_their_place(tmp_path):
    (tmp_path / "campaign.yaml").write_text(BY_HAND, encoding="utf-8")
    with pytest.raises(ConfigInvalid, match=r"plan\.shotz is not a known key → did you mean shots"):
        changed_settings(tmp_path, {"plan.shotz": "60"})
    with pytest.raises(ConfigInvalid, match=r'plan\.shots is "many", must be a whole number'):
        changed_settings(tmp_path, {"plan.shots": "many"})
    settings = changed_settings(tmp_path, {"plan.shots": "60", "people.notes": "a"})
    assert settings.values == {"plan.shots": 60, "people.notes": "a"}
