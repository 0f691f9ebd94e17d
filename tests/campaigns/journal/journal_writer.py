"""A process to be killed: writes until an intent, says so, and waits for its end."""

import sys
from pathlib import Path

from journal_story import SESSION, beginning, intent, outcome, ticking

from campaigns.files.lock import campaign_lock
from campaigns.journal.journal import open_journal


def main(path: Path) -> None:
    clock = ticking()
    with campaign_lock(path.parent, now_utc=clock), open_journal(path, now_utc=clock) as journal:
        run = journal.start_series(beginning())
        for record in (SESSION, intent(1), outcome(1), intent(2)):
            journal.append(record, series=run)
        sys.stdout.write("intended\n")
        sys.stdout.flush()
        sys.stdin.read()


if __name__ == "__main__":
    main(Path(sys.argv[1]))
