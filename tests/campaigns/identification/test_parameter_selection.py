"""What the user knows: patterns to free and fix, and priors."""

import pytest
from par4_space import SPACE

from campaigns.errors import OptionsInvalid
from campaigns.identification.parameter_selection import matching, select_parameters

AZIMUTHS = tuple(f"arm{arm}.azimuth_deg" for arm in range(4))


def test_patterns_free_and_fix_every_parameter_they_match():
    assert select_parameters(SPACE).free == SPACE.free_by_default
    assert select_parameters(SPACE).priors == {}
    free = select_parameters(SPACE, freed=["arm*.azimuth_deg"]).free
    assert set(free) == {*SPACE.free_by_default, *AZIMUTHS}
    assert list(free) == sorted(free, key=SPACE.names.index)
    free = select_parameters(SPACE, fixed=["arm[12].*"]).free
    assert not [name for name in free if name.startswith(("arm1", "arm2"))]
    assert "arm3.x_mm" in free


def test_a_written_out_name_outranks_a_pattern():
    free = select_parameters(SPACE, freed=["arm*.azimuth_deg"], fixed=["arm0.azimuth_deg"]).free
    assert "arm0.azimuth_deg" not in free
    assert "arm1.azimuth_deg" in free
    assert "plate_mm" in select_parameters(SPACE, freed=["plate_mm"], fixed=["*_mm"]).free


@pytest.mark.parametrize("same", ["plate_mm", "arm*.arm_mm"])
def test_what_is_freed_and_fixed_alike_is_refused(same):
    with pytest.raises(OptionsInvalid, match="both freed and fixed"):
        select_parameters(SPACE, freed=[same], fixed=[same])


def test_what_matches_nothing_or_leaves_nothing_is_refused():
    with pytest.raises(OptionsInvalid, match=r"arm1\.azimut_deg is not a parameter") as caught:
        select_parameters(SPACE, freed=["arm1.azimut_deg"])
    assert "did you mean arm1.azimuth_deg?" in caught.value.remedy
    with pytest.raises(OptionsInvalid, match=r"arm7\.\* matches no parameter"):
        matching("arm7.*", SPACE.names)
    with pytest.raises(OptionsInvalid, match="no parameter to find"):
        select_parameters(SPACE, fixed=["*"])


def test_a_prior_means_its_patterns_free_parameters_and_the_last_counts():
    priors = select_parameters(SPACE, priors=["arm*.x_mm=0.5", "plate_mm=0.1"]).priors
    assert priors == {f"arm{arm}.x_mm": 0.5 for arm in (1, 2, 3)} | {"plate_mm": 0.1}
    priors = select_parameters(
        SPACE, priors=["arm*.forearm_mm=0.05", "arm2.forearm_mm=0.01"]
    ).priors
    assert (priors["arm2.forearm_mm"], priors["arm1.forearm_mm"]) == (0.01, 0.05)


def test_a_prior_on_held_parameters_is_refused_by_name():
    with pytest.raises(OptionsInvalid, match=r"arm0\.x_mm is held") as caught:
        select_parameters(SPACE, priors=["arm0.x_mm=0.1"])
    assert "--free 'arm0.x_mm'" in caught.value.remedy
    with pytest.raises(OptionsInvalid, match="are held"):
        select_parameters(SPACE, priors=["arm*.azimuth_deg=0.1"])
    with pytest.raises(OptionsInvalid, match=r"plate_mm is held"):
        select_parameters(SPACE, fixed=["plate_mm"], priors=["plate_mm=0.1"])


@pytest.mark.parametrize("text", ["plate_mm", "plate_mm=", "plate_mm=-1", "plate_mm=0", "=0.1x"])
def test_a_prior_without_a_positive_standard_deviation_is_refused(text):
    with pytest.raises(OptionsInvalid, match="must be a number above 0"):
        select_parameters(SPACE, priors=[text])


@pytest.mark.parametrize(
    ("number", "said"),
    [("nan", "above 0"), ("inf", "above 0"), ("1e-7", "1e-06 or more"), ("1e-320", "1e-06 or")],
)
def test_a_prior_that_says_nothing_or_all_is_refused(number, said):
    with pytest.raises(OptionsInvalid, match=said):
        select_parameters(SPACE, priors=[f"plate_mm={number}"])
