"""What pyproject.toml cannot say: wheel and sdist know of which commit they are."""

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


setup(cmdclass={"build_py": BuildWithCommit, "sdist": SdistWithCommit})
