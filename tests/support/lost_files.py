"""What other programs do to a journal while somebody works with it."""

import shutil
from collections.abc import Callable, Mapping
from pathlib import Path

ANOTHER = Path(__file__).parents[1] / "data" / "journal-v2.db"
"""A whole journal, of another campaign."""
Harm = Callable[[Path], None]


def delete(path: Path) -> None:
    path.unlink()


def delete_all(path: Path) -> None:
    for each in path.parent.glob(f"{path.name}*"):
        each.unlink()


def move_away(path: Path) -> None:
    path.rename(path.with_name("elsewhere.db"))


def replace(path: Path) -> None:
    Path(shutil.copy(ANOTHER, path.with_name("other.db"))).replace(path)


def overwrite(path: Path) -> None:
    """The same, as `cp` does it: the file stays, its contents are others."""
    shutil.copyfile(ANOTHER, path)


def truncate(path: Path) -> None:
    with path.open("r+b") as file:
        file.truncate(100)


def link(path: Path) -> None:
    path.with_name("linked.db").hardlink_to(path)


def log_of(path: Path) -> Path:
    return path.with_name(f"{path.name}-wal")


def delete_log(path: Path) -> None:
    log_of(path).unlink()


def empty_log(path: Path) -> None:
    log_of(path).write_bytes(b"")


def cut_log(path: Path) -> None:
    with log_of(path).open("r+b") as file:
        file.truncate(log_of(path).stat().st_size // 2)


def scribble_in_log(path: Path) -> None:
    with log_of(path).open("r+b") as file:
        file.seek(log_of(path).stat().st_size // 2)
        file.write(b"\xa5" * 64)


def delete_index(path: Path) -> None:
    path.with_name(f"{path.name}-shm").unlink()


HARMS: Mapping[str, Harm] = {
    harm.__name__: harm
    for harm in (
        delete,
        delete_all,
        move_away,
        replace,
        overwrite,
        truncate,
        link,
        delete_log,
        empty_log,
        cut_log,
        scribble_in_log,
        delete_index,
    )
}
