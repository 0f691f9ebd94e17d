"""The product's words and names keep to the rules in CONTRIBUTING.md, or come nearer to them."""

import pytest

from benchmarks import size, style

BREACHES, CEILINGS = style.breaches(), size.ceilings("style")
EXAMPLES = 12

FEWEST_COMMENTS, MOST_COMMENTS = 0.025, 0.060
"""Comments a line with which the models of this field explain themselves."""
SLACK_COMMENTS = 6
"""Comments that a small room may have beyond; a large one a tenth of its most."""

BAD = """SAYS = "12 packets" " passed over"

def f(a, b, c, d, e, g, h) -> tuple[int, str, float]:
    \"\"\"What nobody is told anew, as fast as light.\"\"\"
    found = [each for each in a]  # the size that is none
    return found

steps: tuple[Callable[[], None], int]
"""


def test_each_rule_has_its_ceiling():
    assert tuple(CEILINGS) == style.RULES


@pytest.mark.parametrize("rule", style.RULES)
def test_no_rule_is_broken_more_often_than_before(rule):
    places = [str(breach) for breach in BREACHES if breach.rule == rule]
    above = len(places) - CEILINGS[rule]
    assert above <= 0, "\n".join([f"{above} more than before; of all:", *places[:EXAMPLES]])


def test_every_rule_sees_its_example(tmp_path):
    file = tmp_path / "example.py"
    file.write_text(BAD, encoding="utf-8")
    rules = [breach.rule for breach in style.breaches_in(file)]
    assert [rules.count(rule) for rule in style.RULES] == [5, 1, 1, 1, 1, 1]


@pytest.mark.parametrize(("room", "counts"), style.comments_by_room().items())
def test_each_room_explains_itself_and_no_more(room, counts):
    comments, lines = counts
    most = MOST_COMMENTS * lines
    assert FEWEST_COMMENTS * lines <= comments <= most + max(SLACK_COMMENTS, 0.1 * most)
