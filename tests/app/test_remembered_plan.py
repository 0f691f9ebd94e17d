"""A plan that was checked is not checked again, and one of which anything changed is."""

from dataclasses import replace

import pytest
from paper_campaign import new_campaign
from small_plans import TWO_PAIRS

from app import remembered
from campaigns.campaign import open_campaign
from campaigns.errors import PlanInvalid
from campaigns.files import memory
from campaigns.mechanisms.par4 import PAR4
from campaigns.planning import plan_check
from campaigns.planning.plan_file import write_plan


@pytest.fixture
def checks(monkeypatch, tmp_path):
    """Plans that were checked, while what was checked is remembered."""
    found, check_plan = [], plan_check.check_plan

    def counted(shots, *limits):
        found.append(shots)
        return check_plan(shots, *limits)

    monkeypatch.setattr(plan_check, "check_plan", counted)
    monkeypatch.setenv("PKMCAL_CACHE", str(tmp_path / "cache"))
    return found


@pytest.fixture
def folder(tmp_path):
    campaign = new_campaign(tmp_path / "c").campaign
    write_plan(campaign.plan_path, TWO_PAIRS, PAR4)
    return campaign.folder


def checked(folder):
    return remembered.checked_plan(open_campaign(folder), lambda _: None)


def changed(file, old, new):
    text = file.read_text(encoding="utf-8")
    assert old in text
    file.write_text(text.replace(old, new, 1), encoding="utf-8")


def test_the_same_plan_is_checked_once_whatever_else_is_written_beside_it(folder, checks):
    first = checked(folder)
    (folder / "notes.txt").write_text("measured", encoding="utf-8")
    assert checked(folder) == first
    assert first.shots == open_campaign(folder).read_plan()
    assert len(checks) == 1


def test_a_changed_row_is_checked_again_and_refused(folder, checks):
    checked(folder)
    turned = replace(TWO_PAIRS[1], joints=(TWO_PAIRS[1].joints[0] + 0.01, *TWO_PAIRS[1].joints[1:]))
    write_plan(folder / "plan.csv", (TWO_PAIRS[0], turned, *TWO_PAIRS[2:]), PAR4)
    for _ in range(2):  # and what was refused is not remembered as good
        with pytest.raises(PlanInvalid, match="shot 1: q0_deg is"):
            checked(folder)


@pytest.mark.parametrize(
    ("file", "old", "new", "says"),
    [
        ("robot.yaml", "joint_deg: [-45.0, 90.0]", "joint_deg: [-45.0, 10.0]", "joint 0 at"),
        ("campaign.yaml", "z_lowest_mm:", "z_lowest_mm: -600", "z_lowest_mm"),
        ("campaign.yaml", "reflector_facing:", "reflector_facing: [0, -1, 0]", "reflector turned"),
    ],
)
def test_the_same_plan_is_refused_by_limits_that_changed(folder, checks, file, old, new, says):
    checked(folder)
    changed(folder / file, old, new)
    with pytest.raises(PlanInvalid, match=says):
        checked(folder)


def test_changed_software_and_spoilt_memories_check_again(folder, checks, monkeypatch, tmp_path):
    first = checked(folder)
    monkeypatch.setattr(memory, "software", lambda: "another")
    assert checked(folder) == first
    assert len(checks) == 2
    (kept,) = (tmp_path / "cache" / "pkmcal").iterdir()
    for text in ("{", kept.read_text(encoding="utf-8").replace('"detours": 0', '"detours": []')):
        kept.write_text(text, encoding="utf-8")
        assert checked(folder) == first
    assert len(checks) == 4
