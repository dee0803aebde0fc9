"""How far the designs of a cube have come."""

from enum import IntEnum


class Status(IntEnum):
    """How far a design has come."""

    pending = 0
    ok = 1
    not_converged = 2
    failed = 3
    excluded = 4


RUN = (Status.ok, Status.not_converged)
"""Statuses of designs that have results."""
