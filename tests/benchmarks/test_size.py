import ast

import pytest

from benchmarks.size import classes_in, is_dataclass


@pytest.mark.parametrize(
    ("mark", "counts"),
    [
        ("@dataclass", True),
        ("@dataclass(frozen=True)", True),
        ("@dataclasses.dataclass", True),
        ("@final", False),
        ("", False),
    ],
)
def test_dataclass_is_told_by_its_decorator(mark, counts):
    tree = ast.parse(f"{mark}\nclass Value: ...")
    assert is_dataclass(tree.body[0]) == counts


def test_every_class_of_a_package_counts():
    names = {found.name for found in classes_in("drivers")}
    assert {"Link", "Measurement"} <= names
