"""The same task built in code, where all numbers are SI, and planned at three speeds."""

from math import pi
from pathlib import Path

import kumitate as km

folder = Path(__file__).parent / "wheel_support"


def task_at(speed: float) -> km.Task:
    """A wheel onto the axle of an upright support, with joints at ``speed`` times their velocity limits."""
    on_axle = km.Attach(
        part="wheel",
        to="support",
        at=km.At((0, 0.032, 0.010)),
        insert=km.Insert(direction=(0, -1, 0), distance=0.070),
    )
    return km.Task(
        robot="nextage",
        hands={"left": "robotiq_2f85", "right": "robotiq_2f85"},
        speed=speed,
        cell=(km.Obstacle("table", box=(0.3, 1.32, 0.02), at=km.At((0.40, 0, -0.06)), support=True),),
        parts={
            "support": km.PartEntry(
                "../parts/support.stl", "mm", km.At((0.40, -0.30, -0.05), (0, 0, pi / 2)), mass=0.06
            ),
            "wheel": km.PartEntry("../parts/wheel.stl", "mm", km.At((0.40, 0.35, -0.05), (pi / 2, 0, 0)), mass=0.05),
        },
        goals=(km.Goal(attach=on_axle),),
    )


print(f"as in the file: {task_at(0.5) == km.read_task(folder / 'task.yaml')}")
for speed in (0.25, 0.5, 1.0):
    plan = km.plan(task_at(speed), folder, seed=1)
    print(f"at {100 * speed:.0f}% of the limits: {plan.duration:.1f} s in {len(plan.actions)} actions")
