"""Files of machines as back ends write them, read back: which bed knits, with which carriers."""

import re
import struct
from collections import defaultdict

import numpy as np

FRONT_KNIT, BACK_KNIT = 51, 52  # colours of a .dat
LEFT, RIGHT, BELOW = 55, 4, 8  # pixels of a .dat beside and below its stitches
OF_CARRIERS = 6  # pixels from the stitches to the option that holds the carriers
NO_CARRIERS = 255
BEFORE_BED = 15  # places of k-code before needle 1


def read_dat(content, wales, body):
    """(front, carriers) of every stitch with the body's carrier, by needle in order."""
    width, height = (last + 1 for last in struct.unpack("<HH", content[4:8]))
    lengths = np.frombuffer(content[0x600:], np.uint8)
    pixels = np.repeat(lengths[::2], lengths[1::2]).reshape(height, width)
    stitches = defaultdict(list)
    for row in pixels[BELOW:].tolist():
        carriers = row[LEFT + wales + RIGHT + OF_CARRIERS]
        if carriers == NO_CARRIERS or str(body) not in str(carriers):
            continue
        for wale, colour in enumerate(row[LEFT : LEFT + wales]):
            if colour in (FRONT_KNIT, BACK_KNIT):
                stitches[wale].append((colour == FRONT_KNIT, str(carriers)))
    return stitches


def read_kcode(text, body):
    """The same of k-code."""
    stitches, selected = defaultdict(list), {}
    for line in text.splitlines():
        if bed := re.match("(FRNT|REAR):(.*)", line):
            selected[bed[1]] = re.sub(r"[/\\0-9]", "", bed[2])[BEFORE_BED:]
        elif (done := re.match(r"(?:>>|<<) Kn-Kn (\d) ", line)) and done[1] == str(body):
            for name, needles in selected.items():
                for place in re.finditer("-", needles):
                    stitches[place.start()].append((name == "FRNT", done[1]))
    return stitches


def assert_knits(stitches, chart, machine):
    """The stitches are those of a chart, with its conductors on their faces."""
    chains = [stitches[needle] for needle in sorted(stitches)]
    first, body = machine.setup_courses, str(machine.body_carrier)
    assert len(chains) == chart.wales
    for wale, chain in enumerate(chains):
        for course, (front, carriers) in enumerate(chain[first : first + chart.courses]):
            assert front == chart.front[course, wale]
            expected = body
            if number := int(chart.plated[course, wale]):
                conductor = str(machine.carrier_of(number))
                on_face = (chart.plated_face[number - 1] == "front") == front
                expected = conductor + body if on_face else body + conductor
            assert carriers == expected
