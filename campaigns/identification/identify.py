"""Identification: a robot's kinematics from measured shots, with its uncertainty and a verdict."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from functools import cache, partial

import numpy as np

from campaigns.arrays import Index
from campaigns.errors import ShotsInvalid
from campaigns.estimation.estimate import Estimate
from campaigns.estimation.estimators import Outliers
from campaigns.estimation.information import Uncertainty, WorkspaceSample, coverage_factor
from campaigns.estimation.observability import unobservable_combinations
from campaigns.evaluation import diagnostics, identification
from campaigns.evaluation.plausibility import check_shots
from campaigns.evaluation.region import Region
from campaigns.identification import result
from campaigns.identification.change import Tested, tested
from campaigns.identification.fit import Fit, PointFit, fit_shots, plain_fit, unknown_at
from campaigns.identification.hold_out import UnseenPairs, unseen_pairs
from campaigns.identification.known_lengths import KnownLengths, known_length_doubts, known_lengths
from campaigns.identification.nests import nest_doubts, stand_motion
from campaigns.identification.observations import Inputs, Observations
from campaigns.identification.options import IdentificationOptions
from campaigns.identification.parameter_selection import ParameterSelection
from campaigns.mechanisms.mechanism import Kinematics, KinematicSolution, NoSolution
from campaigns.mechanisms.parameters import ParameterSpace
from campaigns.shots.shot_sets import ShotSet
from campaigns.shots.shots import Shots

Fitted = tuple[
    Callable[[], result.IdentificationResult],
    Callable[[], result.IdentificationResult],
    Callable[[], Tested],
]
NO_EFFECT = 1e-6
"""What a lost combination may leave of its parameters' single effects to be a change of frame."""


def identify(
    nominal: Kinematics,
    shots: Shots,
    selection: ParameterSelection,
    options: IdentificationOptions | None = None,
) -> result.IdentificationResult:
    """Parameters from the identification shots, judged by the validation pairs.

    Raises `ShotsMissing` for too few shots, and `ShotsInvalid` for a covariance that is none and
    for shots that no robot explains.
    """
    _, tested_for_causes, _ = fitted(nominal, shots, selection, options)
    return tested_for_causes()


def fitted(
    nominal: Kinematics,
    shots: Shots,
    selection: ParameterSelection,
    options: IdentificationOptions | None = None,
) -> Fitted:
    """As `identify`: what models are compared by, and what tests all shots for causes too.

    The tests take nearly as long as the fit; without them doubts by causes and by changes lack.
    Last what they show, with what is worth a trial where nothing is significant.
    """
    options = options or IdentificationOptions()
    lengths = known_lengths(shots, options.known_lengths, options.instrument)
    stand = None if options.sessions else stand_motion(shots, options.instrument)
    shots = shots.on_robot()
    inputs = replace(Inputs.of(nominal, shots, selection, options), stand=stand)
    _check(inputs)
    constant: tuple[float, float] | None = None
    try:
        fit = fit_shots(inputs)
        if options.frees_reflector_constant:
            constant = unknown_at(fit.found, len(selection.free))
            inputs = replace(inputs, shots=shots.with_shorter_ranges(constant[0]))
            fit = fit_shots(inputs)
    except NoSolution as error:
        raise ShotsInvalid(
            "the shots lead to no robot that could be assembled",
            remedy="look for gross errors: order and signs of the joints, units of points and of "
            "covariances",
        ) from error
    held_out = unseen_pairs(inputs, fit)
    tests = cache(partial(_tested, inputs, fit, held_out))
    found = partial(_result, inputs, fit, held_out, lengths, constant)
    return (lambda: found((None, Tested())), cache(lambda: found(tests())), lambda: tests()[1])


def _tested(inputs: Inputs, fit: Fit, held_out: UnseenPairs) -> tuple[PointFit | None, Tested]:
    """Tests of all shots for causes, by a fit of points."""
    judged = fit.points
    if judged is None and inputs.options.outliers is not Outliers.KEEP:
        judged = plain_fit(inputs)  # also where coordinates take no part in the fit
    return judged, Tested() if judged is None else tested(inputs, judged, held_out.identified)


def _check(inputs: Inputs) -> None:
    """Refusal of shots that cannot be this robot's, those of each session for themselves."""
    shots, solution = inputs.shots, inputs.at_nominal
    known = shots.rows_of(ShotSet.IDENTIFICATION, ShotSet.VALIDATION)
    own = shots.session[known] if inputs.options.sessions else np.zeros(len(known))
    for each in np.unique(own).tolist():
        rows = known[own == each]
        modelled = KinematicSolution(solution.values[rows], solution.found[rows])
        check_shots(inputs.nominal, shots.rows(rows), "the shots", modelled=modelled)


def _result(
    inputs: Inputs,
    fit: Fit,
    held_out: UnseenPairs,
    lengths: KnownLengths | None,
    constant_mm: tuple[float, float] | None,
    tests: tuple[PointFit | None, Tested],
) -> result.IdentificationResult:
    """Findings of the fitted and the unseen shots, and of known lengths, together."""
    found, fitted, options = fit.found, fit.observations, inputs.options
    free, space = inputs.selection.free, inputs.nominal.mechanism.parameters
    instrument = options.instrument
    if lengths is not None:
        instrument = replace(instrument, scale=lengths.scale.scale_std(instrument.scale))
    uncertainty = fit.uncertainty(free, held_out.tested, instrument)
    identifiable = [free[place] for place in np.flatnonzero(found.identifiable).tolist()]
    covariance = Uncertainty() if uncertainty is None else uncertainty.only(identifiable)
    parameters = _parameters(inputs, found, covariance)
    ripples = _ripples(inputs, parameters)
    position_std, region = _positions(uncertainty, inputs, fit)
    errors, unseen = _residuals(fit), held_out.errors
    unobservable = tuple(unobservable_combinations(found.seen, free))
    is_sampled = options.workspace is not None and uncertainty is not None
    cannot_take_poses = is_sampled and position_std is None and not unobservable
    doubts = (
        *_doubts(inputs, fit, held_out, parameters, covariance, tests),
        *diagnostics.region_doubts(region),
        *([diagnostics.unknown_positions_doubt()] if cannot_take_poses else []),
        *known_length_doubts(lengths, options.known_lengths),
        *nest_doubts(inputs.stand, inputs.shots, errors.summary().after.rms),
        *([] if constant_mm is None else [diagnostics.reflector_told(*constant_mm)]),
    )
    outliers = fit.left_out.found if fit.left_out else found
    verdict, reasons, obstacles = identification.identification_verdict(
        identification.IdentificationEvidence(
            space=space,
            kind=fitted.kind,
            fit=found.fit,
            unobservable=unobservable,
            outliers=len(outliers.outliers) / len(outliers.kept),
            residuals=errors.summary(),
            std=covariance.std(),
            contradicted=tuple(_contradicted(found, free, space)),
            doubts=doubts,
            unseen=None if unseen is None else unseen.summary(),
            is_worse=unseen is not None
            and identification.worse_beyond_chance(
                unseen.before[:, 0], unseen.after[:, 0], held_out.tested
            ),
            lost=tuple(f"hold-out {each.what}: {each.reason}" for each in held_out.lost),
            region=None if region is None else region.says,
        )
    )
    scatter, noise = _robot_scatter(fit, inputs.nominal), fit.stated_noise
    says = identification.noise_in_words(
        noise,
        options.estimator,
        by_scatter=fit.points is None,
        robot="" if scatter is None else scatter.says,
    )
    frames = tuple(map(result.Frame.of, fitted.tracker_from_base(found.x)))
    by_data = unobservable_combinations(found.data_seen, free)
    return result.IdentificationResult(
        estimator=options.estimator,
        outliers=options.outliers,
        priors={**inputs.selection.priors},
        converged=found.fit.converged,
        message=found.fit.message,
        iterations=found.fit.evaluations,
        rank=found.seen.rank,
        condition=result.finite(found.seen.condition),
        dof=found.noise.dof,
        parameters=parameters,
        residuals_mm=errors.summary(),
        unseen_mm=None if unseen is None else unseen.summary(),
        fitted=errors,
        unseen=unseen,
        modelled=_modelled(inputs, fit, held_out),
        excluded=_excluded(inputs, fit) + held_out.unusable + held_out.lost,
        unobservable=unobservable,
        ripples=ripples,
        known_by_priors_alone=tuple(each for each in by_data if each not in unobservable),
        chi2=result.NoiseTest.of(noise, says),
        covariance=covariance,
        # Student's where the residuals tell their own variance, else normal
        coverage_factor_95=None if found.covariance is None else coverage_factor(fit.variance_dof),
        position_std_mm=position_std,
        region=region,
        known_lengths=lengths,
        robot_scatter=scatter,
        hold_out=held_out.tested,
        doubts=doubts,
        frame=frames[0] if frames else None,
        sessions=_sessions(inputs.shots, fitted, frames) if options.sessions else (),
        verdict=verdict,
        reasons=reasons,
        obstacles=obstacles,
    )


def _residuals(fit: Fit) -> result.ResidualTable:
    """Of what was fitted and kept."""
    fitted, kept = fit.observations, fit.found.kept
    numbers = tuple(np.array(fitted.numbers)[kept].tolist())
    before, after = fitted.nominal_misfits_mm(kept), fitted.misfits_mm(fit.found.x)[kept]
    return result.ResidualTable.from_arrays(fitted.kind, numbers, before, after)


def _kept_rows(fit: Fit) -> Index:
    """Rows of the fitted shots that were kept."""
    shots, numbers = fit.observations.shots, fit.observations.numbers
    return np.arange(len(shots)).reshape(len(numbers), -1)[fit.found.kept].ravel()


def _modelled(inputs: Inputs, fit: Fit, held_out: UnseenPairs) -> result.ModelledTable:
    """Shots that were fitted and kept, and those of the hold-out pairs, by both models."""
    counted = {fit.observations.shots.numbers[row] for row in _kept_rows(fit).tolist()}
    own = np.isin(inputs.shots.numbers, sorted(counted))
    rows = np.union1d(np.flatnonzero(own), held_out.rows.ravel())
    before, after = inputs.at_nominal.values[rows], held_out.identified.values[rows]
    return result.ModelledTable.of(inputs.shots.rows(rows), before, after)


def _contradicted(found: Estimate, free: tuple[str, ...], space: ParameterSpace) -> Iterator[str]:
    """Priors that the shots alone speak against."""
    units = space.units(free)
    for place, value, std, sigmas in found.conflicts:
        unit = units[place]
        yield (
            f"the shots contradict the prior of {free[place]}: they alone give "
            f"{value / unit:.4f} ± {std / unit:.4f}, {sigmas:.1f} σ off: leave it out or widen it"
        )


def _sessions(
    shots: Shots, fitted: Observations, frames: tuple[result.Frame, ...]
) -> tuple[result.SessionFrame, ...]:
    """Shots of each session by its own frame."""
    own, numbers = shots.session, np.array(shots.numbers)
    of_fit = np.unique(own[np.isin(numbers, fitted.shots.numbers)]).tolist()
    known = dict(zip(of_fit, frames, strict=True)) if frames else {}
    return tuple(
        result.SessionFrame(tuple(numbers[own == each].tolist()), known.get(each))
        for each in np.unique(own).tolist()
    )


def _excluded(inputs: Inputs, fit: Fit) -> tuple[result.Excluded, ...]:
    outliers = tuple(_named_outliers(fit.observations, fit.found))
    if fit.left_out is not None:
        pairs = dict(zip(inputs.shots.numbers, inputs.shots.pairs, strict=True))
        named = _named_outliers(fit.left_out.observations, fit.left_out.found)
        outliers += tuple(
            replace(each, pair=pairs[each.shot]) for each in named if each.shot is not None
        )
    return fit.observations.excluded + outliers


def _doubts(
    inputs: Inputs,
    fit: Fit,
    held_out: UnseenPairs,
    parameters: dict[str, result.IdentifiedParameter],
    covariance: Uncertainty,
    tests: tuple[PointFit | None, Tested],
) -> Iterator[diagnostics.Doubt]:
    """All that speak against the result, by name."""
    options, free = inputs.options, inputs.selection.free
    changes = {name: parameters[name].delta for name in free}
    yield from diagnostics.parameter_doubts(
        inputs.nominal.parameters, changes, covariance, options.tolerance, options.accepted
    )
    yield from diagnostics.noise_doubts(fit.stated_noise)
    hold_out, unseen = held_out.tested, held_out.errors
    met = unseen is not None and diagnostics.limits_met(unseen.summary().after, options.limits_mm)
    judged, told = tests
    if options.yielding:
        yield diagnostics.yielding_doubt(limits_met=met)
    if judged is not None:
        yield from _tested_doubts(inputs, judged, told, met=met)
    if hold_out is not None and not hold_out.believable:
        yield diagnostics.hold_out_doubt(hold_out.ratio, hold_out.p, hold_out.pairs, limits_met=met)


def _tested_doubts(
    inputs: Inputs, judged: PointFit, told: Tested, *, met: bool
) -> Iterator[diagnostics.Doubt]:
    """Doubts by all shots: changes in time, and what the model lacks."""
    space = inputs.nominal.mechanism.parameters
    if told.change is not None and told.between is not None:
        yield diagnostics.change_doubt(
            told.change, told.between, inputs.nominal.parameters, _play(inputs, judged, told)
        )
    if told.off_from is not None:
        yield diagnostics.late_doubt(*told.off_from)
    for pair in told.swapped:
        yield diagnostics.swapped_doubt(*pair)
    for lack in told.lacks:
        yield diagnostics.lack_doubt(lack, space, limits_met=met)


def _play(inputs: Inputs, judged: PointFit, told: Tested) -> float:
    """Largest lost motion of a gear that the shots show: as scatter, as a lack or fitted."""
    backlashes, free = inputs.nominal.mechanism.parameters.backlashes, inputs.selection.free
    values = zip(free, judged.found.x.tolist(), strict=False)
    lacking = (each.size for each in told.lacks if each.name == "backlash")
    found = [diagnostics.PLAY * judged.scatter.joint]
    found += [abs(value) for name, value in values if name in backlashes]
    found += [float(np.abs(size).max()) for size in lacking]
    return max(found)


def _robot_scatter(fit: Fit, nominal: Kinematics) -> result.RobotScatter | None:
    found, axis = fit.scatter, nominal.mechanism.joints[0]
    if not found.any:
        return None
    return result.RobotScatter(
        point_mm=found.point_mm,
        point_mm_std=found.point_mm_std,
        joint=axis.to_file(found.joint),
        joint_std=axis.to_file(found.joint_std),
        says=identification.scatter_in_words(found, axis.unit, axis.from_file(1.0)),
    )


def _parameters(
    inputs: Inputs, found: Estimate, uncertainty: Uncertainty
) -> dict[str, result.IdentifiedParameter]:
    """All of files, what is optional and not 0, and whatever else was free."""
    std, total = uncertainty.std(), uncertainty.total_std()
    free, known = inputs.selection.free, inputs.nominal.parameters
    old = known | dict.fromkeys((name for name in free if name not in known), 0.0)
    values = found.x[: len(free)] / inputs.nominal.mechanism.parameters.units(free)
    new = old | dict(zip(free, values.tolist(), strict=True))
    return {
        name: result.IdentifiedParameter(
            nominal=old[name],
            value=new[name],
            std=std.get(name),
            free=name in free,
            total_std=total.get(name),
        )
        for name in old
    }


def _ripples(
    inputs: Inputs, found: Mapping[str, result.IdentifiedParameter]
) -> result.RippleRate | None:
    """How often ripples come, where any were found."""
    mechanism = inputs.nominal.mechanism
    space, rate = mechanism.parameters, mechanism.rate
    if not rate or not any(space[name].is_ripple and each.value for name, each in found.items()):
        return None
    return result.RippleRate(space.rate.name, rate)


def _named_outliers(fitted: Observations, found: Estimate) -> Iterator[result.Excluded]:
    """With the size of their misfits to what the others say."""
    misfits = np.linalg.norm(fitted.misfits_mm(found.x), axis=1)
    for block, size, limit in found.outliers:
        size_mm = float(misfits[block])
        reason = f"{size_mm:.3f} mm off what the others say: {size:.1f} σ, limit {limit:.1f} σ"
        yield replace(
            fitted.excluded_for(block, reason), size_mm=size_mm, size_sigma=size, limit_sigma=limit
        )


def _positions(
    known: Uncertainty | None, inputs: Inputs, fit: Fit
) -> tuple[result.PositionStd | None, Region | None]:
    """Uncertainty of positions over the workspace, and the part of it that was measured.

    After a best fit of the frame to all of its poses, and to the shots. None when not known.
    A combination that is held at nominal must change the frame and nothing else. Nor is it known of
    a robot that can take hardly any of the poses.
    """
    poses, found, model = inputs.options.workspace, fit.found, fit.observations.model
    if known is None or poses is None:
        return None, None
    x = found.x[: len(inputs.selection.free)]
    identified = model.kinematics(x)
    sample = WorkspaceSample.of_workspace(identified, known.names, poses)
    if sample is None:
        return None, None
    taken, at_shots = sample.poses, model.poses(x)[_kept_rows(fit)]
    try:
        both = np.vstack([taken, at_shots])
        by_shots = WorkspaceSample.of(identified, known.names, both, slice(len(taken), None))
    except NoSolution:
        return None, None
    jacobian = sample.jacobian / identified.mechanism.parameters.units(known.names)
    for lost in found.seen.null_directions / found.seen.scale:
        if np.abs(jacobian @ lost).max() > NO_EFFECT * (np.abs(jacobian) @ np.abs(lost)).max():
            return None, None
    std_mm = known.random.of_positions(by_shots)
    task = identified.mechanism.task
    region = Region.of(taken, std_mm[: len(taken)], std_mm[len(taken) :], task)
    return result.PositionStd.of(known, sample), region
