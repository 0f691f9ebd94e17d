"""pkmcal study --effects: which wrong campaigns pass, as a table and a document; resumed."""

import json

import pytest

pytestmark = [pytest.mark.slow, pytest.mark.long]

EFFECTS = ("--effects", "clean", "--effects", "scale")
SCENARIO = ("--scenario", "drawn-robots")


@pytest.fixture
def studied(folder, pkmcal):
    """Runs a study of effects in this process; gives exit code, document and what was said."""
    return lambda *words: pkmcal("study", folder, *SCENARIO, *EFFECTS, *words, "--workers", "1")


def test_document_counts_passes_and_named_causes_and_the_same_command_goes_on(folder, studied):
    code, out, err = studied("--campaigns", 2, "--json")
    assert code == 0, err
    document = json.loads(out)
    assert document["schema"] == "pkmcal/study-effects/1"
    clean, scale = document["effects"]
    assert (clean["effect"], clean["estimator"]) == ("clean", "points")
    assert (clean["campaigns"], clean["wrong"], clean["named"]) == (2, 0, 2)
    assert (scale["passed"], scale["named"]) == (0, 2)
    assert scale["kinds"] == ["× 1.01", "× 0.995"]
    assert document["wrong_passes"] == {"points": {"wrong": 0, "campaigns": 4}}
    kept = json.loads((folder / "study" / "effects.json").read_text(encoding="utf-8"))
    assert kept == document
    table = folder / "study" / "effect-clean-plan-drawn-robots-points.jsonl"
    first = table.read_text(encoding="utf-8")
    code, out, err = studied("--campaigns", 3)
    assert 'How often is "pass" wrong?' in out
    assert "points: 0 wrong of 6 campaigns" in out
    assert table.read_text(encoding="utf-8").startswith(first)
    assert len(table.read_text(encoding="utf-8").splitlines()) == 1 + 3


def test_distances_are_studied_by_either_weights(studied):
    methods = ("--estimator", "distances", "--weights", "stated", "--weights", "equal")
    _, out, _ = studied("--campaigns", 2, "--json", *methods)
    told = [one["estimator"] for one in json.loads(out)["effects"]]
    assert told == ["distances", "distances, equal weights"] * 2


def test_choice_among_models_is_told_by_size_with_what_is_left(folder, pkmcal):
    """Two of each size: the 22 of perfect parts, more of coarse ones."""
    words = ["study", folder, *SCENARIO, "--effects", "imperfect-parts", "--campaigns", 7]
    words += ["--workers", "1", "--model", "standard", "--model", "auto"]
    standard, auto = pkmcal(*words, "--json").document["effects"]
    assert (standard["model"], auto["model"]) == ("standard", "auto")
    assert standard["kept"] == {"standard": 7}
    perfect, _, rods, _, _, _, both = auto["by_kind"]
    assert (perfect["kind"], perfect["kept"]) == ("none", {"standard": 1})
    assert rods["kept"].keys() <= {"rods", "full"}
    assert both["kind"] == "rods 0.2 mm, axes 2 mrad"
    assert both["kept"] == {"full": 1}
    assert both["position_mm"] < 0.3 * standard["by_kind"][-1]["position_mm"]
    told = pkmcal(*words).out
    kept = [line for line in told.splitlines() if ": kept " in line]
    begun = told.count("auto · ") - len(kept)
    assert begun == len(kept) == len(auto["by_kind"]), "labels may be broken, but not left out"
    assert kept[-1] == "auto · rods 0.2 mm, axes 2 mrad: kept full"
    assert "full 100" not in told, "one model alone needs no share"


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--effects", "gremlins"), "there is no effect gremlins"),
        (("--effects", "warmth=6O"), "--effects warmth=6O: sizes are numbers above 0"),
        (("--plot", "x.svg"), "--plot"),
    ],
)
def test_what_cannot_be_studied_is_refused(studied, words, said):
    code, out, err = studied("--campaigns", 2, *words)
    assert (code, out) == (2, "")
    assert said in err
