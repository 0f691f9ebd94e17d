"""campaign.yaml: a new one explains itself, a wrong one is answered with one line."""

import math
import re
from functools import partial
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from refusals import refusal

from campaigns.errors import ConfigInvalid, OutputExists
from campaigns.files.yaml_file import FileModel, checked, commented_yaml, parse_document
from campaigns.robots.robot import find_robot
from campaigns.settings.config import (
    SCHEMA,
    CampaignConfig,
    new_config,
    read_campaign,
    write_new_campaign,
)

PROTOTYPE = find_robot("par4-prototype")
TOLD = {
    "name": "spring",
    "controller": {"url": "tcp://192.168.1.2:5010"},
    "tracker": {"url": "tcp://192.168.1.3:700", "reflector": "RRR 1.5in"},
}
MINIMAL = f"""schema: {SCHEMA}
name: spring
controller:
  url: tcp://192.168.1.2:5010
tracker:
  url: tcp://192.168.1.3:700
  reflector: RRR 1.5in
"""


def read(text):
    return checked(parse_document(text, "campaign.yaml"), SCHEMA, CampaignConfig)


complaint = partial(refusal, ConfigInvalid, read)


def test_a_new_campaign_reads_back_as_it_was_told(tmp_path):
    box = {"name": "conveyor, left", "x_mm": [-400.0, -150.0], "z_mm": [-900.0, -600.0]}
    pillar = {"centre_mm": [180.0, -260.0], "radius_mm": 20.0}
    space = {"z_lowest_mm": -800.0, "keep_out": {"boxes": [box, box], "cylinders": [pillar]}}
    more = {"gate": {"attempts": 5}, "people": {"operator": "A. Smith"}, "space": space}
    config = new_config(TOLD | more)
    write_new_campaign(tmp_path / "spring", config, PROTOTYPE)
    back = read_campaign(tmp_path / "spring")
    assert back == config
    assert [zone.name for zone in back.space.keep_out.boxes] == ["conveyor, left"] * 2
    assert back.space.keep_out.cylinders[0].centre_mm == (180.0, -260.0)
    assert (tmp_path / "spring" / "robot.yaml").read_bytes() == PROTOTYPE.document.text.encode()


def test_only_names_and_addresses_must_be_given_and_defaults_are_the_papers():
    config = read(MINIMAL)
    assert config == new_config(TOLD)
    assert (config.plan.shots, config.plan.validation_pairs) == (120, 20)
    assert config.validation.repeatability_approaches == 28
    assert config.validation.line_lengths_mm == (800.0, 800.0, 500.0)
    assert config.space.keep_out.boxes == ()


def test_every_key_is_described_and_stands_below_its_explanation():
    assert all(field.description for field in sections_of(CampaignConfig))
    lines = commented_yaml(SCHEMA, new_config(TOLD)).splitlines()
    keys = [number for number, line in enumerate(lines) if re.match(r" *\w+:", line)][1:]
    assert len(keys) > 40
    for number in keys:
        assert lines[number - 1].lstrip().startswith("# "), lines[number]


def sections_of(model):
    for field in model.model_fields.values():
        yield field
        if isinstance(field.annotation, type) and issubclass(field.annotation, FileModel):
            yield from sections_of(field.annotation)


def test_angles_are_given_in_deg_and_used_in_rad():
    config = read(MINIMAL + "  acceptance_deg: 20\nsettle: {still_deg: 0.001, in_place_deg: 0.1}\n")
    assert config.tracker.acceptance_rad == math.radians(20.0)
    assert config.settle.still_rad == math.radians(0.001)
    assert config.settle.in_place_rad == math.radians(0.1)


def test_folder_without_settings_names_the_campaigns_nearby(tmp_path, monkeypatch):
    def refused(folder):
        with pytest.raises(ConfigInvalid, match=r"holds no campaign\.yaml") as caught:
            read_campaign(Path(folder))
        return caught.value.remedy

    (tmp_path / "hall").mkdir()
    monkeypatch.chdir(tmp_path / "hall")
    assert "`pkmcal new DIR`" in refused(".")
    for name in ("cell-7", "press"):
        write_new_campaign(Path(name), new_config(TOLD), PROTOTYPE)
    assert refused(".") == "name a campaign; here are cell-7, press"
    assert refused("cell7") == "did you mean cell-7?"
    assert refused("zzz") == "name a campaign; beside it are cell-7, press"
    assert "is a campaign: name that folder" in refused("cell-7/x")
    monkeypatch.chdir("cell-7")
    assert "new" not in refused("x")


def test_no_campaign_and_no_robot_file_of_others_is_overwritten(tmp_path):
    (tmp_path / "robot.yaml").write_text("mine\n")
    with pytest.raises(OutputExists, match=r"robot\.yaml already exists"):
        write_new_campaign(tmp_path, new_config(TOLD), PROTOTYPE)
    assert (tmp_path / "robot.yaml").read_text() == "mine\n"
    # a command that broke off after its robot file can be given again
    (tmp_path / "robot.yaml").write_text(PROTOTYPE.document.text)
    write_new_campaign(tmp_path, new_config(TOLD), PROTOTYPE)
    with pytest.raises(OutputExists, match=r"campaign\.yaml already exists"):
        write_new_campaign(tmp_path, new_config(TOLD | {"name": "other"}), PROTOTYPE)
    assert read_campaign(tmp_path).name == "spring"


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("name: spring", "name: ''", 'campaign.yaml:2: name is "", must not be empty'),
        ("  reflector: RRR 1.5in\n", "", "campaign.yaml:5: tracker.reflector is missing"),
        ("tcp://192.168.1.2:5010", "192.168.1.2", "campaign.yaml:4: controller.url is"),
        ("tcp://192.168.1.2:5010", "tcp://me@robot:5010", "give its address: tcp://HOST:PORT"),
        ("tcp://192.168.1.3:700", "http://tracker", "give its address: tcp://HOST:PORT"),
    ],
)
def test_wrong_value_is_answered_with_its_line_and_what_to_give(old, new, words):
    assert old in MINIMAL
    assert words in complaint(MINIMAL.replace(old, new, 1))


@pytest.mark.parametrize(
    ("more", "words"),
    [
        ("  place_m: [2.5, 0, 0]", "write place_mm, with the value in mm"),
        ("  reflector_facing: [0, 0, 0]", "tracker.reflector_facing is [0, 0, 0], which is no"),
        ("  driver: faro", "tracker.driver is \"faro\", must be 'emscon'"),
        ("plan: {shots: 121}", "plan.shots is 121, must be a multiple of 2"),
        ("settle: {timeout_s: 0.1}", "settle.timeout_s is 0.1, must be above time_s, which is 0.2"),
        ("space: {z_lowest_mm: -500, z_highest_mm: -600}", "z_lowest_mm -500"),
        ("space: {keep_out: {boxes: [{name: x}]}}", "space.keep_out.boxes[0]"),
        (
            "space: {keep_out: {boxes: [{x_mm: [0, 1]}, {x_mm: [1, 0]}]}}",
            "space.keep_out.boxes[1].x_mm is [1.0, 0.0], the lowest must be below the highest",
        ),
        ("objects: [{name: a}, {name: a}]", "objects has two objects of one name"),
        ("objects: [{name: a, on: b}]", "objects has a on b, must be another of ['a']"),
        ("objects: [{name: a, body: half 3}]", "must be 'tool', 'half 1' or 'half 2'"),
        ("gate:\n", "gate is empty, must hold keys with values"),
        ("robot: ../robot.yaml", "give the name of the file in this folder"),
        ("controler: {}", "campaign.yaml:8: controler is not a known key → did you mean contr"),
    ],
)
def test_wrong_addition_is_answered_with_its_key_and_limit(more, words):
    assert words in complaint(f"{MINIMAL}{more}\n")


words = st.text(min_size=1).filter(lambda text: not re.search(r"[\ud800-\udfff]", text))


@pytest.mark.slow
@given(name=words, notes=words, reflector=words)
def test_any_text_comes_back_from_a_new_file(name, notes, reflector):
    tracker = TOLD["tracker"] | {"reflector": reflector}
    config = new_config(TOLD | {"name": name, "tracker": tracker, "people": {"notes": notes}})
    assert read(commented_yaml(SCHEMA, config)) == config
