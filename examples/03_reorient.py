"""Turning a part over: from hand to hand, or by putting it down between; routes through the regrasp graph."""

import numpy as np
import trimesh

import kumitate as km

robot = km.load_robot("ur3_dual", hands={"left": "robotiq_2f85", "right": "robotiq_2f85"})
block = km.Part.from_mesh(trimesh.creation.box([30, 30, 100]), unit="mm", mass=0.1, name="block")
grasps = km.plan_grasps(block, robot.hands["left"]).thin(300)

table = km.Body.box("table", [0.8, 1.83, 0.024], fixed=True)
scene = km.Scene.of(robot, [table, km.Body.from_mesh("block", block.mesh)])
state = scene.state({"table": km.pose([0.45, 0.0, 1.082]), "block": km.pose([0.3, -0.2, 1.144])})
state = state.with_contacts([km.Contact("table", "block", [0.0, 0.0, 1.0])])
upside_down = km.Node("upside down on the left", km.pose([0.3, 0.2, 1.144], [np.pi, 0.0, 0.0]), "table")

for words, supports in (
    ("from hand to hand", []),
    ("with the table to put it down on", [km.Support.top_of(table, state.poses["table"])]),
):
    by_arm = {"left": grasps, "right": grasps}
    found = km.plan_regrasp(scene, state, block, by_arm, [upside_down], supports, rests_on="table", seed=1)
    print(f"{words}: {' -> '.join(node.name for node in found.route.nodes)}")
    for step in found.steps:
        print(f"  {step.trajectory.duration:5.2f} s  {step.words}")
