"""Invalid input is answered before anything slow is imported, by every command."""

import json
import subprocess
import sys

import knitlab as kl
from tests.refusals import refused

SLOW = ("jax", "xarray", "pandas", "scipy", "matplotlib", "dask")
INVALID = (
    ["run", "preview", "--set", "foo"],
    ["run", "preview", "--set", "strain_max=-1"],
    ["run", "nowhere"],
    ["run", "periodic", "--shard", "9/3"],
    ["run", "periodic", "--case-timeout", "1e99"],
    ["plan", "preview", "--set", "n_stripe=5"],
    ["plan", "sensor", "--set", "layout=foo"],
    ["submit", "periodic", "--parts", "2", "--set", "pattern=foo"],
    ["branches", "--set", "foo=2"],
    ["shapes", "--set", "k_s_factor=0"],
    ["knit", "periodic", "--set", "foo"],
    ["knit", "nowhere"],
    ["shape", "nowhere.svg"],
    ["shape", "README.md", "--set", "foo"],
    ["fit", "results/reference/laboratory", "periodic", "--set", "foo"],
    ["settings", "no such word"],
    ["query", "nowhere"],
    ["map", "nothing", "results/reference/periodic", "-o", "map.png"],
    ["map", "curves", "results/reference/periodic", "-o", "map.xyz"],
    ["export", "results/reference/periodic", "-o", "shape.xyz"],
    ["sensing", "nowhere"],
    ["explore", "nowhere"],
    ["claims", "nowhere"],
    ["compare", "nowhere", "nowhere"],
    ["plate", "nowhere"],
    ["law", "nowhere"],
    ["wear", "results/reference/law", "--limb", "nowhere.csv"],
    ["design", "nowhere.toml"],
    ["read", "nowhere.txt"],
    ["calibrate", "nowhere.csv", "--stripe", "rib", "-n", "4"],
    ["import", "tensile", "nowhere.toml"],
    ["merge", "nowhere"],
)
PROGRAM = """
import json, sys
sys.argv[0] = "knitlab"
from knitlab.cli import main
answers = []
for words in json.loads(sys.argv[1]):
    try:
        main(words)
    except SystemExit as ended:
        answers.append([words, ended.code, sorted({*json.loads(sys.argv[2])} & {*sys.modules})])
print(json.dumps(answers))
"""


def test_nothing_slow_is_imported_before_invalid_input_is_answered():
    words = [sys.executable, "-c", PROGRAM.lstrip(), json.dumps(INVALID), json.dumps(SLOW)]
    done = subprocess.run([*words], capture_output=True, text=True)
    answers = json.loads(done.stdout.splitlines()[-1])
    assert answers == [[each, 2, []] for each in INVALID]
    assert len(done.stderr.splitlines()) >= len(INVALID)


def test_a_folder_without_a_cube_names_the_cubes_in_it(tmp_path):
    (tmp_path / "merino" / "periodic").mkdir(parents=True)
    (tmp_path / "merino" / "periodic" / "cube.nc").touch()
    with refused("merino", "cube.nc", "merino/periodic"):
        kl.query(tmp_path / "merino")
