"""Plan documents: real ones, spoiled, through the reader to verification, replay and exports."""

from __future__ import annotations

import base64
import contextlib
import json
import re
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from spoil import NAMES, NUMBERS, Rng, nudged, one, spoiled_bytes, spoiled_tree
from worker import MissedError

from kumitate.errors import InputError
from kumitate.tasks.document import Plan
from kumitate.tasks.export import table, trajectories
from kumitate.tasks.planner import plan
from kumitate.tasks.replay import write_replay
from kumitate.tasks.task import At, Goal, HandOver
from kumitate.tasks.task_file import read_task
from kumitate.tasks.verify import verify

sys.path.append(str(Path(__file__).resolve().parents[1] / "support"))

from plans import short_plan, standing_plan, use_plan

COUNT = 3000
_FLIP = Path(__file__).resolve().parents[2] / "examples" / "flip" / "one_arm.yaml"
_SAME = 2e-4  # m, rad: what a hand may be off its grasp, and a bit
# What is told besides and decides nothing; the task, since a plan may be right for another one too; names of joints,
# two of which may stand alike all the time; and motions, each instant of which is verified: one that differs and still
# is within all limits and free of collision is no damage.
_BESIDES = re.compile(
    r"\.(version|seed|folder|seconds|task|digests|joints)\b|\.meshes\.\w+\.digest"
    r"|\.actions\[\d+\]\.(kind|part|words|goal|motion|grasp\.(contacts|normals|force|approach_opening))"
)


def _held() -> Plan:
    """A plan of five actions, with a mesh from a file: a hand takes a block and holds it up."""
    lifted = Goal(hand_over=HandOver(part="block", to="left", at=At(xyz=(0.4, 0.2, 0.15))))
    return plan(msgspec.structs.replace(read_task(_FLIP), goals=(lifted,)), _FLIP.parent)


_PLANS = {"held": _held(), "short": short_plan(), "standing": standing_plan(), "used": use_plan()}
_DOCUMENTS = {
    name: msgspec.to_builtins(msgspec.structs.replace(made, folder=str(_FLIP.parent))) for name, made in _PLANS.items()
}


def make(rng: Rng, folder: Path) -> None:
    """Write a plan, spoiled in one or two places."""
    name = one(rng, ("held", "held", *_PLANS))
    document, changes = _DOCUMENTS[name], [one(rng, _CHANGES) for _ in range(int(rng.integers(1, 3)))]
    for change in changes:
        document = _changed(rng, document, change)
    content = json.dumps(document).encode()
    if rng.random() < 0.15:
        content = spoiled_bytes(rng, content)
    (folder / "plan.json").write_bytes(content)
    then = one(rng, ("replay", "export", "table", "", "", ""))
    judged = _names not in changes  # whatever is called otherwise everywhere is as right as before
    (folder / "case.json").write_text(json.dumps({"base": name, "then": then, "judged": judged}))


def feed(folder: Path) -> str:
    """Load the plan, verify it, and play or export it."""
    case = json.loads((folder / "case.json").read_text())
    read = Plan.load(folder / "plan.json")
    uses: dict[str, Callable[[], object]] = {
        "replay": lambda: write_replay(read, folder / "replay.html"),
        "export": lambda: trajectories(read),
        "table": lambda: table(read),
    }
    with contextlib.suppress(InputError):  # what cannot be played may be verified, to tell why
        uses.get(case["then"], lambda: None)()
    verification = verify(read)
    if not verification.ok:
        return "faults"
    changes = list(differences(_DOCUMENTS[case["base"]], msgspec.to_builtins(read)))
    if case["base"] != "held":  # triangles that no file is there to compare with may be any
        changes = [change for change in changes if not change.startswith(".meshes")]
    if case["judged"] and changes:
        raise MissedError("; ".join(changes[:5]))
    return "works"


def differences(before: Any, after: Any, path: str = "") -> Iterator[str]:
    """What is not the same in two documents, but for what is told besides and for rounding."""
    if _BESIDES.match(path):
        return
    if isinstance(before, dict) and isinstance(after, dict):
        for key in before.keys() | after.keys():
            yield from differences(before.get(key), after.get(key), f"{path}.{key}")
    elif isinstance(before, list | tuple) and isinstance(after, list | tuple) and len(before) == len(after):
        for i, (one, other) in enumerate(zip(before, after, strict=True)):
            yield from differences(one, other, f"{path}[{i}]")
    elif isinstance(before, float | int) and isinstance(after, float | int):
        if abs(before - after) > _SAME:
            yield f"{path}: {before} is now {after}"
    elif before != after:
        yield f"{path}: {str(before)[:60]} is now {str(after)[:60]}"


# What is done to documents --------------------------------------------------------------------------------------------


def _changed(rng: Rng, document: Any, change: Callable[[Rng, Any], None]) -> Any:
    """A copy of ``document`` with a change, as far as earlier changes left something to change."""
    changed = json.loads(json.dumps(document))
    with contextlib.suppress(KeyError, TypeError, ValueError, IndexError, AttributeError):
        change(rng, changed)
    return changed


def _anything(rng: Rng, document: Any) -> None:
    changed = spoiled_tree(rng, document)
    document.clear()
    document.update(changed)


def _actions(rng: Rng, document: Any) -> None:
    actions = document["actions"]
    i, j = (int(k) for k in rng.integers(0, len(actions), 2))
    ways: tuple[Callable[[], object], ...] = (
        lambda: actions.pop(i),
        lambda: actions.insert(j, actions[i]),
        lambda: actions.__setitem__(slice(i, i + 1), []),
        lambda: actions.insert(j, actions.pop(i)),
        actions.reverse,
        lambda: actions.extend(actions),
        lambda: actions[i].update(kind=actions[j]["kind"]),
        lambda: actions[i].update(goal=one(rng, (None, 0, 1, -1, 10**9))),
    )
    one(rng, ways)()


def _events(rng: Rng, document: Any) -> None:
    action = one(rng, [action for action in document["actions"] if action["events"]])
    event = one(rng, action["events"])
    ways: tuple[Callable[[], object], ...] = (
        lambda: action["events"].remove(event),
        lambda: action["events"].append(event),
        lambda: event.update(time=nudged(rng, event["time"])),
        lambda: event.update(kind=one(rng, ("attach", "detach"))),
        lambda: event.update(carrier=one(rng, ("left", "right", event["part"], "table", *NAMES))),
        lambda: one(rng, document["actions"])["events"].append({**event, "time": 0.0}),
    )
    one(rng, ways)()


def _bump(rng: Rng, document: Any) -> None:
    """A joint goes astray for a while: by a milliradian or by much."""
    motion = one(rng, document["actions"])["motion"]
    count, joint = len(motion["times"]), int(rng.integers(len(document["joints"])))
    start, end = np.sort(rng.integers(0, count, 2)).tolist()
    size = 10.0 ** rng.uniform(-3.0, 1.0)
    for k in range(start, end + 1):
        motion["positions"][k][joint] += size * float(np.sin(np.pi * (k - start + 0.5) / (end - start + 1)))


def _samples(rng: Rng, document: Any) -> None:
    motion = one(rng, document["actions"])["motion"]
    k = int(rng.integers(len(motion["times"])))
    rows = [motion[name] for name in ("times", "positions", "velocities")]
    rows += [row for name in ("openings", "opening_velocities") for row in motion[name].values()]
    if rng.random() < 0.5:
        for row in rows:
            row.pop(k)
    else:
        factor = 10.0 ** rng.uniform(-3.0, 12.0)
        motion["times"] = [time * factor for time in motion["times"]]
        if rng.random() < 0.5:
            motion["velocities"] = [[rate / factor for rate in row] for row in motion["velocities"]]


def _openings(rng: Rng, document: Any) -> None:
    motion = one(rng, document["actions"])["motion"]
    arm = one(rng, list(motion["openings"]))
    by = rng.normal() * 10.0 ** rng.uniform(-4.0, -1.0)
    motion["openings"][arm] = [opening + by for opening in motion["openings"][arm]]


def _poses(rng: Rng, document: Any) -> None:
    """A part is elsewhere, or turned, in a state, in its carrier or in a grasp; in one place or in all."""
    by = rng.normal() * 10.0 ** rng.uniform(-3.5, 0.0)
    actions = document["actions"] if rng.random() < 0.5 else [one(rng, document["actions"])]
    what, axis = one(rng, ("poses", "attached", "grasp")), int(rng.integers(3))
    for action in actions:
        matrices = [pose for state in ("start", "end") for pose in action[state]["poses"].values()]
        if what == "attached":
            carried = [entry for state in ("start", "end") for entry in action[state]["attached"].values()]
            matrices = [entry["carrier_from_part"] for entry in carried]
        elif what == "grasp":
            matrices = [action["grasp"]["part_from_hand"]] if action["grasp"] else []
        for matrix in matrices:
            matrix[axis][3] += by


def _carriers(rng: Rng, document: Any) -> None:
    """Parts that carry each other, or themselves."""
    state = one(rng, document["actions"])[one(rng, ("start", "end"))]
    parts = list(state["poses"])
    other, here = one(rng, parts), np.eye(4).tolist()
    state["attached"][one(rng, parts)] = {"carrier": other, "carrier_from_part": here}
    state["attached"][other] = {"carrier": one(rng, (*parts, "left", "right")), "carrier_from_part": here}


def _triangles(rng: Rng, document: Any) -> None:
    mesh = document["meshes"][one(rng, list(document["meshes"]))]
    vertices = np.frombuffer(base64.b64decode(mesh["vertices"]), "<f8").copy()
    faces = np.frombuffer(base64.b64decode(mesh["faces"]), "<i4").copy()
    ways: tuple[Callable[[], object], ...] = (
        lambda: vertices.__setitem__(rng.integers(len(vertices)), one(rng, [float(n) for n in NUMBERS])),
        lambda: vertices.__imul__(1.0 + 10.0 ** rng.uniform(-3.0, 2.0)),
        lambda: vertices.__iadd__(10.0 ** rng.uniform(-3.0, 0.0)),
        lambda: faces.__setitem__(rng.integers(len(faces)), one(rng, (-1, 10**6, 0, 1))),
        lambda: faces.fill(0),
    )
    one(rng, ways)()
    cut = slice(None, None if rng.random() < 0.7 else -int(rng.integers(1, 10)))
    mesh["vertices"] = base64.b64encode(vertices[cut].tobytes()).decode()
    mesh["faces"] = base64.b64encode(faces[: len(faces) // int(rng.integers(1, 3))].tobytes()).decode()


def _names(rng: Rng, document: Any) -> None:
    """A part, an arm or a joint is called otherwise, everywhere."""
    name = one(rng, [*document["task"]["parts"], *document["task"]["hands"], *document["joints"]])
    text = json.dumps(document).replace(json.dumps(name), json.dumps(one(rng, NAMES)))
    document.clear()
    document.update(json.loads(text))


def _task(rng: Rng, document: Any) -> None:
    document["task"] = spoiled_tree(rng, document["task"])


def _paths(rng: Rng, document: Any) -> None:
    """Files that are none of a task."""
    path = one(rng, ("/dev/zero", "/dev/stdin", "/proc/self/mem", "/", "../../..", "a\0b", "a" * 5000, *NAMES))
    own = {"urdf": path, "srdf": one(rng, (path, "/etc/passwd"))}
    ways: tuple[Callable[[], object], ...] = (
        lambda: document.update(folder=path),
        lambda: document["task"].update(robot=own),
        lambda: document["task"].update(robot=path),
        lambda: document["task"]["hands"].update(left=path + one(rng, ("", ".yaml"))),
        lambda: one(rng, list(document["task"]["parts"].values())).update(mesh=path),
    )
    one(rng, ways)()


_CHANGES = (
    *(10 * (_anything,)),
    *(_actions, _actions, _events, _events, _bump, _bump, _bump, _samples, _samples, _openings, _poses, _poses),
    *(_carriers, _triangles, _names, _task, _task, _paths),
)
