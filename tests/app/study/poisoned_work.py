"""Work for the tests of workers: some of it kills who does it."""

import os
import signal

from campaigns.study import CampaignOutcome

POISON = 13


def work(task):
    """An outcome for each campaign; the poisoned one kills its process as a full memory would."""
    if POISON in task.numbers:
        os.kill(os.getpid(), signal.SIGKILL)
    return tuple(CampaignOutcome(number, None, "looked at") for number in task.numbers)


def harmless(task):
    """The same without the poison."""
    return tuple(CampaignOutcome(number, None, "looked at") for number in task.numbers)
