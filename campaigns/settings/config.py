"""campaign.yaml (`pkmcal/campaign/1`): what a campaign works with and by which rules.

A campaign's folder holds this file, the nominal robot, and later the journal. The file is written
once, by `pkmcal new`, with the keys that people change and their descriptions, and afterwards
belongs to its users, who edit it by hand or by `pkmcal set`. Each command reads it again, so a
changed limit counts from the next command on.

The keys are the fields of pydantic models: `CampaignConfig` here, its sections in `sections.py`
and `space.py`. A field's limits refuse a wrong number, its description is both the comment in the
new file and the remedy in the error. Rules between several fields are validators that raise
`broken_rule`. Lengths are in mm, angles in deg, times in s; where the code needs rad, a section has
a property for it.
"""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from pydantic import Field, ValidationError, ValidationInfo, field_validator

from campaigns.errors import ConfigInvalid
from campaigns.files import yaml_file
from campaigns.files.text_file import make_folder, read_text, refuse_existing, write_new_text
from campaigns.files.wording import listed, shown
from campaigns.files.yaml_edit import with_key
from campaigns.robots.robot import RobotDocument
from campaigns.settings import sections
from campaigns.settings.space import SpaceConfig
from drivers.bounded_files import is_file
from drivers.texts import nearest_word

SCHEMA = "pkmcal/campaign/1"
FILE_NAME = "campaign.yaml"
VALUE = "value"
USUAL = (
    *("name", "identity", "robot"),
    *("controller.driver", "controller.url", "controller.serial", "controller.speed_percent"),
    *("tracker.driver", "tracker.url", "tracker.serial", "tracker.reflector"),
    *("tracker.measuring_time_s", "tracker.place_mm"),
    *("tracker.uncertainty.along_um", "tracker.uncertainty.along_um_per_m"),
    *("tracker.uncertainty.across_um", "tracker.uncertainty.across_um_per_m"),
    *("tracker.uncertainty.data_sheet", "tracker.uncertainty.typed_by"),
    *("objects", "plan.shots", "plan.validation_pairs", "plan.placement"),
    *("acceptance.distance_mean_mm", "acceptance.distance_max_mm", "acceptance.rotation_mm"),
    *("acceptance.straightness_mm", "people.operator", "people.site"),
    "instruments.tracker",
)
"""Keys that people change, which a new file shows; the others stand on the page of keys."""
FURTHER_KEYS = (
    "# All keys, also those that are not here: pkmcal help files#campaignyaml\n"
    "# To change one: pkmcal set DIR KEY=VALUE\n"
)
MOST_NAMED = 5
"""Largest number of campaigns that an error names."""


class CampaignConfig(yaml_file.FileModel):
    """A campaign's settings."""

    page = "docs/reference/files.md#campaignyaml"

    name: str = Field(min_length=1, description="the campaign's name")
    identity: str = Field(
        default="", max_length=64, description="the mark of its journal; leave it as it is"
    )
    robot: str = Field(
        default="robot.yaml",
        pattern=r"^[^/\\]+$",
        description="the name of the file in this folder that holds the nominal robot",
    )
    controller: sections.ControllerConfig = Field(description="the robot's controller")
    tracker: sections.TrackerConfig = Field(description="the laser tracker and its reflector")
    nests: sections.Nests = Field(
        default=(),
        max_length=100,
        description="fixed reflector places, measured with the drift shots: name, place_mm in the "
        "tracker's frame, reflector and occupied; [] or - {name: A, occupied: true}",
    )
    known_lengths: tuple[sections.KnownLengthConfig, ...] = Field(
        default=(),
        max_length=100,
        description="calibrated lengths that show the tracker's scale: name, length_mm, std_mm and "
        "pairs of the set known-length, or the two nests at its ends",
    )
    objects: sections.Objects = Field(
        default=(),
        max_length=100,
        description="what the rows of observations.csv are of: a bed, a block on it, a printed "
        "part, a probe; [] or - {name: bed}",
    )
    reference_temperature_degC: float = Field(
        default=20.0,
        ge=-40.0,
        le=150.0,
        description="temperature of the robot's parts for which parameters are stated, °C",
    )
    part_temperatures: dict[str, Annotated[float, Field(ge=-40.0, le=150.0)]] = Field(
        default={},
        max_length=1000,
        description="temperatures of the robot's parts by the times at which somebody read them, "
        '{"2026-11-21T09:00:00Z": 24.1}, °C',
    )
    plan: sections.PlanConfig = Field(default=sections.PlanConfig(), description="what is measured")
    space: SpaceConfig = Field(
        default=SpaceConfig(),
        description="where the plate may be and where it may not, in the base frame",
    )
    settle: sections.SettleConfig = Field(
        default=sections.SettleConfig(), description="when the robot counts as at rest"
    )
    gate: sections.GateConfig = Field(
        default=sections.GateConfig(), description="what a shot must keep to count"
    )
    run: sections.RunConfig = Field(
        default=sections.RunConfig(),
        description="what a run does by itself when something goes wrong",
    )
    validation: sections.ValidationConfig = Field(
        default=sections.ValidationConfig(), description="the tests before and after calibration"
    )
    acceptance: sections.AcceptanceConfig = Field(
        default=sections.AcceptanceConfig(),
        description="limits that the robot must meet, for example distance_mean_mm: 0.1 and "
        "distance_max_mm: 0.3; empty: no limit",
    )
    people: sections.PeopleConfig = Field(
        default=sections.PeopleConfig(), description="who and where, for the record"
    )
    instruments: sections.InstrumentsConfig = Field(
        default=sections.InstrumentsConfig(),
        description="what no device tells about itself, for the record",
    )
    certificate: sections.CertificateConfig = Field(
        default=sections.CertificateConfig(),
        description="customer, item and the tracker's own certificate, for the record",
    )

    @field_validator("known_lengths")
    @classmethod
    def _check_ends(
        cls, lengths: tuple[sections.KnownLengthConfig, ...], fields: ValidationInfo
    ) -> tuple[sections.KnownLengthConfig, ...]:
        # `nests` stands before `known_lengths` in the model, so its value is checked by now; it is
        # missing from `data` if it was wrong
        names = [nest.name for nest in fields.data.get("nests", ())]
        for bar in lengths:
            if bar.nests and (len(set(bar.nests)) < 2 or not set(bar.nests) <= set(names)):
                problem = f"has {bar.name} between {list(bar.nests)}"
                raise yaml_file.broken_rule(f"{problem}, must be two of the nests {names}")
        return lengths


def read_campaign(directory: Path) -> CampaignConfig:
    """Read a campaign's settings; raise `ConfigInvalid`."""
    path = directory / FILE_NAME
    if not is_file(path):
        remedy = _campaigns_nearby(directory)
        raise ConfigInvalid(f"{directory} holds no {FILE_NAME}", remedy=remedy)
    remedy = "name a campaign's folder"
    return yaml_file.checked(
        yaml_file.read_document(path, if_missing=remedy), SCHEMA, CampaignConfig
    )


def _campaigns_nearby(directory: Path) -> str:
    """Return which folder was probably meant: one within, the one around, or one beside it."""
    # The likeliest mistake comes first: a command given in the folder above all campaigns, in a
    # folder inside a campaign, or with a name that is misspelt.
    name = directory.absolute().name
    within = _campaigns_in(directory)
    if within:
        return f"name a campaign; here are {_list_names(within)}"
    if is_file(directory.parent / FILE_NAME) and directory.parent != directory:
        return f"{directory.absolute().parent} is a campaign: name that folder"
    beside = _campaigns_in(directory.absolute().parent)
    nearest = nearest_word(name, [folder.name for folder in beside])
    if nearest:
        return f"did you mean {directory.parent / nearest}?"
    if beside:
        return f"name a campaign; beside it are {_list_names(beside)}"
    return "name a campaign's folder, or make one with `pkmcal new DIR`"


def _campaigns_in(folder: Path) -> list[Path]:
    """Return the campaigns in a folder; none in one that cannot be listed."""
    try:
        return sorted(path.parent for path in folder.glob(f"*/{FILE_NAME}"))
    except (OSError, ValueError):
        return []


def _list_names(folders: Sequence[Path]) -> str:
    return listed([shown(folder.name) for folder in folders], MOST_NAMED)


def new_config(settings: Mapping[str, object]) -> CampaignConfig:
    """Make settings of a new campaign from its keys; raise `ConfigInvalid`.

    Required are `name`, `controller.url`, `tracker.url` and `tracker.reflector`.
    """
    # through JSON, because strict models accept a list for a tuple only from there
    try:
        return CampaignConfig.model_validate_json(json.dumps(settings))
    except ValidationError as error:
        raise yaml_file.explained(error, CampaignConfig, "new campaign") from error


def write_new_campaign(directory: Path, config: CampaignConfig, robot: RobotDocument) -> None:
    """Make a campaign's folder with its robot and settings; raise `OutputExists`, `WriteFailed`."""
    # campaign.yaml makes a folder a campaign, so it is written last. If the command breaks off
    # before, the folder is not yet a campaign, and the command can be given again: a robot file
    # with this very text is taken as its own, any other one is somebody's and stays.
    path = directory / FILE_NAME
    refuse_existing(path)
    make_folder(directory)
    for file, text in robot.files_in(directory, config.robot).items():
        if not (is_file(file) and read_text(file, ConfigInvalid, if_missing="start again") == text):
            write_new_text(file, text)
    write_new_text(path, new_settings_text(config))


def new_settings_text(config: CampaignConfig) -> str:
    """Return the text of a new campaign.yaml: the usual keys, and all that are not at default."""
    return f"{FURTHER_KEYS}{yaml_file.commented_yaml(SCHEMA, config, USUAL)}"


@dataclass(frozen=True, slots=True)
class ChangedSettings:
    """Text of campaign.yaml after a change, and the changed keys with their new values."""

    text: str
    values: Mapping[str, object]


def changed_settings(directory: Path, changes: Mapping[str, str]) -> ChangedSettings:
    """Return a campaign's settings with changed keys; all other lines stay as they are.

    `changes` holds values as they are typed, by keys such as `plan.shots`. Raise `ConfigInvalid`
    for settings that cannot be read, an unknown key or a wrong value.
    """
    read_campaign(directory)  # what is wrong already is no fault of the change
    document = yaml_file.read_document(directory / FILE_NAME, if_missing="name a campaign's folder")
    values = {}
    for key, typed in changes.items():
        values[key] = yaml_file.parse_document(f"{VALUE}: {typed}\n", key).tree[VALUE]
        document = with_key(document, CampaignConfig, key.split("."), values[key])
    yaml_file.checked(document, SCHEMA, CampaignConfig)
    return ChangedSettings(document.text, values)
