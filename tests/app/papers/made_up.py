"""Results as a run would give them, without one: every figure near what is asked."""

import numpy as np

from app.papers.corbel2006 import trials
from app.papers.corbel2006.printed import TABLE_II
from sim.scenarios.scenario import load_scenario

TABLE_I = dict(load_scenario("paper-simulation").robot.errors)

RECIPES = {experiment: experiment.recipe() for experiment in trials.EXPERIMENTS}


def stage(rng, size, **figures):
    """A validation whose figures are about as large as `size`."""
    lengths = rng.uniform(200.0, 600.0, 20)
    return trials.Stage(
        lengths_mm=tuple(lengths.tolist()),
        errors_mm=tuple((size * rng.uniform(0.5, 1.0, 20)).tolist()),
        **{
            "rotation_mm": size,
            "straightness_mm": {"x": size, "y": size, "z": size},
            "radius_mm": 0.37,
            "rp_mm": 0.45,
            "frame_mean_mm": size,
            "frame_max_mm": size,
        }
        | figures,
    )


def result(experiment: trials.Experiment, seed: int, **changes) -> trials.TrialResult:
    """One seed; `changes` replace whole fields."""
    rng = np.random.default_rng(seed)
    is_prototype = experiment is trials.PROTOTYPE
    true = TABLE_II if is_prototype else TABLE_I
    size = 0.1 if is_prototype else 0.01
    estimates = {
        name: trials.Estimate(
            true_error=error,
            estimated_error=error + 0.01 * size * float(rng.uniform(-1.0, 1.0)),
            std=0.01 * size,
        )
        for name, error in true.items()
    }
    pairs = trials.Errors(
        before_mm=tuple(rng.uniform(-9.0, 9.0, 60).tolist()),
        after_mm=tuple((size * rng.uniform(-1.0, 1.0, 60)).tolist()),
    )
    straight = {"x": 5.6, "y": 4.7, "z": 0.8}
    return trials.TrialResult(
        experiment=experiment.name,
        seed=seed,
        recipe=RECIPES[experiment],
        seconds=6.0,
        parameters=estimates,
        fitted=pairs,
        unseen=pairs,
        before=stage(rng, 18.0, rotation_mm=2.3, straightness_mm=straight),
        after=stage(rng, 0.3),
    ).model_copy(update=changes)


def results(seeds: int = 3) -> tuple[trials.TrialResult, ...]:
    """Every experiment's first seeds, in the order of a run."""
    return tuple(
        result(experiment, seed)
        for seed in range(1, seeds + 1)
        for experiment in trials.EXPERIMENTS
    )
