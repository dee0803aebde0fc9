"""Settings that are refused, each with its name, its value and what may be given."""

import pytest

from knitlab.io.errors import InputError
from knitlab.runs.plan import make_plan

DESIGN = ("n_stripe=4", "n_subunit=16", "robustness=0")


@pytest.mark.parametrize(
    ("overrides", "message"),
    [
        # designs
        ("n_stripe=5 n_subunit=20", "n_stripe = 5"),
        ("n_subunit=18", "n_subunit = 18"),
        ("n_stripe=4,6 n_subunit=10,14", "multiple"),
        ("set=papers", "'papers'"),
        ("unit_cells=3", "settings unit_cells=3: value 2: "),
        ("unit_cells=[[1,1],[0,1]]", "value 2: .*greater than 0"),
        ("pattern=RG,R", "rectangle"),
        ("pattern=checkerbord", "'checkerbord'.*'checkerboard'"),
        # names and values
        ("n_strip=4", "'n_strip'.*'n_stripe'"),
        ("design.z_max=4", r"\[model\].*model\.z_max"),
        ("n_stripe", "KEY=VALUE"),
        ("cell_size=loose", "settings cell_size=loose: .*'flat'"),
        ("k_wall=1,-2", "settings k_wall=1,-2: value 2: .*greater than 0"),
        ("z_max=4,4", "twice"),
        ("theta_0_factor=9", "below pi"),
        ("stitch_width=1,2", r"stitch_width=1,2: .*\[1, 2\]"),
        ("stitch_height=-1", "settings stitch_height=-1: "),
        ("period_factor=[]", r"\[\]"),
        ("width=wide", "settings width=wide: .*'stripe'"),
        ("mask=AB..", "settings mask=AB..: .*1 rows of 4"),
        ("layout=none", "settings layout=none: .*'none'.*checkerboard"),
        # strains
        ("strain_step=0", "settings strain_step=0: "),
        ("strain_step=1e-9", "1000"),
        ("strain_max=0.1", "strain_step = 0.03"),
        # drag, friction and cycles
        ("drag=1e-5", "boundary = clamped"),
        ("drag=1e-5 boundary=clamped sensitivities=true", "drag=1e-5: .*sensitivities"),
        ("fold_friction=-1", "fold_friction.*greater than or equal to 0"),
        ("fold_friction=0.1 boundary=clamped drag=0.1", "drag"),
        ("fold_drift=0.1 sensitivities=true", "sensitivities"),
        ("cycle=0", "cycle.*greater than or equal to 1"),
        ("cycle=2 method=dynamics", "method = equilibrium"),
        ("fold_drift=0.1 method=dynamics", "fold_drift=0.1: "),
        # loads
        (
            "load=of_axis",
            "'warp', 'weft', 'biaxial', 'biaxial_weft', 'shear' or 'off_axis'",
        ),
        ("load=biaxial", "load_ratio"),
        ("load=biaxial load_ratio=nan", "finite"),
        ("load=biaxial load_ratio=1,1e9", r"load_ratio = 4.5e\+08"),
        ("load=warp,biaxial load_ratio=-0.9 strain_max=1.2", r"load_ratio = -1\.08"),
        ("load=off_axis", "load_angle"),
        ("load=off_axis load_angle=270", "less than 180"),
        ("load=off_axis load_angle=30 boundary=clamped", "clamps"),
        ("load=weft sensitivities=true", "sensitivities"),
        ("load=shear method=dynamics", "method = equilibrium"),
        ("load=shear layout=checkerboard", "electrodes"),
    ],
)
def test_a_bad_override_is_named(overrides, message):
    with pytest.raises(InputError, match=message):
        make_plan("periodic", (*DESIGN, *overrides.split()))


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"n_strip": 4}, "n_strip=4: .*'n_stripe'"),
        ({"cell_size": ["flat", "loose"]}, "cell_size=.*: value 2: .*'flat'"),
        ({"n_stripe": 4.5}, "n_stripe=4.5: value 1: .*integer"),
        ({"n_stripe": 10}, "'preview'.*n_stripe = 10"),
        ({"z_max": None}, "z_max: .*None"),
        ({"z_max": [1.0, {}]}, r"z_max: .*\[1.0, {}\]"),
    ],
)
def test_an_invalid_python_value_is_named_with_its_key(settings, message):
    with pytest.raises(InputError, match=message) as caught:
        make_plan("periodic", settings)
    assert len(caught.value.mistakes) == 1


def test_a_missing_workflow_and_a_load_of_stripes_are_refused():
    with pytest.raises(InputError, match=r"'previews'.*'preview'"):
        make_plan("previews")
    with pytest.raises(InputError, match="across their ridges"):
        make_plan("stripes", ("load=weft",))
