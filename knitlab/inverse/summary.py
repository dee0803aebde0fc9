"""Summary of a design: candidates, active bounds, and values that are hardly determined."""

from collections.abc import Iterator, Sequence

from knitlab.inverse.conflict import Conflict
from knitlab.inverse.design import Designed
from knitlab.inverse.search import SearchResult
from knitlab.inverse.search_space import DesignLabels


def summary(designed: Designed, conflict: Conflict | None) -> list[str]:
    """Lines about each candidate, the best first, and about targets that could not be met.

    Args:
        designed: the design.
        conflict: two conflicting targets, if there are any.
    """
    lines: list[str] = []
    dims = [str(dim) for dim in designed.cube["status"].dims if dim != "candidate"]
    for _, row in designed.table.iterrows():
        search = designed.searches[int(row["candidate"]) - 1]
        lines += _of_candidate(int(row["candidate"]), search, dims)
    if not designed.met:
        lines += _unmet(designed, conflict)
    if designed.unknown:
        labels = "; ".join(_labels(dims, design) for design in designed.unknown)
        lines.append(f"not considered, as no cube has results of them: {labels}")
    return lines


def _labels(dims: Sequence[str], design: DesignLabels) -> str:
    return "  ".join(f"{dim} {label}" for dim, label in zip(dims, design, strict=True))


def _of_candidate(number: int, search: SearchResult, dims: Sequence[str]) -> Iterator[str]:
    trial = search.winner
    if trial is None:
        return
    values = ", ".join(f"{name} {value:.4g}" for name, value in trial.values.items())
    yield f"candidate {number}: {_labels(dims, search.design)}  {values}".rstrip()
    how = " then ".join(search.methods) or "as it is"
    yield f"  {len(search.trials)} simulations by {how}; {search.ended}"
    if search.held_by:
        yield f"  at the bound {', '.join(search.held_by)}"
    if search.undetermined:
        names = ", ".join(
            f"{name} (± {100 * search.determined_to[name]:.0f} %)" for name in search.undetermined
        )
        yield f"  hardly determined by the targets: {names}"


def _unmet(designed: Designed, conflict: Conflict | None) -> Iterator[str]:
    found = [designed.searches[int(number) - 1] for number in designed.table["candidate"]]
    search = [*found, *(one for one in designed.searches if one.winner is not None)][0]
    trial = search.winner
    if trial is None:
        return
    wanted = (*designed.request.targets, *designed.request.subject_to)
    for target, off_by in zip(wanted, trial.off_by, strict=True):
        if off_by is not None and off_by > target.allowance:
            yield f"not met: {target.text}: the nearest is off by {off_by:.4g}"
    if search.held_by:
        yield f"held back by {', '.join(search.held_by)}: widen it, or relax a target"
    elif conflict is not None:
        one, other = conflict.labels
        yield f"{one!r} and {other!r} conflict; no bound holds it back"
    else:
        yield "no bound holds it back: let more vary, add designs, or raise the budget"
