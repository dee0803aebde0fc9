"""The plain table of a stitch chart."""

import csv
import io

import numpy as np

from knitlab.knitting.chart import StitchChart
from knitlab.knitting.knit_stitches import electrode_name

KNIT, PURL = "k", "p"
"""Letters of a stitch of the front and of the back bed, as in knitting instructions."""


def chart_table(chart: StitchChart) -> str:
    """A chart as comma-separated text, the last course first, as the fabric is seen.

    Returns:
        A line for each course: its number, and for each wale ``k`` for a stitch of the front bed
        and ``p`` for one of the back bed, with the letter of its electrode if it is plated.
    """
    letters = np.where(chart.front, KNIT, PURL).astype(object)
    for number in chart.electrodes:
        letters[chart.plated == number] += electrode_name(number)
    file = io.StringIO()
    table = csv.writer(file, lineterminator="\n")
    table.writerow(["course", *range(1, chart.wales + 1)])
    for course in range(chart.courses, 0, -1):
        table.writerow([course, *letters[course - 1]])
    return file.getvalue()
