import json
import math

import pytest

from benchmarks.shared.yardstick import Figure, Report, Table, main

TABLE = Table("shots", ("", "mm"), [("first", 0.25), ("second", math.nan)])


@pytest.mark.parametrize(
    ("figure", "verdict"),
    [
        (Figure("time", 4.0, highest=4.0), "kept, at most 4"),
        (Figure("time", 4.1, highest=4.0), "missed, at most 4"),
        (Figure("rate", 99.0, lowest=100.0), "missed, at least 100"),
        (Figure("radius", 0.4, "mm", 0.3, 0.5), "kept, at least 0.3, at most 0.5"),
        (Figure("time", math.nan, highest=4.0), "missed, at most 4"),
        (Figure("time", 4.0), ""),
    ],
)
def test_verdict_names_the_limits(figure, verdict):
    assert figure.verdict == verdict


def test_text_shows_tables_then_figures_in_columns():
    report = Report([Figure("median", 12.0, "ms", highest=5.0)], [TABLE])
    assert str(report).splitlines() == [
        "shots",
        "          mm",
        "first   0.25",
        "second",
        "",
        "median  12  ms  missed, at most 5",
    ]


def test_json_has_null_where_there_is_no_number(capsys):
    assert main("Doc.", lambda: Report(tables=[TABLE]), ["--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert document["tables"] == {"shots": [{"": "first", "mm": 0.25}, {"": "second", "mm": None}]}


@pytest.mark.parametrize(("rounds", "code"), [("5", 0), ("6", 1)])
def test_exit_code_says_whether_a_limit_was_missed(rounds, code, capsys):
    def measure(rounds):
        return Report([Figure("rounds", rounds, highest=5)])

    assert main("Doc.", measure, ["--rounds", rounds], rounds=3) == code
    assert "rounds" in capsys.readouterr().out
