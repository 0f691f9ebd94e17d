"""What pyproject.toml cannot say: docs and examples of a wheel, and the commit that it is of."""

from pathlib import Path
from runpy import run_path

from setuptools import setup
from setuptools.command.build_py import build_py
from setuptools.command.sdist import sdist

VERSION_FILE = Path(__file__).parent / "campaigns" / "version.py"
OWN = run_path(str(VERSION_FILE))


def write_commit(root: str) -> None:
    """Keep the commit beside version.py below a folder; nothing where nobody knows it."""
    commit = OWN["commit"](VERSION_FILE.parent)
    if commit:
        (Path(root) / "campaigns" / OWN["COMMIT_FILE"]).write_text(f"{commit}\n", encoding="utf-8")


class BuildWithCommit(build_py):
    """Modules of a wheel, and its commit."""

    def run(self) -> None:
        """Build them."""
        super().run()
        if not self.editable_mode:
            write_commit(self.build_lib)


class SdistWithCommit(sdist):
    """Files of an sdist, and its commit."""

    def make_release_tree(self, base_dir: str, files: list[str]) -> None:
        """Lay them out."""
        super().make_release_tree(base_dir, files)
        write_commit(base_dir)


def shared_files() -> list[tuple[str, list[str]]]:
    """Pages and examples, by their folders in the environment's `share/pkmcal`."""
    found = {"share/pkmcal": ["README.md", "CHANGELOG.md", "CONTRIBUTING.md", "LICENSE"]}
    for top in ("docs", "examples"):
        for path in sorted(Path(top).rglob("*")):
            if path.is_file() and "__pycache__" not in path.parts:
                found.setdefault(f"share/pkmcal/{path.parent.as_posix()}", []).append(str(path))
    return list(found.items())


setup(data_files=shared_files(), cmdclass={"build_py": BuildWithCommit, "sdist": SdistWithCommit})
