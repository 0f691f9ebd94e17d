"""Errors of a campaign, named by what the operator does next."""

# Each class stands for one reaction, not for one place in the program: a table in app/exits.py
# gives it an exit code, and docs/how-to/troubleshooting.md a line. The text of an error says what
# is wrong, where, the value and its limit; `remedy` says what to do.

from drivers.errors import ExplainedError


class CampaignError(ExplainedError):
    """Root of everything that the campaign's own work raises."""


class ConfigInvalid(CampaignError):
    """campaign.yaml or a robot file is missing, or cannot be used as written: correct the line."""


class PlanInvalid(CampaignError):
    """plan.csv cannot be used as written: correct the line that is named, or make a new plan."""

    page = "docs/reference/files.md#plancsv"


class OptionsInvalid(CampaignError):
    """Options contradict each other, cannot be understood, or name what does not exist."""


class ShotsInvalid(CampaignError):
    """A file of measured shots cannot be used as written: correct the line that is named."""

    page = "docs/reference/files.md#shotscsv"


class ObservationsInvalid(ShotsInvalid):
    """A file of observations cannot be used as written: correct the line that is named."""

    page = "docs/reference/files.md#observationscsv"


class CoordinatesAmbiguous(ShotsInvalid):
    """A file of points has measured and nominal coordinates: say which ones count."""


class ShotsMissing(CampaignError):
    """The work asked for needs shots that have not been taken yet: run or import first."""


class TargetsInvalid(CampaignError):
    """A pose cannot be corrected as written: change the line that is named."""

    page = "docs/reference/files.md#targets"


class OutputExists(CampaignError):
    """The file to be written is already there, and nothing is overwritten unasked."""


class WriteFailed(CampaignError):
    """A file could not be written (full disk, no rights). What was there before is intact."""


class CampaignLocked(CampaignError):
    """Another process works on the same campaign: wait for it, or stop it."""


class JournalFailed(CampaignError):
    """The journal cannot be written or read. Nothing moves without it."""

    page = "docs/how-to/troubleshooting.md#exit-code-4-a-file-could-not-be-written"


class FindingUnreadable(CampaignError):
    """A finding that another version of the software wrote in another form: compute it again."""


class ResumeRefused(CampaignError):
    """The campaign cannot go on as it began: another plan or device, or the robot has shifted."""


class TargetOutOfReach(CampaignError):
    """A pose breaks a limit of the robot or the tracker's view: change the pose or the limit."""


class JogRequired(CampaignError):
    """The robot stands where no program may move it: jog it out of there by hand."""


class NotSettled(CampaignError):
    """The robot did not come to rest in place in time: look at it, then at the settle limits."""


class GateRefused(CampaignError):
    """A shot, the drift or the temperature is too far from the expected: find out why first."""


class InstrumentMissing(CampaignError):
    """Observations are read off instruments by a person, and no one is there to ask."""


class IdentificationRefused(CampaignError):
    """The shots cannot give the parameters asked for: measure more, or hold those named."""


class LoadNotVerified(CampaignError):
    """The controller does not hold what was written to it: load again, or roll back."""


class VerdictBad(CampaignError):
    """The work was done, and its result must not be used."""


class Interrupted(CampaignError):
    """The operator asked to stop, and the robot has been stopped. Everything measured is kept."""
