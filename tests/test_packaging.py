"""Wheel and sdist, built from the commit and installed in an environment of their own."""

import os
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
pytestmark = [pytest.mark.long, pytest.mark.timeout(900)]


def run(*command, cwd, code=0, **more):
    """Run a command without this test's own path; gives what it says."""
    kept = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    done = subprocess.run(
        [*map(str, command)], cwd=cwd, env=kept | more, capture_output=True, text=True, check=False
    )
    assert done.returncode == code, (command, done.stdout[-2000:], done.stderr[-2000:])
    return done.stdout + done.stderr


def environment(folder):
    run(sys.executable, "-m", "venv", folder, cwd=folder.parent)
    return folder / "bin"


@pytest.fixture(scope="module")
def built(tmp_path_factory):
    """Checkout, and the wheel that is built of its sdist."""
    folder = tmp_path_factory.mktemp("built")
    checkout = folder / "checkout"
    run("git", "clone", "--quiet", ROOT, checkout, cwd=folder)
    tools = environment(folder / "tools")
    run(tools / "pip", "install", "--quiet", "setuptools>=77", "wheel", cwd=folder)
    build = "from setuptools.build_meta import build_sdist; build_sdist('dist')"
    run(tools / "python", "-c", build, cwd=checkout)
    (sdist,) = (checkout / "dist").glob("*.tar.gz")
    wheels = folder / "wheels"
    run(tools / "pip", "wheel", "--quiet", "--no-deps", "--wheel-dir", wheels, sdist, cwd=folder)
    (wheel,) = wheels.glob("*.whl")
    return checkout, wheel


@pytest.fixture(scope="module")
def installed(built, tmp_path_factory):
    """Programs of an environment that has the wheel alone."""
    programs = environment(tmp_path_factory.mktemp("installed") / "venv")
    run(programs / "pip", "install", "--quiet", built[1], cwd=ROOT.parent)
    return programs


def test_wheel_has_docs_examples_licences_and_no_address_that_is_not_there(built):
    checkout, wheel = built
    listed = run("git", "ls-files", "docs", "examples", cwd=checkout).split()
    with zipfile.ZipFile(wheel) as files:
        names = files.namelist()
        told = files.read(next(n for n in names if n.endswith("/METADATA"))).decode()
    shared = {name.partition("/data/share/pkmcal/")[2] for name in names}
    assert not {*listed} - shared
    assert "License-Expression: Apache-2.0 AND GPL-2.0-or-later" in told
    assert told.count("License-File: ") == 2
    assert "Project-URL" not in told
    assert not [name for name in names if name.startswith(("tests/", "benchmarks/"))]


def test_installed_program_knows_its_commit_and_calibrates(built, installed, tmp_path):
    commit = run("git", "rev-parse", "--short", "HEAD", cwd=built[0]).strip()
    for command in (["pkmcal"], ["python", "-m", "app"], ["python", "-m", "pkmcal"]):
        said = run(installed / command[0], *command[1:], "--version", cwd=tmp_path)
        assert f"({commit})" in said
    run(installed / "pkmcal", "dry-run", tmp_path / "dry", cwd=tmp_path)
    assert (tmp_path / "dry" / "report.html").stat().st_size > 100_000
    share = installed.parent / "share" / "pkmcal"
    assert (share / "examples" / "linuxcnc" / "pkmkins" / "pkmkins.c").is_file()


def test_folder_called_app_is_named_in_a_line_instead_of_a_traceback(installed, tmp_path):
    (tmp_path / "app").mkdir()
    (tmp_path / "app" / "__init__.py").touch()
    program = installed / "pkmcal"
    said = run(program, "--version", cwd=tmp_path, code=2, PYTHONPATH=str(tmp_path))
    assert said.startswith(f"pkmcal: {tmp_path / 'app'} stands in the way")
    assert "Traceback" not in said
    assert "pkmcal 0" in run(program, "--version", cwd=tmp_path)
