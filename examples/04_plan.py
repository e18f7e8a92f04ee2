"""A plan for a whole task: read the task, plan it, look at what happens, verify it, and write it with its replay."""

from pathlib import Path

import numpy as np

import kumitate as km

folder = Path(__file__).parent / "wheel_support"
plan = km.plan(km.read_task(folder / "task.yaml"), folder, seed=1)

for action in plan.actions:
    print(f"{action.motion.duration:5.1f} s  {action.kind:<9} {action.words}")
print(f"{plan.duration:.1f} s of motion, planned in {sum(plan.seconds.values()):.1f} s")

push = next(action for action in plan.actions if action.kind == "insert")
joints = np.array(push.motion.positions)
print(f"the push: {len(joints)} samples of {len(plan.joints)} joints, then {push.events[0].kind} {push.events[0].part}")

found = km.verify(plan)
print("no faults" if found.ok else "\n".join(map(str, found.faults)))
print(f"at least {found.clearance * 1e3:.2f} mm between what may not touch, checked at {found.samples} instants")

state = plan.actions[-1].end
world_from_support, world_from_wheel = (np.array(state.poses[part]) for part in ("support", "wheel"))
support_from_wheel = np.linalg.inv(world_from_support) @ world_from_wheel
print(f"the wheel on the support: {(1e3 * support_from_wheel[:3, 3]).round(2) + 0.0} mm")

out = Path("out")
out.mkdir(exist_ok=True)
plan.save(out / "wheel.json")
km.write_replay(plan, out / "wheel.html")
print(f"read back, it is the same: {km.Plan.load(out / 'wheel.json') == plan}")
