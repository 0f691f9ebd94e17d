"""Certificate section of campaign.yaml: customer, item and the tracker's own certificate."""

from datetime import date

from pydantic import Field

from campaigns.files.yaml_file import FileModel


class TrackerCertificateConfig(FileModel):
    """Certificate of the tracker's own calibration, by which lengths are traceable."""

    number: str = Field(default="", description="its number, in quotes")
    laboratory: str = Field(default="", description="who calibrated the tracker")
    issued: date | None = Field(default=None, description="when, as 2026-03-02")
    expires: date | None = Field(default=None, description="until when it is valid")


class CertificateConfig(FileModel):
    """Facts of the calibration that no device and no other section states."""

    customer: str = Field(default="", description="name and address of the customer")
    laboratory: str = Field(default="", description="name and address of the laboratory")
    robot_type: str = Field(default="", description="the robot's maker and type")
    tool: str = Field(default="", description="the tool or reflector holder on the plate")
    payload_kg: float | None = Field(default=None, ge=0.0, description="the payload, kg")
    conditions: str = Field(
        default="", description="conditions beside those measured: warm-up, doors, floor"
    )
    tracker: TrackerCertificateConfig = Field(
        default=TrackerCertificateConfig(), description="the tracker's own certificate"
    )

    def expired_on(self, day: date) -> bool:
        """Whether the tracker's certificate was no longer valid on that day."""
        expires = self.tracker.expires
        return expires is not None and expires < day
