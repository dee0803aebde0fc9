"""Cases and charts for the tests of knitting."""

import functools
import typing

import numpy as np
import pytest

from knitlab.export.knitting.chart import StitchChart
from knitlab.runs.plan import make_plan
from knitlab.solvers.case import Case


def case_of(workflow: str = "periodic", **settings: object) -> Case:
    """The one case of a workflow with some settings."""
    (case,) = make_plan(workflow, settings).cases.values()
    return case


def chart_of_arrays(front, plated=None, plated_face=("front", "front")) -> StitchChart:
    """A chart of one patch with any stitches."""
    front = np.asarray(front, bool)
    courses, wales = front.shape
    return StitchChart(
        title="any",
        front=front,
        plated=np.zeros(front.shape, int) if plated is None else np.asarray(plated),
        plated_face=plated_face,
        knit=np.array([["plain"]]),
        row_borders=np.array([0, courses]),
        column_borders=np.array([0, wales]),
        repeat=(courses, wales),
        periodic=False,
    )


@pytest.fixture(scope="session")
def fast_protocols():
    """Python 3.11 looks up the members of a protocol at every isinstance of the interpreter's.

    They are the same each time; remembered, it takes a third of the time.
    """
    looked_up = getattr(typing, "_get_protocol_attrs", None)
    with pytest.MonkeyPatch.context() as patch:
        if looked_up is not None:
            patch.setattr(typing, "_get_protocol_attrs", functools.lru_cache(None)(looked_up))
        yield
