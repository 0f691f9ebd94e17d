"""What the pages show is what the program takes: files, commands, keys, links."""

import math
import re
import runpy
import shlex
from pathlib import Path

import pytest
from pages import PAGES, ROOT, Block, blocks, name_of
from ruamel.yaml import YAML
from typer import Context
from typer.main import get_command

from app.main import app, run_command
from campaigns.controllers.corrected_targets import TargetCorrection, correct_poses
from campaigns.fit.error_sources import SOURCES, TRACKER_SOURCES
from campaigns.kinematics.catalog import FAMILY
from campaigns.planning.plan_file import parse_plan
from campaigns.planning.plans import joints_of, poses_of
from campaigns.robots.program import Program, trust
from campaigns.robots.robot import RobotFile, find_robot, read_robot
from campaigns.settings.config import new_config, read_campaign
from campaigns.shots.observations_csv import parse_observations
from campaigns.shots.shots_csv import parse_shots
from sim.scenarios.scenario import parse_scenario

YAML_BLOCKS, CSV_BLOCKS, SHELL_BLOCKS = blocks("yaml"), blocks("csv"), blocks("sh")
PART_OF_A_CELL = "# part of a cell.yaml\n"
SCHEMA = re.compile(r"^schema: (\S+)$", re.MULTILINE)
MODULE = re.compile(r"# (\w+\.py)$", re.MULTILINE)
NAMED = re.compile(r"(docs/[\w/-]+\.md)(?:#([\w-]+))?")
ROOMS = ("app", "campaigns", "drivers", "sim")
LINK = re.compile(r"\[[^\]]*\]\(([^)\s]+)\)")
NEEDED = {
    "name": "example",
    "controller": {"url": "sim://cell"},
    "tracker": {"url": "sim://cell", "reflector": "CCR-1.5in"},
}
A_CELL = """schema: pkmcal/cell/1
name: example
robot: {nominal: par4-prototype}
tracker:
  station: {x_mm: 2500.0, y_mm: 0.0, z_mm: -500.0}
  noise: {coordinate_mm: 0.01}
  other_reflector_mm: [900.0, 350.0, -420.0]
"""


@pytest.mark.parametrize("block", YAML_BLOCKS, ids=str)
def test_yaml_example_is_taken_by_our_readers(block, tmp_path):
    schema = SCHEMA.search(block.text)
    if block.text.startswith(PART_OF_A_CELL):
        parse_scenario(A_CELL + block.text, block.where)
        return
    if schema is None:  # a part of a campaign's settings
        new_config(NEEDED | YAML(typ="safe", pure=True).load(block.text))
        return
    kind = schema[1].split("/")[1]
    write_modules_of_page(block, tmp_path)
    (tmp_path / f"{kind}.yaml").write_text(block.text, encoding="utf-8")
    if kind == "robot":
        read_robot(tmp_path / "robot.yaml")
    elif kind == "campaign":
        read_campaign(tmp_path)
    elif kind == "cell":
        parse_scenario(block.text, block.where)
    else:
        pytest.fail(f"{block.where}: no reader for {schema[1]}")


def write_modules_of_page(block: Block, folder: Path) -> None:
    """Write the files of Python on the block's page: those that begin with their name."""
    page = block.where.partition(":")[0]
    for other in blocks("python"):
        if other.where.startswith(page) and (name := MODULE.match(other.text)):
            (folder / name[1]).write_text(other.text, encoding="utf-8")
            trust(Program.read(folder / name[1]))


@pytest.mark.parametrize("block", CSV_BLOCKS, ids=str)
def test_csv_example_is_taken_by_our_readers(block):
    if block.text.startswith("shot,"):
        robot = robot_of(block)
        shots = parse_plan(block.text, block.where, robot.mechanism)
        found = robot.kinematics.forward(joints_of(shots)).values_or_raise()
        assert abs(found - poses_of(shots)).max() < 1e-6, "its joints lead to its poses"
    elif block.text.startswith("kind,"):
        parse_observations(block.text, block.where, robot_of(block).mechanism)
    elif block.text.startswith("name,"):
        robot = find_robot("par4-prototype").robot
        same = TargetCorrection(robot.kinematics, robot.kinematics, robot.limits)
        correct_poses(block.text, block.where, same)
    else:
        parse_shots(block.text, block.where, robot_of(block).mechanism)


def robot_of(block: Block) -> RobotFile:
    """The shipped robot that has as many joints as the table has columns for them."""
    return find_robot("par4-prototype" if ",q3_deg" in block.text else "delta").robot


@pytest.mark.slow
@pytest.mark.parametrize("block", SHELL_BLOCKS, ids=str)
def test_command_in_an_example_exists(block):
    for line in block.text.splitlines():
        words = shlex.split(line, comments=True)
        if words and words[0].endswith("pkmcal"):
            group = get_command(app)
            command = group.get_command(Context(group), words[1])
            known = {option for each in command.params for option in each.opts}
            assert {word for word in words[2:] if word.startswith("-")} <= known, line


@pytest.mark.slow
def test_reference_pages_are_written_from_the_present_code():
    for page, text in runpy.run_path(str(ROOT / "docs/make_reference.py"))["pages"]().items():
        assert page.read_text(encoding="utf-8") == text, "run `make reference`"


def test_table_of_error_sources_has_the_values_of_the_code():
    rows = (ROOT / "docs/explanation/model.md").read_text(encoding="utf-8").splitlines()
    every = (own for chain in FAMILY.values() for own in chain.parameters.rows)
    units = {(own.field.group, own.unit) for own in every} | set(TRACKER_SOURCES.items())
    for group, own in SOURCES.items():
        angle, ratio = f"{math.degrees(own.of_angles):.3g}°", f"{1e6 * own.of_angles:.3g} ppm"
        shown = {"mm": f"{own.of_lengths:.3g} mm", "deg": angle, "ppm": ratio}
        tolerance = ", ".join(shown[unit] for unit in shown if (group, unit) in units)
        learned = "yes" if own.is_learned else "no"
        assert f"| `{group}` | {own.words} | {tolerance} | {learned} | {own.source} |" in rows


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_links_lead_somewhere(page):
    for target in LINK.findall(page.read_text(encoding="utf-8")):
        if target.startswith(("http://", "https://")):
            continue
        path, _, heading = target.partition("#")
        there = (page.parent / path).resolve() if path else page
        assert there.exists(), target
        if heading:
            assert heading in headings_of(there), target


def test_every_page_and_heading_that_the_software_names_exists():
    sources = (path for room in ROOMS for path in (ROOT / room).rglob("*.py"))
    named = {each for path in sources for each in NAMED.findall(path.read_text(encoding="utf-8"))}
    assert ("docs/reference/files.md", "plancsv") in named
    for path, heading in named:
        assert (ROOT / path).is_file(), path
        assert not heading or heading in headings_of(ROOT / path), f"{path}#{heading}"


def test_an_error_about_a_file_ends_with_the_page_that_explains_it(tmp_path, capsys):
    folder = tmp_path / "c"
    assert run_command(["new", str(folder)]) == 0
    with (folder / "cell.yaml").open("a", encoding="utf-8") as text:
        text.write("unheard_of: 1\n")
    assert run_command(["devices", str(folder)]) == 2
    assert capsys.readouterr().err.rstrip().endswith("(`pkmcal help files#cellyaml`)")


def headings_of(page) -> set[str]:
    """The anchors that a page's headings get: lower case, words joined by hyphens."""
    titles = re.findall(r"^#+ (.+)$", page.read_text(encoding="utf-8"), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", title.lower()).replace(" ", "-") for title in titles}
