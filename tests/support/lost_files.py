"""What other programs do to a journal while somebody works with it."""

import os
import shutil
import sqlite3
from collections.abc import Callable, Mapping
from contextlib import closing
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


def replace_by_copies(path: Path) -> None:
    """As a program does that keeps folders the same: the contents stay."""
    for file in (path, log_of(path)):
        Path(shutil.copy(file, path.with_name("copy"))).replace(file)


def truncate(path: Path) -> None:
    with path.open("r+b") as file:
        file.truncate(100)


def log_of(path: Path) -> Path:
    return path.with_name(f"{path.name}-wal")


def delete_log(path: Path) -> None:
    log_of(path).unlink()


def empty_log(path: Path) -> None:
    log_of(path).write_bytes(b"")


def cut_log(path: Path) -> None:
    with log_of(path).open("r+b") as file:
        file.truncate(log_of(path).stat().st_size // 2)


def cut_log_by_a_byte(path: Path) -> None:
    with log_of(path).open("r+b") as file:
        file.truncate(log_of(path).stat().st_size - 1)


HARMS: Mapping[str, Harm] = {
    harm.__name__: harm
    for harm in (
        delete,
        delete_all,
        move_away,
        replace,
        replace_by_copies,
        truncate,
        delete_log,
        empty_log,
        cut_log,
        cut_log_by_a_byte,
    )
}
"""What loses records, or writes further ones where nobody finds them."""


def overwrite(path: Path) -> None:
    """As `cp` does it: the file stays, its contents are others."""
    shutil.copyfile(ANOTHER, path)


def scribble_in_log(path: Path) -> None:
    with log_of(path).open("r+b") as file:
        file.seek(-64, os.SEEK_END)
        file.write(b"\xa5" * 64)


def change_record(path: Path) -> None:
    """A digit of a record, by somebody who knows SQLite."""
    with closing(sqlite3.connect(path)) as viewer, viewer:
        viewer.execute("DROP TRIGGER a_record_is_never_changed")
        viewer.execute("UPDATE record SET at_utc = '2001' WHERE id = 2")


def change_version(path: Path) -> None:
    with closing(sqlite3.connect(path, isolation_level=None)) as viewer:
        viewer.execute("PRAGMA user_version = 99")


FORGERIES: Mapping[str, Harm] = {
    harm.__name__: harm for harm in (overwrite, scribble_in_log, change_record, change_version)
}
"""What is found out when the file is opened anew."""


def touch(path: Path) -> None:
    path.touch()
    log_of(path).touch()


def link(path: Path) -> None:
    path.with_name("linked.db").hardlink_to(path)
    path.with_name("linked.db-wal").hardlink_to(log_of(path))


def checkpoint(path: Path) -> None:
    viewed(path, "PRAGMA wal_checkpoint")


def checkpoint_and_empty(path: Path) -> None:
    viewed(path, "PRAGMA wal_checkpoint(TRUNCATE)")


def vacuum(path: Path) -> None:
    viewed(path, "VACUUM", "PRAGMA wal_checkpoint(TRUNCATE)")


def bring_back(path: Path) -> None:
    """A backup, copied over the file in place."""
    shutil.copyfile(shutil.copy(path, path.with_name("backup.db")), path)


def delete_index(path: Path) -> None:
    path.with_name(f"{path.name}-shm").unlink(missing_ok=True)


def viewed(path: Path, *statements: str) -> None:
    """A program that shows databases has the file open, and tidies it."""
    with closing(sqlite3.connect(path, isolation_level=None)) as viewer:
        for statement in statements:
            viewer.execute(statement).fetchall()


HARMLESS: Mapping[str, Harm] = {
    each.__name__: each
    for each in (touch, link, checkpoint, checkpoint_and_empty, vacuum, bring_back, delete_index)
}
"""What leaves every record where it is."""
