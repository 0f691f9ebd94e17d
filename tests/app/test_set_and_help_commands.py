"""`pkmcal set` and `pkmcal help`: keys of campaign.yaml, and pages of the documentation."""

import json
from pathlib import Path

import pytest
from paper_campaign import new_campaign

from app.cli.help_pages import find_pages
from campaigns.campaign import now_utc, open_campaign
from campaigns.files.lock import campaign_lock


def test_keys_are_set_and_the_next_command_is_named(pkmcal, tmp_path):
    folder = new_campaign(tmp_path / "c").folder
    code, out, err = pkmcal("set", folder, "plan.shots=60", "tracker.place_mm=[2400, 0, -500]")
    assert (code, out) == (0, "plan.shots: 60\ntracker.place_mm: [2400, 0, -500]\n")
    assert f"next: pkmcal plan {folder}" in err
    config = open_campaign(folder).config
    assert (config.plan.shots, config.tracker.place_mm) == (60, (2400.0, 0.0, -500.0))
    before = (folder / "campaign.yaml").read_bytes()
    # of two changes one is wrong: nothing is written
    code, _, err = pkmcal("set", folder, "plan.shots=40", "plan.shotz=1")
    assert code == 2
    assert "did you mean shots?" in err
    assert pkmcal("set", folder, "plan.shots").code == 2
    with campaign_lock(folder, now_utc=now_utc):
        assert pkmcal("set", folder, "plan.shots=40").code == 2
    assert (folder / "campaign.yaml").read_bytes() == before


def test_a_page_is_shown_whole_or_in_part(pkmcal):
    code, out, _ = pkmcal("help", "--json")
    pages = json.loads(out)["pages"]
    assert code == 0
    assert {"files", "by-hand", "troubleshooting"} <= set(pages)
    code, out, _ = pkmcal("help", "files#plancsv")
    assert out.startswith("## plan.csv\n")
    assert "## shots.csv" not in out
    assert len(pkmcal("help", "files").out) > 10 * len(out)
    code, _, err = pkmcal("help", "file")
    assert (code, "did you mean files" in err) == (2, True)
    assert pkmcal("help", "files#plan").code == 2


def test_an_error_names_a_page_that_help_shows(pkmcal, tmp_path):
    folder = new_campaign(tmp_path / "c").folder
    (folder / "plan.csv").write_text("no plan\n")
    code, _, err = pkmcal("run", folder, "--dry")
    assert code == 2
    page = err.partition("`pkmcal help ")[2].partition("`")[0]
    assert pkmcal("help", page).code == 0


@pytest.mark.parametrize("room", ["campaigns", "drivers", "sim"])
def test_each_page_that_errors_name_is_there(room):
    root = Path(__file__).parents[2] / room
    texts = (path.read_text(encoding="utf-8") for path in root.rglob("*.py"))
    named = {
        word.strip("`\"',.()").partition("#")[0]
        for text in texts
        for word in text.split()
        if word.strip("\"'`(").startswith("docs/") and ".md" in word
    }
    pages = find_pages()
    missing = [name for name in named if Path(name).stem not in pages]
    assert not [name for name in missing if not name.startswith("docs/adr")]
