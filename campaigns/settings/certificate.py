"""Certificate section of campaign.yaml: what ISO/IEC 17025 (7.8) asks of a certificate's head."""

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
    """Head of the certificate; the report has one where a number is given."""

    number: str = Field(default="", description="the certificate's number, in quotes")
    customer: str = Field(default="", description="name and address of the customer")
    laboratory: str = Field(default="", description="name and address of the laboratory")
    measured_by: str = Field(default="", description="who measured")
    authorised_by: str = Field(default="", description="who authorises the certificate")
    robot_type: str = Field(default="", description="the robot's maker and type")
    tool: str = Field(default="", description="the tool or reflector holder on the plate")
    payload_kg: float | None = Field(default=None, ge=0.0, description="the payload, kg")
    conditions: str = Field(
        default="", description="conditions beside those measured: warm-up, doors, floor"
    )
    tracker: TrackerCertificateConfig = Field(
        default=TrackerCertificateConfig(), description="the tracker's own certificate"
    )

    @property
    def empty(self) -> tuple[str, ...]:
        """Names of the keys without a value, as in campaign.yaml."""
        own = {f"certificate.{name}": value for name, value in self if name != "tracker"}
        of_tracker = {f"certificate.tracker.{name}": value for name, value in self.tracker}
        return tuple(name for name, value in {**own, **of_tracker}.items() if value in ("", None))

    def expired_on(self, day: date) -> bool:
        """Whether the tracker's certificate was no longer valid on that day."""
        expires = self.tracker.expires
        return expires is not None and expires < day
