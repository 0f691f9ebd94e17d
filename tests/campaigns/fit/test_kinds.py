"""Kinds of observation: rows and derivatives by differences, and sums over rows of any kind."""

from dataclasses import replace

import numpy as np
import pytest
from remembered import remembered
from scipy.spatial.transform import Rotation
from small_fits import FRAME, STATED_MM, model_of, observed

from campaigns.fit import predicted_rows
from campaigns.fit.effects import Ripple, Walk
from campaigns.fit.error_model import moved_frames
from campaigns.fit.events import candidate_parts
from campaigns.fit.fit import (
    Prior,
    _from_nominal,
    estimate_sizes_and_noise,
    fit_model,
    log_evidence,
    update_weights,
)
from campaigns.fit.kinds import KINDS, TURN_LEVER_MM, Block, Bodies, differentiate
from campaigns.fit.predicted_rows import predict_block
from campaigns.fit.slots import FLAT_MM, FLAT_RAD, Slot
from campaigns.fit.uncertainty import budget, length_std, null_directions, without_frame

MIDDLE = FRAME.translation_mm
PLACE = (20.0, -5.0, 40.0), (5.0, 5.0, 5.0)
SLOTS = {
    "plane": ((1e-3, -2e-3, -700.0), (FLAT_RAD, FLAT_RAD, FLAT_MM)),
    "shrinkage": ((0.002,), (0.003,)),
    "place": PLACE,
    "height": ((30.0,), (0.01,)),
    "centre": ((10.0, 20.0, -900.0), (FLAT_MM,) * 3),
    "length": ((200.0,), (0.001,)),
    "frame": ((5.0, -8.0, -700.0, 0.1, -0.2, 0.3), (FLAT_MM,) * 3 + (FLAT_RAD,) * 3),
    "seat": ((80.0, 20.0, 5.0), (0.01,) * 3),
    "tip": PLACE,
    "axis": ((0.6, 0.8, 0.0), (0.01,) * 3),
    "face": ((0.01, -0.02, 30.0), (FLAT_RAD, FLAT_RAD, FLAT_MM)),
    "gravity": ((0.01, -0.02), (FLAT_RAD,) * 2),
    "turn": ((0.3, -0.2, 0.9), (FLAT_RAD,) * 3),
}


def slots_of(kind):
    """The slots that a kind takes, of one object and what it stands on."""
    return tuple(
        Slot("base" if slot.of_support else "thing", slot.name, *SLOTS[slot.name])
        for slot in KINDS[kind].slots
    )


def starts_of(kind):
    return np.concatenate([slot.start for slot in slots_of(kind)])


def block_of(kind, observations, *, parts=None, values=None, std_mm=STATED_MM):
    """A block of a kind at the joints of observations; of two bodies one at the next row's."""
    kind, count = KINDS[kind], len(observations)
    rows = [np.roll(np.arange(count), -place % kind.poses) for place in range(kind.bodies)]
    width = kind.width
    return Block(
        kind=kind,
        name="thing",
        parts=parts or (None,) * kind.bodies,
        joints=np.stack([observations.joints[row] for row in rows], axis=1),
        near=np.stack([observations.near[row] for row in rows], axis=1),
        values=np.zeros((count, len(kind.columns))) if values is None else values,
        stated=np.broadcast_to(std_mm**2 * np.eye(width), (count, width, width)),
        slots=tuple(slot.name for slot in slots_of(kind.name)),
        frame=observations.frame,
    )


def drawn(count=5, seed=1):
    rng = np.random.default_rng(seed)
    places = rng.uniform(-200.0, 200.0, (2, count, 3))
    axes = Rotation.from_rotvec(rng.normal(size=(2 * count, 3))).as_matrix()
    return [
        Bodies(place, of) for place, of in zip(places, axes.reshape(2, count, 3, 3), strict=True)
    ]


@pytest.mark.parametrize("name", KINDS)
def test_derivatives_are_those_of_differences(name):
    kind, bodies, slots = KINDS[name], drawn(), starts_of(name)
    bodies = bodies[: kind.bodies]
    values = np.random.default_rng(2).uniform(-0.5, 0.5, (5, len(kind.columns)))
    found, step = differentiate(kind, values, bodies, slots), 1e-5
    assert found.residual == pytest.approx(kind.rows(values, bodies, slots[None]))

    def difference(moved):
        ahead, behind = (kind.rows(values, *moved(sign * step)) for sign in (1.0, -1.0))
        return (ahead - behind) / (2.0 * step)

    for number in range(kind.bodies):
        for axis, unit in enumerate(np.eye(3)):

            def shifted(by, number=number, unit=unit):
                others = list(bodies)
                others[number] = replace(bodies[number], place=bodies[number].place + by * unit)
                return others, slots[None]

            def turned(by, number=number, unit=unit):
                others, turn = list(bodies), Rotation.from_rotvec(by * unit).as_matrix()
                others[number] = replace(bodies[number], axes=turn @ bodies[number].axes)
                return others, slots[None]

            by_place, by_turn = found.by_place[number][..., axis], found.by_turn[number][..., axis]
            assert by_place == pytest.approx(difference(shifted), abs=1e-6)
            assert by_turn == pytest.approx(difference(turned), rel=1e-5, abs=1e-4)
    for place, unit in enumerate(np.eye(len(slots))):
        by_slot = difference(lambda by, unit=unit: (bodies, (slots + by * unit)[None]))
        assert found.by_slots[..., place] == pytest.approx(by_slot, rel=1e-5, abs=1e-4)
    for place, unit in enumerate(1e-5 * np.eye(values.shape[1])):
        ahead, behind = (kind.rows(values + by, bodies, slots[None]) for by in (unit, -unit))
        by_value = (ahead - behind) / 2e-5
        assert found.by_values[..., place] == pytest.approx(by_value, rel=1e-5, abs=1e-4)


def test_rows_are_what_instruments_measure():
    first, second = drawn()
    a, b, c = 0.1, -0.2, 30.0
    normal = np.array([-a, -b, 1.0]) / np.linalg.norm([-a, -b, 1.0])
    heights = (first.place - [0.0, 0.0, c]) @ normal
    rows = KINDS["height"].rows(np.zeros((5, 1)), [first], np.array([[a, b, c]]))
    assert rows[:, 0] == pytest.approx(heights)
    apart = np.linalg.norm(first.place - second.place, axis=1)
    rows = KINDS["distance"].rows(np.full((5, 1), 2.0), [first, second], np.array([[0.003]]))
    assert rows[:, 0] == pytest.approx(0.997 * apart - 2.0)
    place, tool = np.array([10.0, 20.0, 30.0]), Rotation.from_rotvec([0.3, -0.2, 0.9])
    points = first.place + first.axes @ place
    rows = KINDS["reflector"].rows(points - [0.0, 0.0, 1.0], [first], place[None])
    assert rows == pytest.approx(np.tile([0.0, 0.0, 1.0], (5, 1)))
    # the probe turned by 1 mrad about x from where it was measured
    turned = Rotation.from_matrix(first.axes) * tool
    measured = (Rotation.from_rotvec([-1e-3, 0.0, 0.0]) * turned).as_rotvec()
    slots = np.r_[place, tool.as_rotvec()][None]
    rows = KINDS["probe"].rows(np.hstack([points, measured]), [first], slots)
    expected = np.array([0.0, 0.0, 0.0, 1e-3 * TURN_LEVER_MM, 0.0, 0.0])
    assert rows == pytest.approx(np.tile(expected, (5, 1)), abs=1e-6)


def test_rows_of_balls_nests_and_gauges_are_what_they_measure():
    body, other = drawn()
    place, turned = np.array([10.0, 20.0, 30.0]), Rotation.from_rotvec([0.3, -0.2, 0.9])
    tips = np.stack([r @ place + x for r, x in zip(body.axes, body.place, strict=True)])
    above = KINDS["block"].rows(np.full((5, 1), 0.5), [body], np.array([[0.0, 0.0, 7.0, 30.0]]))
    assert above[:, 0] == pytest.approx(body.place[:, 2] - 37.5)
    slots = np.r_[place, 2.0 * place][None]
    twice = np.stack([r @ (2 * place) + x for r, x in zip(other.axes, other.place, strict=True)])
    rows = KINDS["reflectors"].rows(np.hstack([tips, twice - 1.0]), [body, other], slots)
    assert rows == pytest.approx(np.tile([0.0, 0.0, 0.0, 1.0, 1.0, 1.0], (5, 1)))
    once = np.stack([r @ place + x for r, x in zip(other.axes, other.place, strict=True)])
    # in whatever frame the tracker is
    seen = np.hstack([FRAME.apply(tips), FRAME.apply(once)])
    assert KINDS["span"].rows(seen, [body, other], place[None]) == pytest.approx(0.0, abs=1e-9)
    centre = np.array([50.0, -20.0, 400.0])
    reading = np.linalg.norm(tips - centre, axis=1)[:, None] - 250.0
    slots = np.r_[centre, place, 250.0][None]
    assert KINDS["ball-bar"].rows(reading, [body], slots) == pytest.approx(0.0, abs=1e-9)
    beyond = turned.inv().apply(body.place - centre) - place
    slots = np.r_[centre, turned.as_rotvec(), place][None]
    assert KINDS["place"].rows(beyond, [body], slots) == pytest.approx(0.0, abs=1e-9)


def test_a_gauge_is_pressed_in_by_as_much_as_it_is_beyond_the_face():
    """The plunger's way along itself from a plane through three points of the face."""
    body, _ = drawn()
    axis, tip, a, b, c = np.array([0.0, 1.0, 0.0]), np.array([5.0, 8.0, -3.0]), 0.05, -0.1, 12.0
    level = Rotation.from_rotvec(0.1 * Rotation.from_matrix(body.axes).as_rotvec())
    body = replace(body, axes=level.as_matrix())
    slots = np.r_[a, b, c, axis, tip][None]
    rows = KINDS["edge"].rows(np.zeros((5, 1)), [body], slots)[:, 0]
    surface = body.place + level.apply(tip) - rows[:, None] * level.apply(axis)
    # all five points are on one plane across the axis
    normal = np.linalg.svd(surface - surface.mean(axis=0))[2][2]
    assert (surface - surface.mean(axis=0)) @ normal == pytest.approx(0.0, abs=1e-9)
    assert abs(normal @ axis) == pytest.approx(1.0 / np.sqrt(1.0 + a * a + b * b))
    pressed = replace(body, place=body.place + level.apply(0.25 * axis))
    more = KINDS["edge"].rows(np.zeros((5, 1)), [pressed], slots)[:, 0]
    assert more - rows == pytest.approx(0.25)


def test_an_inclinometer_reads_how_far_it_was_turned_from_level():
    mounting, gravity = Rotation.from_rotvec([0.2, -0.1, 1.3]), np.array([0.02, -0.01, 1.0])
    upright, _ = Rotation.align_vectors([gravity], [[0.0, 0.0, 1.0]])
    slots = np.r_[gravity[:2], mounting.as_rotvec()][None]
    for tilt in ([0.05, 0.0, 0.0], [0.0, -0.08, 0.0]):
        sensor = upright * Rotation.from_euler("z", 0.7) * Rotation.from_rotvec(tilt)
        body = Bodies(np.zeros((1, 3)), (sensor * mounting.inv()).as_matrix()[None])
        rows = KINDS["inclinometer"].rows(np.array([tilt[:2]]), [body], slots)
        assert rows == pytest.approx(0.0, abs=1e-9)


CASES = [
    ("linear-delta", "height", None),
    ("delta", "distance", None),
    ("par4-prototype", "reflector", (1,)),
    ("par4-prototype", "reflector", (2,)),
    ("par4-prototype", "probe", None),
    ("par4-prototype", "probe", (2,)),
    ("hexapod", "probe", None),
    ("linear-delta", "block", None),
    ("par4-prototype", "reflectors", (1, 2)),
    ("hexapod", "reflectors", None),
    ("hexapod", "span", None),
    ("hexapod", "ball-bar", None),
    ("hexapod", "place", None),
    ("hexapod", "edge", None),
    ("hexapod", "inclinometer", None),
]


ASSEMBLED = remembered(predicted_rows._assembled)


def assembled_once(model, *at):
    """Kinds see the same bodies of a robot, whose own unknowns and joints are equal."""
    return ASSEMBLED(model.with_effects(()), *at)


@pytest.mark.parametrize(("name", "kind", "parts"), CASES)
def test_columns_of_a_block_are_those_of_differences(name, kind, parts, monkeypatch):
    monkeypatch.setattr(predicted_rows, "_assembled", assembled_once)
    model = model_of(name, effects=slots_of(kind))
    rng = np.random.default_rng(3)
    x = 0.3 * rng.normal(size=model.size)
    block = block_of(kind, observed(model.with_effects(()), 6), parts=parts)
    values = rng.uniform(-0.2, 0.2, block.values.shape)
    for point in KINDS[kind].points:
        values[:, point] += FRAME.translation_mm + 100.0 * rng.normal(size=(6, 3))
    block = replace(block, values=values)
    x[-len(starts_of(kind)) :] *= 1e-3
    at = predict_block(model, x, (FRAME,), block, MIDDLE)
    step, size = 1e-4, model.size
    for place in range(size + 6 * KINDS[kind].by_tracker):
        change = np.zeros(size + 6)
        change[place] = step
        frames = moved_frames((FRAME,), change[size:])
        moved = predict_block(model, x + change[:size], frames, block, MIDDLE)
        expected = (moved.residual - at.residual) / step
        # rods that do not close and the weight's loads are left out of derivatives of a Par4
        scale = np.abs(expected).max(initial=1e-3)
        assert at.jacobian[..., place] == pytest.approx(expected, rel=0.02, abs=0.02 * scale)


def effects_of(model):
    """A stand that walks and is bumped, a part that changes, gears that ripple, a late reading."""
    parts = candidate_parts(model)
    encoder = replace(parts["encoder 1"], since=2.0)
    mount = replace(parts["mount 0"], since=1.0, until=4.0)
    bump = replace(parts["frame"], since=3.0)
    return (Walk(0), encoder, mount, bump, Ripple((0, 2), 9.0, 0.1, 1e-3, 0.0))


@pytest.mark.parametrize(("name", "kind", "parts"), CASES[1:])
def test_rows_have_the_effects_of_their_moment(name, kind, parts):
    """By differences, and rows of no moment are those of the robot after all that lasts."""
    bare = model_of(name, with_growth=True)
    model = bare.with_effects((*effects_of(bare), *slots_of(kind)))
    rng, size = np.random.default_rng(4), model.size
    block = block_of(kind, observed(model_of(name), 6), parts=parts)
    values = rng.uniform(-0.2, 0.2, block.values.shape)
    values[:, :3] += FRAME.translation_mm[: values[:, :3].shape[1]]
    timed = {"moment": np.arange(6.0), "time": np.arange(6.0) / 5.0, "warmth": np.arange(6.0)}
    block = replace(block, values=values, **timed)
    x = 0.1 * rng.normal(size=size)
    x[-len(starts_of(kind)) :] *= 1e-3
    at = predict_block(model, x, (FRAME,), block, MIDDLE)
    growth = [place for place, group in enumerate(model.groups) if group == "growth"]
    # parts that grow shift a body and do not turn it
    assert at.jacobian[..., growth].any() == (kind != "inclinometer")
    for places in (growth, *model.effect_places):
        change = np.zeros(size)
        change[places] = 1e-4 * rng.normal(size=len(change[places]))
        moved = predict_block(model, x + change, (FRAME,), block, MIDDLE)
        expected = moved.residual - at.residual
        scale = np.abs(expected).max(initial=1e-7)
        assert at.jacobian[..., :size] @ change == pytest.approx(expected, abs=0.02 * scale)
    today = replace(block, moment=np.full(6, np.inf))
    lasting, shape = predict_block(model, x, (FRAME,), today, MIDDLE), (6, -1)
    assert lasting.jacobian[..., model.effect_places[2]] == pytest.approx(0.0)  # was taken back
    encoder = model.effect_places[1]
    assert np.abs(lasting.jacobian[..., encoder]).reshape(shape).max(axis=1).min() > 0.0
    assert at.jacobian[:2, :, encoder] == pytest.approx(0.0)
    assert lasting.jacobian[..., model.effect_places[0]] == pytest.approx(0.0)  # no stand's walk


def test_bodies_at_one_shot_share_the_robots_scatter():
    """Two points of one shot move together, so that their distance has no scatter."""
    model = model_of("delta", effects=slots_of("distance"))
    observations = observed(model.with_effects(()), 6)
    block = block_of("distance", observations)
    x = np.zeros(model.size)
    apart = predict_block(model, x, (), block, MIDDLE).noise["points"]
    assert apart[:, 0, 0] == pytest.approx(2.0 * 0.5**2 * (1.0 - 0.002) ** 2)
    joints, near = (np.repeat(v[:, :1], 2, axis=1) for v in (block.joints, block.near))
    together = replace(block, joints=joints, near=near, kind=replace(block.kind, rows=_differences))
    assert predict_block(model, x, (), together, MIDDLE).noise["points"] == pytest.approx(
        0.0, abs=1e-12
    )


def _differences(values, bodies, slots):
    return bodies[1].place[..., :1] - bodies[0].place[..., :1] - values + 0.0 * slots


# --- sums over rows of any kind -------------------------------------------------------------------

KNOWN = Slot("holder", "place", (0.0, 0.0, 0.0), (1e-9, 1e-9, 1e-9))


@pytest.fixture(scope="module")
def halves():
    """A fit of points, and one of the first half of them with the others as reflectors."""
    truth = model_of("delta", "places", "offsets", "lengths", "constant", "transit")
    x = 0.5 * np.random.default_rng(5).normal(size=len(truth.names))
    whole = observed(truth, 40, x=x)
    first, second = (whole.rows(np.arange(a, a + 20)) for a in (0, 20))
    block = replace(block_of("reflector", second, values=second.points), slots=("place of holder",))
    both = replace(first, blocks=(block,))
    model = truth.with_effects((KNOWN,))
    return fit_model(truth, whole), fit_model(model, both)


def without_slots(fit, matrix):
    """Rows and columns of a matrix without those of slots."""
    size = len(fit.model.names)
    kept = np.r_[np.arange(size), np.arange(fit.model.size, len(fit.inverse))]
    return matrix[np.ix_(kept, kept)]


def test_points_are_equal_to_reflectors_at_a_known_place(halves):
    points, mixed = halves
    assert (points.has_converged, mixed.has_converged) == (True, True)
    # the share of wrong rows is estimated of each kind by itself, and a fit ends within 0.1 σ
    assert np.abs((mixed.x - points.x) / points.std).max() < 0.1
    assert mixed.std == pytest.approx(points.std, rel=0.02)
    assert mixed.factors == pytest.approx(points.factors, rel=0.1, abs=1e-5)
    # at the same unknowns, weights, sizes and noise all sums are equal
    at = mixed.model.predict(
        np.r_[points.at.x, np.zeros(3)], points.at.frames, mixed.observations,
        mixed.observations.near,
    )  # fmt: skip
    rows = slice(None, 20)
    noise = {part: v[rows] for part, v in points.noise.items()}
    same = replace(
        mixed, at=at, noise=noise, good=points.good[rows], good_of_others=(points.good[20:],),
        sizes=points.sizes, factors=points.factors,
    )  # fmt: skip
    assert without_slots(same, same.normal[0]) == pytest.approx(points.normal[0], rel=1e-9)
    assert without_slots(same, same.inverse) == pytest.approx(points.inverse, rel=1e-6, abs=1e-7)
    assert same.objective == pytest.approx(points.objective, rel=1e-9)
    assert same.freedom == pytest.approx(points.freedom, rel=1e-9)
    assert same.gain == pytest.approx(points.gain, rel=1e-5, abs=1e-9)
    again, before = (estimate_sizes_and_noise(fit, 1) for fit in (same, points))
    assert again.factors == pytest.approx(before.factors, rel=1e-6)
    assert again.sizes == pytest.approx(before.sizes, rel=1e-6)
    by = np.random.default_rng(1).normal(size=(7, 3, points.model.size))
    wide = np.concatenate([by, np.zeros((7, 3, 3))], axis=2)
    shares = budget(same, wide)
    assert {part: shares[part] for part in budget(points, by)} == pytest.approx(
        budget(points, by), rel=1e-6
    )
    covariance = same.covariance[: same.model.size, : same.model.size]
    total = (length_std(wide, covariance) ** 2).mean()
    assert sum(shares.values()) == pytest.approx(total, rel=1e-9)


def test_scatter_that_rows_share_has_its_share_in_the_budget():
    """Two reflectors at one pose scatter together: of their six rows in three directions alone."""
    bare = model_of("hexapod", "places")
    model = bare.with_effects(slots_of("reflectors"))
    block = block_of("reflectors", observed(bare, 12, seed=2))
    block = replace(block, values=np.tile(FRAME.translation_mm, (12, 2)))
    at = predict_block(model, np.zeros(model.size), (FRAME,), block, MIDDLE)
    block = replace(block, values=block.values + at.residual)
    fit = fit_model(model, replace(observed(bare), blocks=(block,)))
    fit = replace(fit, factors={**fit.factors, "points": 1.0, "joints": 1.0})
    by = np.random.default_rng(1).normal(size=(7, 3, model.size))
    total = (length_std(by, fit.covariance[: model.size, : model.size]) ** 2).mean()
    assert sum(budget(fit, by).values()) == pytest.approx(total, rel=1e-9)


def test_evidence_counts_rows_of_all_kinds(halves):
    """One more row of either kind that fits as all do changes the evidence by as much."""
    points, mixed = halves
    assert np.isfinite(log_evidence(mixed))
    wrong = mixed.good_of_others[0].copy()
    wrong[3] = 0.0
    left_out = replace(mixed, good_of_others=(wrong,))
    of_points = points.good.copy()
    of_points[23] = 0.0
    fall = log_evidence(mixed) - log_evidence(left_out)
    assert fall == pytest.approx(
        log_evidence(points) - log_evidence(replace(points, good=of_points)), rel=0.2
    )


def bed_campaign(seed=1, *, wrong=(), count=37):
    """Heights of a linear delta over an unknown plane, touched with a scatter of 10 µm."""
    model = model_of("linear-delta", "offsets", "lengths")
    rng = np.random.default_rng(seed)
    x = 0.5 * rng.normal(size=len(model.names))
    observations = observed(model, count, seed=seed, x=x, noise_mm=0.0)
    poses = observations.near.copy()
    poses[:, 2] = 0.5 * (poses[:, 2].min() + poses[:, 2].max())
    nominal = model.nominal
    joints = nominal.inverse(poses).values_or_raise()
    touched = model.kinematics(x).forward(joints, poses).values_or_raise()[:, :3]
    a, b, c = 1e-3, -2e-3, float(poses[0, 2])
    heights = (touched[:, 2] - a * touched[:, 0] - b * touched[:, 1] - c) / np.sqrt(
        1 + a * a + b * b
    )
    heights += 0.01 * rng.normal(size=count)
    for row in wrong:
        heights[row] += 1.5
    block = block_of("height", replace(observations, joints=joints, near=poses))
    slot = Slot("bed", "plane", (0.0, 0.0, c), (FLAT_RAD, FLAT_RAD, FLAT_MM))
    block = replace(block, values=heights[:, None], slots=("plane of bed",))
    alone = replace(observations.rows(np.zeros(0, dtype=int)), blocks=(block,))
    return model.with_effects((slot,)), alone, x, (a, b, c)


def test_heights_alone_are_fitted_without_points_and_frames():
    model, observations, x, plane = bed_campaign()
    fit = fit_model(model, observations)
    assert fit.has_converged
    assert fit.at.frames == ()
    at = fit.at.others[0].residual
    assert 0.003 < at.std() < 0.015
    # the plane's slopes are no unknowns of the robot: a tilted robot on a level bed is the same
    (slot,), (where,) = model.effects, model.effect_places
    assert slot.values(fit.at.x[where])[2] == pytest.approx(plane[2], abs=3.0)
    assert null_directions(fit).vectors.shape[1] > 0
    assert np.abs((fit.x - x) / fit.std).max() < 4.0


def test_heights_over_an_unknown_plane_do_not_determine_the_height_of_the_base():
    model, observations, _, _ = bed_campaign()
    null = null_directions(fit_model(model, observations)).vectors
    of_offsets = np.array([group == "offsets" for group in model.groups]) / np.sqrt(3.0)
    assert np.linalg.norm(null.T @ of_offsets) == pytest.approx(1.0, abs=1e-4)


def test_a_wrong_height_is_found_and_left_out():
    model, observations, _, _ = bed_campaign(wrong=(5, 20))
    fit = fit_model(model, observations)
    (good,) = fit.good_of_others
    assert (np.flatnonzero(good < 0.5)).tolist() == [5, 20]
    # the weights rest on the rows themselves: all good ones count
    again, _ = update_weights(fit)
    assert again.good_of_others[0] == pytest.approx(good, abs=0.02)


def test_reflectors_place_the_frame_of_a_tracker_without_points():
    model, observations, _, _ = bed_campaign()
    plain = model.with_effects(())
    seen = observed(plain, 24)
    place = np.array([20.0, -5.0, 40.0])
    points = FRAME.apply(seen.near[:, :3] + place)  # the axes of a level plate are the base's
    points[5] += 30.0  # far off: the first steps do without it
    block = block_of("reflector", seen, values=points)
    start = _from_nominal(model.with_effects(slots_of("reflector")), replace(
        observations, blocks=(block,)), Prior())  # fmt: skip
    assert start.good_of_others[0].tolist() == [1.0] * 5 + [0.0] + [1.0] * 18
    (frame,) = start.at.frames
    assert frame.rotation == pytest.approx(FRAME.rotation, abs=1e-6)
    assert frame.translation_mm == pytest.approx(FRAME.translation_mm, abs=1e-3)
    fit = fit_model(start.model, start.observations)
    assert fit.has_converged
    two = replace(observations, blocks=(block.rows(np.arange(2)),))
    with pytest.raises(ValueError, match="points"):
        fit_model(start.model, two)


def test_heights_help_points():
    model, observations, x, _ = bed_campaign()
    plain = model.with_effects(())
    points = observed(plain, 12, x=x, seed=3)
    alone = fit_model(plain, points)
    both = fit_model(model, replace(points, blocks=observations.blocks))
    stds = []
    for fit in (alone, both):
        poses = observed(plain, 30, seed=9)
        by = fit.model.robot_at(fit.at.x, poses, poses.near)
        size = fit.model.size
        by = without_frame(by.by, by.assembly.points)
        stds.append(length_std(by, fit.covariance[:size, :size]).mean())
    assert stds[1] < 0.95 * stds[0]
