"""Two records of the yardsticks are compared in words and by tolerance."""

import pytest

from benchmarks.differences import differences, text_differences

PARAMETER = {"value": 350.0, "std": 0.02, "delta": 1.0}


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ({"a": [1, 2.0, "x", None]}, {"a": [1, 2.0, "x", None]}, []),
        ({"a": 1}, {"b": 1}, ["case.a: missing", "case.b: added"]),
        ({"a": "pass"}, {"a": "fail"}, ["case.a:\n    - pass\n    + fail"]),
        ({"a": [1, 2]}, {"a": [1]}, ["case.a: 2 → 1 entries"]),
        ({"a": 120}, {"a": 121}, ["case.a: 120 → 121 (off by +1, allowed 0)"]),
        (PARAMETER, PARAMETER | {"value": 350.0009}, []),
    ],
)
def test_what_differs_is_said_in_words(old, new, words):
    assert list(differences(old, new, "case")) == words


@pytest.mark.parametrize("change", [{"value": 350.0011}, {"std": 0.0205}])
def test_parameters_differ_beyond_their_tolerance(change):
    assert list(differences(PARAMETER, PARAMETER | change, "case"))


def test_printed_numbers_may_differ_by_their_last_digit():
    assert list(text_differences(["mean 0.021 mm"], ["mean 0.022 mm"], "help/x.txt")) == []
    assert list(text_differences(["mean 0.021 mm"], ["mean 0.023 mm"], "help/x.txt")) != []
    assert list(text_differences(["0.021"], ["0.022"], "plans/x.csv")) != []
