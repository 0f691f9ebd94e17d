"""Work for the tests of workers: some of it kills who does it, some of it fails."""

import os
import signal

from campaigns.studies.study import CampaignRow

POISON = 13
FAULT = 22


def work(task):
    """An outcome for each campaign; the poisoned one kills its process as a full memory would."""
    if POISON in task.numbers:
        os.kill(os.getpid(), signal.SIGKILL)
    if FAULT in task.numbers:
        raise ZeroDivisionError("by nothing")
    return harmless(task)


def harmless(task):
    """The same without poison and fault."""
    return tuple(CampaignRow(number, failure="looked at") for number in task.numbers)


def harmless_portion(portion):
    """The same of tasks that share something."""
    return harmless(portion.own)
