"""From a task to a verified plan."""

from __future__ import annotations

import ctypes
import sys
from collections.abc import Sequence
from importlib.metadata import version
from pathlib import Path
from time import perf_counter

import msgspec

from ..errors import InputError, PlanningError, TimeLimitError
from .assembly import attach
from .cell import build_cell
from .deadline import Deadline, Progress
from .document import FORMAT, Plan
from .goals import go_home, hand_over, make_way, place, put_down
from .job import Job
from .models import model_digests
from .order import NoOrderError, in_some_order
from .reasons import NoPlanError, reasons, reasons_for_no_order
from .record import actions_of
from .task import Goal, Task
from .task_file import task_to_builtins
from .use import use
from .verify import Verification, verify

TIME_LIMIT = 120.0  # s
_LARGEST_SEED = 2**32 - 1


class UnverifiedError(PlanningError):
    """A plan was found, but the independent check of it found faults.

    Attributes:
        verification: What it found.
        report: The faults, a sentence each.
    """

    def __init__(self, verification: Verification) -> None:
        """Name the first faults."""
        self.verification = verification
        self.report = tuple(str(fault) for fault in verification.faults)
        listed = "; ".join(fault.words for fault in verification.faults[:3])
        super().__init__(f"the plan that was found does not pass its verification: {listed}")


def plan(
    task: Task,
    folder: str | Path = ".",
    *,
    seed: int = 0,
    time_limit: float = TIME_LIMIT,
    progress: Progress = lambda doing: None,
) -> Plan:
    """Plan a task, and verify the plan.

    The same task, seed and version give the same plan, but for the measured times.

    Args:
        task: The task.
        folder: Where its relative paths start.
        seed: Seed of all samples and searches.
        time_limit: Bound on the time of planning [s].
        progress: Called with words on what is being done.

    Raises:
        InputError: The task is not sound.
        PlanningError: There is no plan, or the time was over.
    """
    if isinstance(seed, bool) or not isinstance(seed, int) or not 0 <= seed <= _LARGEST_SEED:
        raise InputError("seed", f"{seed!r} is no seed", f"give a whole number from 0 to {_LARGEST_SEED}")
    if not task.goals:
        raise InputError("goals", "there is nothing to do", "give at least one goal")
    try:
        return _planned(task, folder, seed, Deadline(time_limit, progress))
    finally:
        _give_memory_back()


def _planned(task: Task, folder: str | Path, seed: int, deadline: Deadline) -> Plan:
    clock = _Clock()
    deadline.tell("cell")
    cell = build_cell(task, folder)
    clock.stage("cell")
    job = Job(cell, seed, deadline)
    for part in cell.parts:
        for arm in cell.robot.hands:
            job.grasps(part, arm)
    clock.stage("grasps")
    goals = _reach_all(job)
    if not job.motions.steps:
        raise InputError("goals", "all are reached before anything moves", "give at least one that is not")
    clock.stage("regrasps and motions")
    written = task_to_builtins(task)
    made = Plan(
        format=FORMAT,
        version=version("kumitate"),
        task=written,
        folder=str(Path(folder).resolve()),
        digests=model_digests(written, folder),
        seed=seed,
        joints=cell.robot.joint_names,
        meshes=dict(cell.meshes),
        actions=actions_of(cell.scene, job.motions.steps, goals),
        seconds={},
    )
    clock.stage("document")
    deadline.tell("verification")
    verification = verify(made)
    clock.stage("verification")
    if not verification.ok:
        raise UnverifiedError(verification)
    return msgspec.structs.replace(made, seconds=clock.seconds)


def _give_memory_back() -> None:
    """Let the system have what is free: glibc keeps it, since collision geometry leaves it in small pieces."""
    trim = getattr(ctypes.CDLL(None), "malloc_trim", None) if sys.platform == "linux" else None
    if trim is not None:
        trim(0)


def _reach_all(job: Job) -> list[int | None]:
    """Plan what all goals ask for, and the way home; the number of the goal that each step is for.

    Raises:
        PlanningError: There is no way.
    """
    task, numbers = job.cell.task, list[int | None]()

    def reach(number: int, to_come: Sequence[int]) -> None:
        del numbers[len(job.motions.steps) :]
        _reach_making_way(job, task.goals[number], tuple(task.goals[other] for other in to_come))
        numbers.extend([number] * (len(job.motions.steps) - len(numbers)))

    if task.order == "free":
        mark = job.mark()
        try:
            in_some_order(job, task.goals, reach)
        except NoOrderError as error:
            job.back_to(mark)
            raise NoPlanError(reasons_for_no_order(job, task.goals, error), error) from error
    else:
        for number, goal in enumerate(task.goals):
            mark = job.mark()
            try:
                reach(number, range(number + 1, len(task.goals)))
            except TimeLimitError:
                raise
            except PlanningError as error:
                job.back_to(mark)
                raise NoPlanError(reasons(job, number, goal, error), error) from error
    if task.end == "home":
        go_home(job)
        numbers.extend([None] * (len(job.motions.steps) - len(numbers)))
    return numbers


def _reach_making_way(job: Job, goal: Goal, to_come: tuple[Goal, ...]) -> None:
    """Plan what one goal asks for; if that fails, once more with the arms that hold something out of the way.

    Raises:
        PlanningError: There is no way.
    """
    mark = job.mark()
    try:
        _reach(job, goal, to_come)
    except TimeLimitError:
        raise
    except PlanningError as error:
        job.back_to(mark)
        try:
            if not make_way(job):
                raise error
            _reach(job, goal, to_come)
        except TimeLimitError:
            raise
        except PlanningError:
            job.back_to(mark)
            raise error from None


def _reach(job: Job, goal: Goal, to_come: tuple[Goal, ...]) -> None:
    """Plan what one goal asks for.

    Raises:
        PlanningError: There is no way.
    """
    if goal.attach is not None:
        same = [other.attach for other in to_come if other.attach is not None and other.attach.to == goal.attach.to]
        attach(job, goal.attach, same)
        whole = job.root(goal.attach.to)
        if goal.attach.then == "place" and job.rests_on(whole) is None:
            put_down(job, whole)
    elif goal.place is not None:
        place(job, goal.place)
    elif goal.hand_over is not None:
        hand_over(job, goal.hand_over)
    elif goal.use is not None:
        use(job, goal.use)


class _Clock:
    """Time by stage."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}
        self._last = perf_counter()

    def stage(self, name: str) -> None:
        """Count the time since the last call for the stage ``name``."""
        now = perf_counter()
        self.seconds[name] = now - self._last
        self._last = now
