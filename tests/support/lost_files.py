"""What other programs do to a journal while somebody works with it."""

import os
import shutil
import sqlite3
from collections.abc import Callable, Mapping
from contextlib import closing
from pathlib import Path

ANOTHER = Path(__file__).parents[1] / "data" / "journal-v2.db"
"""A whole journal, of another campaign."""
Harm = Callable[[Path], object]


def log_of(path: Path) -> Path:
    return path.with_name(f"{path.name}-wal")


def delete(path: Path) -> None:
    path.unlink()


def delete_all(path: Path) -> None:
    for file in path.parent.glob(f"{path.name}*"):
        file.unlink()


def replace_by_copies(path: Path) -> None:
    """As a program does that keeps folders the same: the contents stay."""
    for file in (path, log_of(path)):
        Path(shutil.copy(file, path.with_name("copy"))).replace(file)


def shorten_log(path: Path, bytes_lost: int) -> None:
    log = log_of(path)
    os.truncate(log, log.stat().st_size - bytes_lost)


HARMS: Mapping[str, Harm] = {
    "delete": delete,
    "delete_all": delete_all,
    "move_away": lambda path: path.rename(path.with_name("elsewhere.db")),
    "replace": lambda path: Path(shutil.copy(ANOTHER, path.with_name("other.db"))).replace(path),
    "replace_by_copies": replace_by_copies,
    "truncate": lambda path: os.truncate(path, 100),
    "delete_log": lambda path: log_of(path).unlink(),
    "empty_log": lambda path: log_of(path).write_bytes(b""),
    "cut_log": lambda path: shorten_log(path, log_of(path).stat().st_size // 2),
    "cut_log_by_a_byte": lambda path: shorten_log(path, 1),
}
"""What loses records, or writes further ones where nobody finds them."""


def scribble_in_log(path: Path) -> None:
    with log_of(path).open("r+b") as file:
        file.seek(-64, os.SEEK_END)
        file.write(b"\xa5" * 64)


def sql(*statements: str) -> Harm:
    """Return what a program does that shows databases and has the file open."""

    def viewed(path: Path) -> None:
        with closing(sqlite3.connect(path, isolation_level=None)) as viewer:
            for statement in statements:
                viewer.execute(statement).fetchall()

    return viewed


FORGERIES: Mapping[str, Harm] = {
    "overwrite": lambda path: shutil.copyfile(ANOTHER, path),  # as `cp` does it: the file stays
    "scribble_in_log": scribble_in_log,
    "change_record": sql(
        "DROP TRIGGER a_record_is_never_changed", "UPDATE record SET at_utc = '2001' WHERE id = 2"
    ),
    "change_version": sql("PRAGMA user_version = 99"),
}
"""What is found out when the file is opened anew."""


def link(path: Path) -> None:
    path.with_name("linked.db").hardlink_to(path)
    path.with_name("linked.db-wal").hardlink_to(log_of(path))


HARMLESS: Mapping[str, Harm] = {
    "touch": lambda path: (path.touch(), log_of(path).touch()),
    "link": link,
    "checkpoint": sql("PRAGMA wal_checkpoint"),
    "checkpoint_and_empty": sql("PRAGMA wal_checkpoint(TRUNCATE)"),
    "vacuum": sql("VACUUM", "PRAGMA wal_checkpoint(TRUNCATE)"),
    "bring_back": lambda path: shutil.copyfile(shutil.copy(path, path.with_name("backup")), path),
    "delete_index": lambda path: path.with_name(f"{path.name}-shm").unlink(missing_ok=True),
}
"""What leaves every record where it is."""
