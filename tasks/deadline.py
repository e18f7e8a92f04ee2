"""The overall time limit of planning: the one place where a clock decides, and then only to end in an error."""

from __future__ import annotations

from collections.abc import Callable
from time import perf_counter

from ..errors import TimeLimitError

Progress = Callable[[str], None]


class Deadline:
    """When planning must end, and what it is doing.

    Args:
        seconds: The time from now on [s].
        progress: Called with words on what is being done.
    """

    def __init__(self, seconds: float, progress: Progress = lambda doing: None) -> None:
        self._seconds, self._end, self._progress = seconds, perf_counter() + seconds, progress
        self._doing = "the start"

    def tell(self, doing: str) -> None:
        """Report what is being done.

        Raises:
            TimeLimitError: The time is over.
        """
        self._doing = doing
        self.check()
        self._progress(doing)

    def check(self) -> None:
        """Look at the clock.

        Raises:
            TimeLimitError: The time is over.
        """
        if perf_counter() > self._end:
            raise TimeLimitError(self._seconds, self._doing)
