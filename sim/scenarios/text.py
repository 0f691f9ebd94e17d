"""A scenario's own text, to be kept with what was measured on it."""

from io import StringIO
from pathlib import Path

from ruamel.yaml import YAML

from sim.scenarios.scenario import load_scenario, shipped_scenarios, shipped_text


def scenario_text(name_or_path: str, seed: int | None = None) -> str:
    """The YAML of a scenario, comments and all, with another seed if one is given.

    Raises `ScenarioInvalid`.
    """
    load_scenario(name_or_path)
    text = _source(name_or_path)
    if seed is None:
        return text
    yaml = YAML()
    tree = yaml.load(text)
    tree["seed"] = seed
    written = StringIO()
    yaml.dump(tree, written)
    return written.getvalue()


def _source(name_or_path: str) -> str:
    if name_or_path in shipped_scenarios():
        return shipped_text(name_or_path)
    return Path(name_or_path).read_text(encoding="utf-8")
