"""The drivers there are: declared once, chosen by name, and refused by name."""

import pytest
from pydantic import ValidationError

from campaigns.settings.sections import ControllerConfig, TrackerConfig
from drivers import catalog
from drivers.errors import WireError

REQUIRED = {ControllerConfig: {}, TrackerConfig: {"reflector": "CCR"}}


def test_settings_offer_the_drivers_that_there_are():
    for section, drivers in (
        (TrackerConfig, catalog.TRACKERS),
        (ControllerConfig, catalog.CONTROLLERS),
    ):
        field = section.model_fields["driver"]
        assert field.annotation.__args__ == tuple(drivers)
        assert all(name in field.description for name in drivers)


@pytest.mark.parametrize(
    ("section", "driver", "url"),
    [
        (ControllerConfig, "robotline", "by-hand"),
        (ControllerConfig, "by-hand", "tcp://robot:5020"),
        (TrackerConfig, "emscon", "file:points.txt"),
        (TrackerConfig, "watch-file", "sim://cell"),
    ],
)
def test_driver_and_address_have_to_fit(section, driver, url):
    with pytest.raises(ValidationError, match=f"has driver {driver} and url {url}: "):
        section(driver=driver, url=url, **REQUIRED[section])


@pytest.mark.parametrize("name", catalog.TRACKERS)
def test_damaged_record_of_a_measurement_is_a_wire_error(name):
    for raw in ("", "00", "°", "%R1P,0,1:0,1.0"):
        with pytest.raises(WireError):
            catalog.TRACKERS[name].read_record(raw)
