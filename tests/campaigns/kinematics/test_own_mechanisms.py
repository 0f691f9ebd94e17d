"""One's own mechanism: from a Python file, or offered by another package."""

import numpy as np
import pytest

from campaigns.kinematics.catalog import PAR4, find_mechanism, load_mechanism
from campaigns.kinematics.mechanism import Kinematics
from campaigns.robots.robot import find_robot

OWN = """
from campaigns.kinematics.closed_chain import ClosedChain
from campaigns.kinematics.limbs import Crank
from campaigns.kinematics.platforms import HingedPlate

OWN = ClosedChain("quarter-par4", Crank(), HingedPlate(shares=(-0.25, -0.25, 0.75, 0.75)))
OTHER = "par4"
"""
POSE = np.array([[30.0, -40.0, -600.0, np.radians(15.0)]])


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "my.py"
    path.write_text(OWN, encoding="utf-8")
    return path


def test_a_mechanism_of_a_file_works_as_its_parts_do(file):
    """Its tool lies a quarter of the way from where Par4's is."""
    values = find_robot("par4-prototype").robot.parameters
    own = Kinematics.of(load_mechanism(file, "OWN"), values)
    joints = own.inverse(POSE).values_or_raise()
    assert own.forward(joints).values_or_raise() == pytest.approx(POSE, abs=1e-9)
    theta, quarter = POSE[0, 3], 0.25 * values["plate_mm"]
    on_part_1 = POSE - quarter * np.array([-np.sin(theta), np.cos(theta), 0.0, 0.0])
    of_par4 = Kinematics.of(PAR4, values).inverse(on_part_1).values_or_raise()
    assert joints == pytest.approx(of_par4, abs=1e-12)


def test_a_file_without_the_mechanism_is_refused(file):
    with pytest.raises(AttributeError, match="MINE"):
        load_mechanism(file, "MINE")
    with pytest.raises(TypeError, match=r"OTHER in .*my\.py is 'par4', must be a ClosedChain"):
        load_mechanism(file, "OTHER")
    with pytest.raises(ImportError, match="is no Python file"):
        load_mechanism(file.with_suffix(".txt"), "OWN")
    with pytest.raises(FileNotFoundError):
        load_mechanism(file.with_name("none.py"), "OWN")


def test_another_package_may_offer_a_mechanism_by_its_word(file, monkeypatch):
    own = load_mechanism(file, "OWN")

    class Offer:
        value = "my_package:OWN"

        def load(self):
            return own

    monkeypatch.setattr(
        "campaigns.kinematics.catalog.entry_points",
        lambda group, name: [Offer()] if "par4" in name and group.startswith("pkmcal") else [],
    )
    assert find_mechanism("quarter-par4") is own
    assert find_mechanism("hexapod") is None
    assert find_mechanism(4) is None
    with pytest.raises(TypeError, match="must be a ClosedChain named 'half-par4'"):
        find_mechanism("half-par4")
