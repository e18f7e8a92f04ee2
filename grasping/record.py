"""What each planning stage took in, kept and dropped, and how long it took: the rows of the paper's cost table."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType


@dataclass(frozen=True)
class Stage:
    """One row of the cost table (paper, section V.B.1).

    A stage that filters says what fell to which cause, and then ``taken == kept + sum(dropped)``. A stage that makes
    something new out of what it took (samples out of triangles, pairs out of contacts) leaves ``dropped`` empty.

    Attributes:
        name: The stage, for example ``"refinement 1"``.
        taken: How many candidates came in.
        kept: How many went on.
        dropped: How many fell, by reason.
        seconds: Processor time of the stage [s] (differences of ``time.process_time()``).
    """

    name: str
    taken: int
    kept: int
    dropped: Mapping[str, int] = field(default_factory=dict)
    seconds: float = 0.0

    def __post_init__(self) -> None:
        """Check that the counts add up."""
        object.__setattr__(self, "dropped", MappingProxyType(dict(self.dropped)))
        if self.dropped and self.taken != self.kept + sum(self.dropped.values()):
            raise ValueError(
                f"stage {self.name}: {self.taken} taken, but {self.kept} kept and {dict(self.dropped)} dropped"
            )
