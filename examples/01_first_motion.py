"""A first motion: inverse kinematics for both hands of two UR3, then a timed 12-joint motion over an obstacle."""

import itertools

import numpy as np

import kumitate as km

robot = km.load_robot("ur3_dual", hands={"left": "robotiq_2f85", "right": "robotiq_2f85"})
table = km.Body.box("table", [0.8, 1.83, 0.024], fixed=True)
fence = km.Body.box("fence", [0.03, 1.0, 0.12], fixed=True)
scene = km.Scene.of(robot, [table, fence])
poses = {"table": km.pose([0.46, 0.0, 1.082]), "fence": km.pose([0.33, 0.0, 1.154])}
state = scene.state(poses, openings={"left": 0.03, "right": 0.03})
checker = scene.checker(state)


def looking_down(x: float) -> list[np.ndarray]:
    """Free configurations with both hands at ``x``, 25 cm to the left and right, looking down; home-like ones first."""
    hands = {"left": km.pose([x, 0.25, 1.17], [0, np.pi, 0]), "right": km.pose([x, -0.25, 1.17], [0, np.pi, 0])}
    left, right = (robot.arms[arm].solve_ik(pose, 0.03).q for arm, pose in hands.items())
    both = [np.concatenate(pair) for pair in itertools.product(left, right)]
    return sorted((q for q in both if checker.free(q)), key=lambda q: float(np.linalg.norm(q - robot.home)))


before, behind = looking_down(0.25), looking_down(0.41)
print(f"{len(before)} free configurations before the fence, {len(behind)} behind it")

start = state.with_q(before[0])
path = km.plan_motion(scene, start, behind, ["left", "right"], seed=1)
motion = km.time_motion(scene, start, path, ["left", "right"], speed=0.5)
print(f"over the fence in {motion.duration:.2f} s: {len(path)} waypoints, {len(motion.times)} samples")
print(f"fastest joint at {100 * np.max(motion.peak_velocity() / robot.velocity):.0f}% of its velocity limit")
