"""Summary of a design: candidates, active bounds, and values that are hardly determined."""

from collections.abc import Iterator, Sequence

from knitlab.inverse.design import Designed
from knitlab.inverse.search import SearchResult
from knitlab.inverse.search_space import DesignLabels


def summary(designed: Designed) -> Iterator[str]:
    """Lines about each candidate, the best first, and about targets that could not be met."""
    dims = [str(dim) for dim in designed.cube["status"].dims if dim != "candidate"]
    searches = [(n, designed.searches[n - 1]) for n in map(int, designed.table["candidate"])]
    for number, search in searches:
        yield from _of_candidate(number, search, dims)
    if not designed.met:
        found = [search for _, search in searches]
        nearest = [*found, *(each for each in designed.searches if each.winner is not None)][0]
        yield from _unmet(designed, nearest)
    if designed.unknown:
        labels = "; ".join(_labels(dims, design) for design in designed.unknown)
        yield f"not considered, as no cube has results of them: {labels}"


def _labels(dims: Sequence[str], design: DesignLabels) -> str:
    return "  ".join(f"{dim} {label}" for dim, label in zip(dims, design, strict=True))


def _of_candidate(number: int, search: SearchResult, dims: Sequence[str]) -> Iterator[str]:
    best = search.winner.values if search.winner else {}
    values = ", ".join(f"{name} {value:.4g}" for name, value in best.items())
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


def _unmet(designed: Designed, nearest: SearchResult) -> Iterator[str]:
    off_by = nearest.winner.off_by if nearest.winner else []
    for target, off in zip(designed.request.wanted, off_by, strict=True):
        if off is not None and off > target.allowance:
            yield f"not met: {target.text}: the nearest is off by {off:.4g}"
    if nearest.held_by:
        yield f"held back by {', '.join(nearest.held_by)}: widen it, or relax a target"
    elif (conflict := designed.conflict) is not None:
        one, other = conflict.targets
        yield f"{one!r} and {other!r} conflict; no bound holds it back"
    else:
        yield "no bound holds it back: let more vary, add designs, or raise the budget"
