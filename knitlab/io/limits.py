"""Limits on what users give and on what messages list."""

MAX_NAME = 100  # characters of a name that becomes that of a folder; file systems take 255 bytes
MAX_LINE = 500  # characters of a title, or of the name of a material
MAX_SHOWN = 500  # characters of a value that a message shows
MAX_LISTED = 200  # mistakes of a file that a message lists
MAX_CHOICES = 20  # known names that a message lists
MAX_CASES_NAMED = 5  # cases that a message names
MAX_TEXT = 100_000_000  # bytes of a chart, a map of patches or a knitting program
MAX_STITCHES = 1_000_000  # of a chart, and patches of a map
MAX_SIDE = 10_000  # courses or wales of a chart, or characters of its rows; patches of a map
MAX_CASES = 100_000  # cases of a plan, and shards of one
MAX_CASE_TIMEOUT = 1e6  # of one case [s]; timers take no more for a batch of many
