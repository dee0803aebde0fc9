"""The paper's claims, judged by cubes."""

from pathlib import Path
from typing import Any

import pandas as pd

from knitlab.validation.claims import read_claims
from knitlab.validation.judgement import judged, records


def claims(*cubes: str | Path, output: str | Path | None = None, **selections: Any) -> pd.DataFrame:
    """Judge the paper's claims by cubes: each holds, nearly holds, fails, or is not measured.

    Args:
        cubes: cubes or results folders; if several measure a claim, the one with the paper's
            samples decides it.
        output: report to write, ``.html`` or ``.md``.
        selections: a value for each swept setting.

    Returns:
        One row for each claim, with its verdict, margin, and the cube that decided it.

    Raises:
        BadInput: if a cube, a selection or the suffix of the page is at fault.

    Example:
        >>> import knitlab as kl
        >>> table = kl.claims("results/reference/paper")
        >>> len(table)
        39
    """
    judgements = judged(read_claims(), [Path(cube) for cube in cubes], selections)
    if output is not None:
        # Matplotlib is imported only to write a report.
        from knitlab.figures.report.page import check_suffix, write_page

        check_suffix(Path(output))
        write_page(judgements, Path(output), selections)
    return pd.DataFrame(records(judgements))
