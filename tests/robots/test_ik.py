"""Inverse kinematics: every answer is checked by pinocchio, the number of answers by dense searches."""

from __future__ import annotations

import sysconfig
from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from kumitate.errors import InputError
from kumitate.robots import library
from kumitate.robots.chain import Chain
from kumitate.robots.ik import IKSolutions, make_solver, solve_ik, track
from kumitate.robots.ik_newton import is_at, newton, pose_error
from kumitate.transforms import compose, rotation_about

LIBRARY = Path(library.__file__).parent
EXAMPLES = Path(sysconfig.get_path("purelib"), "cmeel.prefix/share/example-robot-data/robots")
ARMS = {
    "ur3": (EXAMPLES / "ur_description/urdf/ur3_robot.urdf", "", "tool0"),
    "ur3_dual": (LIBRARY / "ur3_dual.urdf", "right_", "right_flange"),
    "nextage_left": (LIBRARY / "nextage.urdf", "LARM_", "left_flange"),
    "nextage_right": (LIBRARY / "nextage.urdf", "RARM_", "right_flange"),
    "hrp5p": (LIBRARY / "hrp5p.urdf", "left_", "left_flange"),
    "panda": (EXAMPLES / "panda_description/urdf/panda.urdf", "panda_joint", "panda_hand_tcp"),
}
Model = tuple[pin.Model, str]


def load(name: str) -> tuple[Model, Chain]:
    """The model with its tip frame, and the chain, with angles of at most half a turn."""
    path, prefix, tip = ARMS[name]
    model = pin.buildModelFromUrdf(str(path))
    chain = Chain.from_model(model, [joint for joint in model.names[1:] if joint.startswith(prefix)], tip)
    chain = replace(chain, lower=np.maximum(chain.lower, -np.pi), upper=np.minimum(chain.upper, np.pi))
    return (model, tip), chain


def from_lines(axes: np.ndarray, points: np.ndarray, rng: np.random.Generator) -> tuple[Model, Chain]:
    """An arm with these joint lines at zero, random joint frames, base and tip, and limits of half a turn."""
    model = pin.Model()
    base, tip = pin.SE3.Random(), pin.SE3.Random()
    frames = [pin.SE3(pin.SE3.Random().rotation, point) for point in points]
    for i, frame in enumerate(frames):
        placement = frames[i - 1].actInv(frame) if i else base * frame
        axis = frame.rotation.T @ axes[i]
        model.addJoint(i, pin.JointModelRevoluteUnaligned(axis / np.linalg.norm(axis)), placement, f"joint{i}")
    model.lowerPositionLimit[:], model.upperPositionLimit[:] = -np.pi, np.pi
    model.addFrame(pin.Frame("tip", len(points), 0, tip, pin.FrameType.OP_FRAME))
    return (model, "tip"), Chain.from_model(model, list(model.names)[1:], "tip")


def parallel_arm(seed: int) -> tuple[Model, Chain]:
    """A random arm with three parallel joints, any way round, and a crossing of the last two; nothing square."""
    rng = np.random.default_rng(seed)
    pin.seed(seed)
    axes = rng.normal(size=(6, 3))
    axes[2], axes[3] = axes[1] * rng.choice([-1, 1]), axes[1] * rng.choice([-1, 1])
    axes /= np.linalg.norm(axes, axis=1)[:, None]
    points = rng.uniform(-0.4, 0.4, (6, 3))
    points[5] = points[4] + rng.uniform(-1, 1) * axes[4] + rng.uniform(-1, 1) * axes[5]
    return from_lines(axes, points, rng)


def crossing_arm(seed: int) -> tuple[Model, Chain]:
    """A random arm with two parallel joints and a crossing of the fourth and fifth; nothing square."""
    rng = np.random.default_rng(seed)
    pin.seed(seed)
    axes = rng.normal(size=(6, 3))
    axes[2] = axes[1] * rng.choice([-1, 1])
    axes /= np.linalg.norm(axes, axis=1)[:, None]
    points = rng.uniform(-0.4, 0.4, (6, 3))
    points[4] = points[3] + rng.uniform(-1, 1) * axes[3] + rng.uniform(-1, 1) * axes[4]
    return from_lines(axes, points, rng)


MADE = {"parallel": parallel_arm, "crossing": crossing_arm}


def any_arm(name: str) -> tuple[Model, Chain]:
    """A shipped arm by its name, or a made one as "parallel 3"."""
    if name in ARMS:
        return load(name)
    kind, seed = name.split()
    return MADE[kind](int(seed))


def assert_holds(model: Model, chain: Chain, solutions: IKSolutions, targets: np.ndarray) -> None:
    """Pinocchio puts every answer at its target, within the limits, and no answer is given twice."""
    robot, tip = model
    data, frame = robot.createData(), robot.getFrameId(tip)
    index = [robot.joints[robot.getJointId(name)].idx_q for name in chain.names]
    for q, target in zip(solutions.q, solutions.target, strict=True):
        whole = pin.neutral(robot)
        whole[index] = q
        pin.framesForwardKinematics(robot, data, whole)
        error = data.oMf[frame].actInv(pin.SE3(targets[target]))
        assert np.linalg.norm(error.translation) < 1.001e-6
        assert np.linalg.norm(pin.log3(error.rotation)) < 1.001e-6
    assert ((solutions.q >= chain.lower) & (solutions.q <= chain.upper)).all()
    assert (np.diff(solutions.target) >= 0).all()
    for i in range(solutions.n_targets):
        q = solutions.of(i)
        apart = np.abs(q[:, None] - q[None]).max(axis=-1) + np.eye(len(q))
        assert (apart > 1e-3).all()


def found_again(solutions: IKSolutions, q: np.ndarray, target: np.ndarray) -> np.ndarray:
    """Whether each configuration ``q`` for ``target`` is among the answers."""
    found = [
        np.abs(solutions.of(t) - one).max(axis=1, initial=0.0).min(initial=9.0)
        for one, t in zip(q, target, strict=True)
    ]
    return np.array(found) < 1e-3


def dense_branches(chain: Chain, targets: np.ndarray, seeds: int) -> tuple[np.ndarray, np.ndarray]:
    """Distinct configurations (m, dof) and their targets, by damped least squares from many random configurations."""
    rng = np.random.default_rng(11)
    kept, owner = [], []
    for i, target in enumerate(targets):
        goals = np.broadcast_to(target, (seeds, 4, 4))
        q = newton(chain, chain.random(rng, seeds), goals, 40)
        q = q[is_at(chain, q, goals)]
        while len(q):
            kept.append(q[0])
            owner.append(i)
            q = q[np.abs(q - q[0]).max(axis=1) > 1e-3]
    return np.array(kept), np.array(owner)


FAMILIES = {
    "ur3": "ParallelArm",
    "ur3_dual": "ParallelArm",
    "parallel 0": "ParallelArm",
    "nextage_left": "CrossingArm",
    "nextage_right": "CrossingArm",
    "crossing 0": "CrossingArm",
    "hrp5p": "SeedSearch",
    "panda": "SeedSearch",
}


@pytest.mark.parametrize(("name", "family"), FAMILIES.items())
def test_the_geometry_chooses_the_solver(name: str, family: str) -> None:
    _, chain = any_arm(name)
    assert type(make_solver(chain).family).__name__ == family


@pytest.mark.parametrize("name", [*ARMS, *(f"{kind} {seed}" for kind in MADE for seed in range(4))])
def test_every_answer_holds(name: str, rng: np.random.Generator) -> None:
    model, chain = any_arm(name)
    targets = chain.forward(chain.random(rng, 100))
    solutions = solve_ik(chain, targets)
    assert solutions.solved.mean() >= 0.98
    assert_holds(model, chain, solutions, targets)


@pytest.mark.parametrize("name", ["ur3", "ur3_dual", *(f"parallel {seed}" for seed in range(6))])
def test_closed_form_finds_every_configuration_again(name: str, rng: np.random.Generator) -> None:
    _, chain = any_arm(name)
    q = chain.random(rng, 1000)
    assert found_again(solve_ik(chain, chain.forward(q)), q, np.arange(1000)).all()


@pytest.mark.parametrize("name", ["nextage_left", "nextage_right", *(f"crossing {seed}" for seed in range(4))])
def test_search_finds_nearly_every_configuration_again(name: str, rng: np.random.Generator) -> None:
    _, chain = any_arm(name)
    q = chain.random(rng, 1000)
    solutions = solve_ik(chain, chain.forward(q))
    assert found_again(solutions, q, np.arange(1000)).mean() >= 0.99
    assert solutions.solved.mean() >= 0.995


@pytest.mark.parametrize(
    ("name", "seeds"), [("ur3", 400), ("nextage_left", 200), ("nextage_right", 200), ("crossing 1", 400)]
)
def test_no_branch_that_a_dense_search_finds_is_missing(name: str, seeds: int, rng: np.random.Generator) -> None:
    _, chain = any_arm(name)
    targets = chain.forward(chain.random(rng, 30))
    q, target = dense_branches(chain, targets, seeds)
    assert len(q) > 30
    assert found_again(solve_ik(chain, targets), q, target).mean() >= 0.98


def test_a_ur_arm_has_the_branches_that_its_geometry_gives(rng: np.random.Generator) -> None:
    _, chain = load("ur3")
    counts = solve_ik(chain, chain.forward(chain.random(rng, 500))).counts
    assert set(counts) <= {2, 4, 6, 8}
    assert counts.max() == 8


@pytest.mark.parametrize("name", ["ur3", "nextage_left"])
def test_narrower_limits_give_the_part_of_the_answers_that_keeps_them(name: str, rng: np.random.Generator) -> None:
    _, chain = load(name)
    targets = chain.forward(chain.random(rng, 200))
    narrow = replace(chain, lower=chain.lower * 0.7, upper=chain.upper * 0.8)
    every, fitting = solve_ik(chain, targets), solve_ik(narrow, targets)
    kept = narrow.within_limits(every.q)
    assert 0 < kept.sum() < len(every.q)
    assert found_again(fitting, every.q[kept], every.target[kept]).mean() >= 0.99
    assert abs(len(fitting.q) - kept.sum()) <= 0.01 * kept.sum()


def test_wider_limits_give_every_whole_turn_that_fits(rng: np.random.Generator) -> None:
    model, chain = load("ur3")
    wide = replace(chain, lower=chain.lower - 1.0, upper=chain.upper + np.array([1.0, 0.0, 4.0, 0.0, 0.0, 2 * np.pi]))
    targets = chain.forward(chain.random(rng, 20))
    base, solutions = solve_ik(chain, targets), solve_ik(wide, targets)
    turns = 2.0 * np.pi * np.array(np.meshgrid(*[[-1, 0, 1, 2]] * 6)).reshape(6, -1).T
    for i in range(20):
        expected = (base.of(i)[:, None] + turns).reshape(-1, 6)
        expected = expected[wide.within_limits(expected)]
        assert len(solutions.of(i)) == len(expected)
        assert found_again(solutions, expected, np.full(len(expected), i)).all()
    assert_holds(model, wide, solutions, targets)


def test_a_joint_at_half_a_turn_has_both_ends_of_its_range() -> None:
    _, chain = load("ur3")
    q = np.array([[0.3, -1.0, 1.2, 0.4, 0.9, np.pi]])
    answers = solve_ik(chain, chain.forward(q)).q
    for end in (-np.pi, np.pi):
        q[0, 5] = end
        assert (np.abs(answers - q).max(axis=1) < 1e-6).sum() == 1


SINGULAR = {
    "ur3": [
        [0, 0, 0, 0, 0, 0],
        [0.4, -1.1, 0.9, 0.2, 0, 0.7],
        [0.4, -1.1, 0.9, 0.2, 1e-9, 0.7],
        [0.4, -1.1, 0.9, 0.2, 1e-6, 0.7],
        [0.4, -1.1, 0.9, 0.2, -1e-4, 0.7],
        [0.4, -1.1, 0.9, 0.2, np.pi, 0.7],
        [0.4, -1.1, 0, 0.2, 0.8, 0.7],
        [0.4, -1.1, 1e-8, 0.2, 0.8, 0.7],
        [0.4, -1.1, -1e-5, 0.2, 0.8, 0.7],
        [0.4, -1.1, np.pi, 0.2, 0.8, 0.7],
        [0, -np.pi / 2, 0, -np.pi / 2, 0, 0],
        [-np.pi, np.pi, -np.pi, np.pi, -np.pi, np.pi],
    ],
    "nextage_left": [
        [0, 0, 0, 0, 0, 0],
        [0.3, -0.4, -1.5, 0, np.pi / 2, 0.2],
        [0.3, -0.4, -1.5, 0.5, np.pi / 2, 0.2],
        [0.3, -0.4, -1.5, 0.5, -np.pi / 2, 0.2],
        [0.3, -0.4, -0.1194289, 0.5, 0.1, 0.2],
        [0.0, -0.4, -1.5, 0.0, 0.0, 0.0],
        [0.3, -2.44346, 0, 2.87979, 1.74533, -2.84489],
    ],
    "panda": [
        [0, 0, -1e-9, -0.07, 0, 0, 0],
        [0, 0, 0, -1.6, 0, np.pi / 2, 0],
        [0.1, 0, 0.2, -1.6, 0, 0, 0.3],
    ],
}


@pytest.mark.parametrize("name", SINGULAR)
def test_singular_poses_are_solved_and_right(name: str) -> None:
    model, chain = load(name)
    q = np.clip(np.array(SINGULAR[name], dtype=float), chain.lower, chain.upper)
    targets = chain.forward(q)
    solutions = solve_ik(chain, targets)
    assert solutions.solved.all()
    assert_holds(model, chain, solutions, targets)


def test_an_aligned_wrist_gives_one_answer_a_branch(rng: np.random.Generator) -> None:
    _, chain = load("ur3")
    q = chain.random(rng, 300)
    q[:, 4] = 0.0
    solutions = solve_ik(chain, chain.forward(q))
    assert solutions.solved.all()
    aligned = np.abs(np.sin(solutions.q[:, 4])) < 1e-6
    per_target = np.bincount(solutions.target[aligned], minlength=300)
    assert (per_target > 0).mean() > 0.95
    assert per_target.max() <= 4


def test_the_free_angle_of_an_aligned_wrist_is_chosen_within_the_limits(rng: np.random.Generator) -> None:
    _, chain = load("ur3")
    low, high = chain.lower.copy(), chain.upper.copy()
    low[5], high[5] = 0.4, 1.4
    narrow = replace(chain, lower=low, upper=high)
    q = narrow.random(rng, 200)
    q[:, 4] = 0.0
    assert solve_ik(narrow, narrow.forward(q)).solved.mean() >= 0.9


def test_answers_next_to_half_a_turn_are_found(rng: np.random.Generator) -> None:
    _, chain = any_arm("crossing 0")
    q = chain.random(rng, 600)
    q[np.arange(600), np.arange(600) % 6] = rng.choice([-1.0, 1.0], 600) * (np.pi - 1e-4)
    assert found_again(solve_ik(chain, chain.forward(q)), q, np.arange(600)).mean() >= 0.99


@pytest.mark.parametrize("name", ARMS)
def test_targets_out_of_reach_are_empty(name: str, rng: np.random.Generator) -> None:
    _, chain = load(name)
    targets = chain.forward(chain.random(rng, 20))
    shoulder = chain.placements[0, :3, 3]
    direction = targets[:, :3, 3] - shoulder
    reach = np.linalg.norm(chain.placements[1:, :3, 3], axis=1).sum()
    for distance in (1.02 * reach, 100.0):
        targets[:, :3, 3] = shoulder + distance * direction / np.linalg.norm(direction, axis=1)[:, None]
        solutions = solve_ik(chain, targets)
        assert not solutions.solved.any()
        assert solutions.q.shape == (0, chain.dof)


@pytest.mark.parametrize("name", ["ur3", "nextage_left", "panda"])
def test_targets_that_random_configurations_never_come_near_are_empty(name: str, rng: np.random.Generator) -> None:
    _, chain = load(name)
    targets = chain.forward(chain.random(rng, 200))
    targets[:, :3, 3] *= 1.2
    solutions = solve_ik(chain, targets)
    assert 0 < solutions.solved.sum() < 200
    unsolved = np.flatnonzero(~solutions.solved)[:20]
    assert solve_ik(chain, targets[unsolved]).q.shape == (0, chain.dof)
    _, target = dense_branches(chain, targets[unsolved], 200)
    assert len(target) <= 1


def test_wrong_by_half_a_turn_is_wrong(rng: np.random.Generator) -> None:
    _, chain = load("ur3")
    q = chain.random(rng, 50)
    half = rotation_about([0.0, 0.6, 0.8], np.pi)
    assert is_at(chain, q, chain.forward(q)).all()
    assert not is_at(chain, q, chain.forward(q) @ compose(half, np.zeros(3))).any()


def test_half_a_turn_is_an_error_of_half_a_turn() -> None:
    pose, turned = np.eye(4)[:3].T[..., None], np.diag([1.0, -1.0, -1.0, 1.0])[:3].T[..., None]
    assert np.linalg.norm(pose_error(pose, turned)) == pytest.approx(np.pi)


def test_redundant_arms_get_a_spread_of_configurations(rng: np.random.Generator) -> None:
    _, chain = load("hrp5p")
    targets = chain.forward(chain.random(rng, 100))
    solutions = solve_ik(chain, targets)
    assert solutions.solved.mean() >= 0.98
    assert np.median(solutions.counts) >= 4
    for i in range(100):
        q = solutions.of(i)
        apart = np.abs(q[:, None] - q[None]).max(axis=-1) + np.eye(len(q))
        assert (apart >= 0.1).all()


@pytest.mark.parametrize("name", ["ur3", "nextage_left", "panda"])
def test_the_same_seed_gives_the_same_answers_and_targets_do_not_meddle(name: str, rng: np.random.Generator) -> None:
    _, chain = load(name)
    targets = chain.forward(chain.random(rng, 40))
    first, again = solve_ik(chain, targets, seed=5), solve_ik(chain, targets, seed=5)
    assert (first.q == again.q).all()
    solver = make_solver(chain, seed=5)
    alone = np.concatenate([solver(target).q for target in targets])
    np.testing.assert_allclose(alone, first.q, atol=1e-7)


def test_solutions_tell_which_target_they_belong_to(rng: np.random.Generator) -> None:
    _, chain = load("ur3")
    targets = chain.forward(chain.random(rng, 5))
    targets[2, :3, 3] = 9.0
    solutions = solve_ik(chain, targets)
    assert solutions.solved.tolist() == [True, True, False, True, True]
    assert (solutions.counts == [len(solutions.of(i)) for i in range(5)]).all()
    assert sum(solutions.counts) == len(solutions.q)


@pytest.mark.parametrize("name", ["ur3", "nextage_left", "panda"])
def test_no_targets_have_no_answers(name: str) -> None:
    _, chain = load(name)
    solutions = solve_ik(chain, np.zeros((0, 4, 4)))
    assert solutions.q.shape == (0, chain.dof)
    assert solutions.solved.shape == (0,)


def test_targets_that_are_no_poses_are_refused() -> None:
    _, chain = load("ur3")
    with pytest.raises(InputError, match="pose"):
        solve_ik(chain, np.eye(3))
    with pytest.raises(InputError, match="rigid"):
        solve_ik(chain, 2.0 * np.eye(4))


# Following lines of poses


def straight(chain: Chain, q: np.ndarray, steps: int, length: float, rng: np.random.Generator) -> np.ndarray:
    """Lines (steps, n, 4, 4) from the tips at ``q`` in random directions, turning by as many radians as metres."""
    direction, axis = rng.normal(size=(2, len(q), 3))
    direction /= np.linalg.norm(direction, axis=1)[:, None]
    axis /= np.linalg.norm(axis, axis=1)[:, None]
    along = np.linspace(0.0, length, steps + 1)[1:]
    start = chain.forward(q)
    lines = np.tile(start, (steps, 1, 1, 1))
    lines[..., :3, :3] = rotation_about(axis, along[:, None]) @ start[:, :3, :3]
    lines[..., :3, 3] += along[:, None, None] * direction
    return lines


@pytest.mark.parametrize("name", ["ur3", "nextage_left", "hrp5p", "panda", "parallel 1"])
def test_tracking_stays_on_the_line_without_jumps(name: str, rng: np.random.Generator) -> None:
    model, chain = any_arm(name)
    q = chain.random(rng, 60)
    lines = straight(chain, q, steps=10, length=0.05, rng=rng)
    path, reached = track(chain, q, lines)
    assert (reached == 10).sum() >= 10
    assert (np.abs(np.diff(np.concatenate([q[None], path]), axis=0)) <= 0.2).all()
    followed = np.arange(10)[:, None] < reached
    for step in range(10):
        (line,) = np.nonzero(followed[step])
        assert_holds(model, chain, IKSolutions(path[step, line], line, len(q)), lines[step])
        (ended,) = np.nonzero(~followed[step])
        assert (path[step, ended] == (path[step - 1, ended] if step else q[ended])).all()


@pytest.mark.parametrize("name", ["ur3", "nextage_left"])
def test_tracking_ends_no_line_that_small_steps_can_follow(name: str, rng: np.random.Generator) -> None:
    _, chain = load(name)
    q = chain.random(rng, 100)
    lines = straight(chain, q, steps=200, length=0.05, rng=rng)
    _, fine = track(chain, q, lines, max_joint_step=0.01)
    _, coarse = track(chain, q, lines[19::20])
    assert (coarse[fine == 200] == 10).all()
    assert (fine == 200).sum() >= 30


def test_tracking_ends_at_a_limit(rng: np.random.Generator) -> None:
    _, chain = load("ur3")
    q = np.array([[0.3, -1.0, 1.2, 0.4, 0.9, 2.95]])
    about_flange = np.array(
        [compose(rotation_about([0.0, 0.0, 1.0], angle), np.zeros(3)) for angle in (0.1, 0.19, 0.2)]
    )
    lines = (chain.forward(q) @ about_flange)[:, None]
    path, reached = track(chain, q, lines)
    assert reached.tolist() == [2]
    assert path[1, 0, 5] == pytest.approx(3.14, abs=1e-6)
    _, free = track(replace(chain, upper=chain.upper + 1.0), q, lines)
    assert free.tolist() == [3]


def test_tracking_ends_only_where_no_answer_is_near(rng: np.random.Generator) -> None:
    _, chain = load("ur3")
    q = chain.random(rng, 300)
    lines = straight(chain, q, steps=10, length=0.1, rng=rng)
    path, reached = track(chain, q, lines)
    (ended,) = np.nonzero(reached < 10)
    assert len(ended) > 50
    last = np.where(reached[:, None] > 0, path[reached - 1, np.arange(300)], q)
    solutions = solve_ik(chain, lines[reached[ended], ended])
    for i, line in enumerate(ended):
        assert np.abs(solutions.of(i) - last[line]).max(axis=1, initial=0.0).min(initial=9.0) > 0.199


def test_tracking_ends_where_the_arm_is_stretched() -> None:
    _, chain = load("ur3")
    q = np.array([[0.3, -1.0, 0.6, 0.4, 0.9, 0.2]])
    shoulder, tip = chain.placements[0, :3, 3], chain.forward(q)[0]
    lines = np.tile(tip, (300, 1, 1, 1))
    outward = (tip[:3, 3] - shoulder) / np.linalg.norm(tip[:3, 3] - shoulder)
    lines[..., :3, 3] += np.linspace(0.0, 0.03, 301)[1:, None, None] * outward
    path, reached = track(chain, q, lines)
    assert 0 < reached[0] < 300
    elbow = path[:, 0, 2]
    assert 0.0 < elbow.min() < 0.05


def test_redundant_arms_take_the_shortest_steps(rng: np.random.Generator) -> None:
    _, chain = load("panda")
    middle = 0.5 * (chain.lower + chain.upper)
    q = middle + 0.2 * rng.uniform(-1.0, 1.0, (20, chain.dof))
    lines = straight(chain, q, steps=1, length=1e-3, rng=rng)
    path, reached = track(chain, q, lines)
    assert (reached == 1).all()
    for jacobian, step in zip(chain.jacobian(q), path[0] - q, strict=True):
        idle = np.linalg.svd(jacobian)[2][-1]
        assert abs(idle @ step) < 0.02 * np.linalg.norm(step)


def test_redundant_arms_go_on_when_a_joint_stands_at_its_limit(rng: np.random.Generator) -> None:
    _, chain = load("hrp5p")
    q = chain.random(rng, 200)
    q[:, 1] = chain.upper[1]
    _, reached = track(chain, q, straight(chain, q, steps=10, length=0.02, rng=rng))
    assert (reached == 10).mean() > 0.9


def test_lines_that_do_not_fit_are_refused() -> None:
    _, chain = load("ur3")
    with pytest.raises(InputError, match="do not fit"):
        track(chain, np.zeros((3, 6)), np.tile(np.eye(4), (4, 2, 1, 1)))
