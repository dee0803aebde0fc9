"""A measurement: what is timed, and the file its record lies in."""

import json
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Literal

from knitlab.io.atomic_write import atomic_write
from knitlab.model.settings import Boundary
from knitlab.runs.plan import make_plan
from knitlab.solvers.case import Case

Task = Literal["tuning", "relaxation", "tension", "shipped_relaxation", "iteration", "sweep"]
Record = dict[str, Any]

ACROSS_EDGE = "knitlab_across_edge"
"""knitlab, starting as a sweep does, of fabrics whose fold angles are taken across the edge."""
TOLERANCE = 1e-6
"""Largest force that every method may leave on a free unknown [N]."""


@dataclass(frozen=True)
class Measurement:
    """One thing to time, once.

    Attributes:
        task: what is done.
        solver: by which method.
        n_stripe, n_subunit: the design.
        size: unit cells of the sample along (y, x), as ``7x5``.
        boundary: of the sample.
        workers: worker processes of a sweep, threads of anything else.
        repeat: which of the repeats it is.
        time_limit: processor time after which it is given up [s].
        setting: of a method that has one number to tune, that number.
    """

    task: Task
    solver: str
    n_stripe: int = 4
    n_subunit: int = 16
    size: str = "1x1"
    boundary: Boundary = "clamped"
    workers: int = 1
    repeat: int = 0
    time_limit: float = 3600.0
    setting: float | None = None

    @property
    def name(self) -> str:
        """Identifier, without the limit: that only says when to give up."""
        setting = "" if self.setting is None else f"-{self.setting:g}"
        return (
            f"{self.task}-{self.solver}{setting}-{self.n_stripe}-{self.n_subunit}"
            f"-{self.boundary}-{self.size}-w{self.workers}-r{self.repeat}"
        )

    def path(self, results: Path) -> Path:
        """File of its record."""
        return results / "records" / f"{self.name}.json"

    def record(self, results: Path) -> Record | None:
        """What was measured, unless it was given up sooner than it would be now."""
        path = self.path(results)
        if not path.exists():
            return None
        record = json.loads(path.read_text())
        return record if record["reached"] or record["time_limit"] >= self.time_limit else None

    def case(self, *overrides: str) -> Case:
        """The sample as a case of the shipped parameters, 15 strain steps of 3 %."""
        (case,) = self.cases(*overrides)
        return case

    def cases(self, *overrides: str) -> list[Case]:
        """The sample as cases of the shipped parameters, one for each value of an override.

        Unlike in a sweep, knitlab's own path is no finer than that, as no other method's is, and
        a sample that it does not start flat is a tiling of relaxed periodic fabric.
        """
        settings = (
            "path_step=0.03",
            "smallest_step=1",
            "start=periodic",
            f"n_stripe={self.n_stripe}",
            f"n_subunit={self.n_subunit}",
            f"boundary={self.boundary}",
            f"unit_cells={self.size.replace('x', ',')}",
            f"fold_angle={'across_edge' if self.solver == ACROSS_EDGE else 'whole_normals'}",
        )
        return list(make_plan("periodic", (*settings, "robustness=0", *overrides)).cases.values())

    def write(self, results: Path, values: Record) -> None:
        """Leave its record, whole or not at all."""
        with atomic_write(self.path(results)) as temporary:
            temporary.write_text(json.dumps(asdict(self) | values, indent=1))
