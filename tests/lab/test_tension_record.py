"""Records of a testing machine: units, repeats, cycles and noise, and what is refused."""

from dataclasses import replace

import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import knitlab as kl
from knitlab import InputError, read_tension_record
from knitlab.lab.tension_record import relaxed_period
from knitlab.model.pure_stripe import PureStripe
from knitlab.model.settings import ModelOptions
from knitlab.model.stripe import cell_length
from tests.fabrics import compiled_tension_across, stripe
from tests.refusals import refused

GOOD = "strain [1],force [N]\n0,0\n0.1,0.2\n0.2,0.5\n0.3,0.9\n"


def written(tmp_path, text):
    path = tmp_path / "curve.csv"
    path.write_text(text)
    return path


@pytest.mark.parametrize(
    ("header", "strain", "force", "options"),
    [
        ("strain [1],force [N]", 1, 1, {}),
        ("Strain [%], Force [cN]", 100, 100, {}),
        ("strain [mm/mm],force [mN],time [s]", 1, 1000, {}),
        ("Axial strain (%),Load (N)", 100, 1, {}),
        ("extension [mm],force [N]", 80, 1, {"gauge_length": 80.0}),
        ("Extension (cm),Load (N)", 8, 50, {"gauge_length": 80.0, "width": 50.0}),
        ("strain [1],stress [N/mm]", 1, 1, {}),
        ("strain [1],stress [N/m]", 1, 1000, {}),
        ("strain [1],stress [MPa]", 1, 1 / 2, {"thickness": 2.0}),
        ("strain [1],stress [kPa]", 1, 1000 / 2, {"thickness": 2.0}),
    ],
)
def test_units_of_the_header_are_converted(tmp_path, header, strain, force, options):
    extra = ",7" if "time" in header else ""
    strains, forces = [0.0, 0.1, 0.1, 0.3, 0.4], [0.0, 0.2, 0.5, 0.9, 1.0]
    rows = [f"{strain * a},{force * b}{extra}" for a, b in zip(strains, forces, strict=True)]
    path = written(tmp_path, "\n".join(["# a comment", header, *rows]))
    curve = read_tension_record(path, **options)
    np.testing.assert_allclose(curve.strain, strains)
    np.testing.assert_allclose(curve.force, [forces])
    assert curve.per_width == ("stress" in header or "width" in options)


EXPORTS = {
    "testXpert": (
        "Prüfprotokoll;\nPrüfer;A. Müller\nMessrate;10,5;Hz\n\nProbe 1\n"
        "Prüfzeit;Standardweg;Standardkraft\ns;mm;N\n",
        "{t};{e};{f}",
    ),
    "testXpert, strain": ("Zeit [s];Dehnung [%];Kraft [N]\n", "{t};{s};{f}"),
    "testXpert, quoted": ('"Dehnung";"Standardkraft"\n"%";"N"\n', '"{s}";"{f}"'),
    "with in": ("Traversenweg in mm;Kraft in N;Zyklus\n", "{e};{f};1"),
    "with a stroke": ("Weg / mm;Kraft / N\n", "{e};{f}"),
    "testXpert, English": ("Standard travel\tStandard force\nmm\tN\n", "{e}\t{f}"),
    "force standard": ("Travel (mm),Force standard (N)\n", "{e},{f}"),
    "Bluehill": (
        'Results Table 1\n,Maximum Load\n,(N)\n1,1.0\n\n"Time","Extension","Load"\n'
        '"(s)","(mm)","(N)"\n',
        '"{t}","{e}","{f}"',
    ),
    "Bluehill, German": (
        "Probe;Zeit (s);Verlängerung (mm);Last (N);Zugdehnung (%)\n",
        "1;{t};{e};{f};{s}",
    ),
    "Bluehill, one row": ("Time (s),Tensile strain (mm/mm),Tensile stress (MPa)\n", "{t},{r},{f}"),
    "MTS": ("Crosshead \tLoad \tTime \nmm \tN \tsec \n", "{e}\t{f}\t{t}"),
    "MTS, axial": ("Axial Displacement (mm)\tAxial Force (kN)\n", "{e}\t{k}"),
    "elongation, relative": ("Elongation [%],Force [N]\n", "{s},{f}"),
    "elongation, absolute": ("Elongation [mm],Force [N]\n", "{e},{f}"),
}
"""Headers as programs of testers write them, and a row."""


@pytest.mark.parametrize("export", EXPORTS)
@pytest.mark.parametrize("encoding", ["utf-8", "cp1252"])
def test_what_testers_export_is_read(tmp_path, export, encoding):
    header, row = EXPORTS[export]
    strains, forces = np.linspace(0, 0.5, 12), np.linspace(0, 3, 12)
    rows = [
        row.format(t=f"{10 * s:.2f}", e=f"{80 * s:.6f}", s=f"{100 * s:.6f}", r=s, f=f, k=f / 1000)
        for s, f in zip(strains, forces, strict=True)
    ]
    if ";" in row:
        rows = [each.replace(".", ",") for each in rows]
    path = tmp_path / "export.csv"
    path.write_bytes((header + "\n".join(rows) + "\n").encode(encoding))
    sizes = {"gauge_length": 80.0} | ({"thickness": 1.0} if "stress" in header else {})
    record = read_tension_record(path, **sizes)
    np.testing.assert_allclose(record.strain, strains, atol=1e-7)
    np.testing.assert_allclose(record.force, [forces], atol=1e-7)


@pytest.mark.parametrize(
    ("header", "parts"),
    [
        ("Dehnung [mm],Kraft [N]", ("Dehnung: is in mm", "[%]", "extension")),
        ("Weg [%],Kraft [N]", ("Weg: is in %", "[mm]", "strain")),
        ("Dehnung [%],Spannung [V]", ("Spannung: is in V", "[N/mm]")),
        ("Dehnung [%],Kraft [mm]", ("Kraft: is in mm", "of force")),
        ("Dehnung,Kraft [N]", ("Dehnung: has no unit",)),
        ("Weg [mm],Traversenweg [mm],Kraft [N]", ("Traversenweg", "Weg", "export one")),
        ("Dehnung [%],Kraft [N],Dehnung [%],Kraft [N]", ("Dehnung: occurs twice", "table")),
        ("Elongation [N],Kraft [N]", ("Elongation: is in N",)),
    ],
)
def test_what_can_be_read_two_ways_is_refused(tmp_path, header, parts):
    width = header.count(",") + 1
    rows = [",".join([f"{k / 10}"] * width) for k in range(9)]
    with refused(*parts):
        read_tension_record(written(tmp_path, "\n".join([header, *rows])), gauge_length=80.0)


@pytest.mark.parametrize(
    ("old", "new", "options", "parts"),
    [
        ("[N]", "", {}, ("column force", "unit")),
        ("strain [1]", "strain", {}, ("column strain", "unit")),
        ("[N]", "[mm]", {}, ("is in mm", "of force")),
        ("[N]", "[wurble]", {}, ("'wurble'",)),
        ("strain [1]", "strain [deg]", {}, ("is in deg",)),
        ("strain [1]", "strain [dB]", {}, ("is in dB",)),
        ("strain [1]", "time [s]", {}, ("column strain", "is missing")),
        ("force [N]", "pull [N]", {}, ("force and stress", "neither")),
        ("0.2,0.5", "0.2,nan", {}, ("point 3 is 'nan'",)),
        ("0.2,0.5", "0.2,", {}, ("point 3 is empty",)),
        ("0.2,0.5", "0.2,0.5,3", {}, ("line 4",)),
        ("strain [1]", "extension [mm]", {}, ("needs the gauge_length",)),
        ("", "", {"cycle": 2}, ("1 cycles", "not cycle 2")),
        ("0,0\n", "-1,0\n", {}, ("-1", "from 0 up")),
        ("0.2,0.5\n0.3,0.9\n", "", {}, ("2 points", "at least 4")),
        (GOOD[19:], "", {}, ("table of numbers",)),
        ("", "", {"thickness": 0.3}, ("thickness 0.3", "stress")),
        ("force [N]", "stress [N/mm]", {"width": 3.0}, ("width 3", "force")),
        ("force [N]", "stress [MPa]", {}, ("thickness",)),
        ("force", "strain", {}, ("occurs twice",)),
    ],
)
def test_a_bad_curve_is_refused(tmp_path, old, new, options, parts):
    with refused(*parts):
        read_tension_record(written(tmp_path, GOOD.replace(old, new)), **options)


def test_of_force_and_stress_the_stated_length_says_which_is_read(tmp_path):
    strain, force = np.linspace(0, 1, 20), np.linspace(0, 3, 20) ** 2
    rows = [f"{e},{60 * e},{f},{f / (50 * 2)}" for e, f in zip(strain, force, strict=True)]
    header = "Strain (1),Displacement (mm),Load (N),Stress (MPa)"
    path = written(tmp_path, "\n".join([header, *rows]))
    for lengths, left in (({"width": 50.0}, "Stress"), ({"thickness": 2.0}, "Load")):
        record = read_tension_record(path, **lengths)
        np.testing.assert_allclose(record.force, [force / 50], atol=1e-12)
        assert any(f"not {left}" in line for line in record.summary)
    for lengths in ({}, {"width": 50.0, "thickness": 2.0}):
        with refused("Load", "Stress", "width = ", "thickness = "):
            read_tension_record(path, **lengths)
    np.testing.assert_allclose(read_tension_record(path, width=50.0).strain, strain)
    along_machine = read_tension_record(path, width=50.0, gauge_length=40.0)
    np.testing.assert_allclose(along_machine.strain, 1.5 * strain)


@pytest.mark.parametrize("title", [True, False])
@pytest.mark.parametrize("repeated", [True, False])
def test_tables_below_each_other_are_repeats(tmp_path, title, repeated):
    lines = []
    for number in (1, 2, 3):
        lines += ["", *[f"Specimen {number}"] * title]
        lines += ["Extension (mm),Load (N)"] * (repeated or number == 1)
        lines += [f"{e:.4f},{number * e**2:.4f}" for e in np.linspace(0, 100, 41)]
    path = written(tmp_path, "\n".join(lines))
    record = read_tension_record(path, gauge_length=50.0)
    np.testing.assert_allclose(record.mean_force, record.force[1])
    np.testing.assert_allclose(record.force[2], 3 * record.force[0])
    assert "3 tables" in record.summary[1]
    second = read_tension_record(path, gauge_length=50.0, table=2)
    np.testing.assert_allclose(second.force, [2 * (50 * second.strain) ** 2], atol=1e-3)
    assert "not read" in second.summary[1]
    with refused("table 1", "table = "):
        kl.read_cycles(path, gauge_length=50.0)


@pytest.mark.parametrize("points", [5, 10, 30])
def test_a_few_readings_of_several_repeats_are_interpolated(tmp_path, points):
    rows = [f"{r},{e},{r * e}" for r in (1, 3) for e in np.linspace(0, 1, points)]
    record = read_tension_record(
        written(tmp_path, "\n".join(["repeat,strain [1],force [N]", *rows]))
    )
    np.testing.assert_allclose(record.mean_force, 2 * record.strain, atol=1e-9)
    late = [f"3,{e},{e}" for e in np.linspace(2, 3, points)]
    text = "\n".join(["repeat,strain [1],force [N]", *rows[:points], *late])
    with refused("strain 2 on", "up to 1", "table"):
        read_tension_record(written(tmp_path, text), zero="none")


RIB = replace(stripe("rib", 4), period=10.0)
GAUGE_LENGTH, WIDTH = 80.0, 60.0
ROW = float(cell_length(RIB, ModelOptions(cell_size="relaxed")))


def pulls(strain, factor=1.0):
    """Force of a swatch of the stripe, as wide as WIDTH."""
    force = compiled_tension_across(PureStripe.of(RIB), jnp.maximum(jnp.asarray(strain), 0.0))
    return factor * WIDTH / ROW * np.asarray(force)


def raw_record(tmp_path, seed=0, repeats=5, peaks=(0.6, 2.0, 2.0), noise=0.01, softening=0.8):
    """What a tester writes: cycles, noise, small negative values, and repeats that differ."""
    random = np.random.default_rng(seed)
    rows = ["Specimen,Time (s),Extension (mm),Load (N)"]
    for repeat in range(1, repeats + 1):
        strain = np.concatenate(
            [np.concatenate([np.linspace(0, p, 150), np.linspace(p, 0, 150)]) for p in peaks]
        )
        rising = np.gradient(strain) >= 0
        force = pulls(strain, 1 + 0.03 * (repeat - 3)) * np.where(rising, 1.0, softening)
        force = force + noise * random.normal(size=len(force))
        extension = GAUGE_LENGTH * strain + 0.05 * random.normal(size=len(strain))
        rows += [
            f"{repeat},{k},{e:.4f},{f:.4f}"
            for k, (e, f) in enumerate(zip(extension, force, strict=True))
        ]
    path = tmp_path / "raw.csv"
    path.write_text("\n".join(rows))
    return path


@pytest.mark.slow
def test_a_raw_record_gives_the_stripe_that_it_was_made_of(tmp_path):
    record = read_tension_record(raw_record(tmp_path), gauge_length=80.0, width=WIDTH, cycle=2)
    assert record.per_width
    assert record.force.shape[0] == 5
    assert "loading of cycle 2" in record.summary[0]
    fit = kl.calibrate(record.strain, record.force, period=10.0, per_width=True)
    assert fit.usable
    for name in ("k_s", "k_t", "theta_0"):
        low, high = fit.intervals[name]
        assert low <= getattr(RIB, name) <= high
        assert fit.values[name] == pytest.approx(getattr(RIB, name), rel=0.05)
    # Repeats differ by 1.5 % of k_s and k_t on average; the points alone would hide that.
    scatter = 0.03 * np.std([-2, -1, 0, 1, 2], ddof=1) / np.sqrt(5)
    assert fit.standard_errors["k_t"] / fit.values["k_t"] == pytest.approx(scatter, rel=0.3)
    one = kl.calibrate(record.strain, record.force.mean(axis=0), period=10.0, per_width=True)
    assert one.standard_errors["k_t"] < fit.standard_errors["k_t"]


def test_of_cycles_one_loading_branch_is_taken(tmp_path):
    path = raw_record(tmp_path, repeats=1, noise=0.0)
    curves = {}
    for cycle in (1, 2):
        record = read_tension_record(path, gauge_length=80.0, width=WIDTH, cycle=cycle)
        np.testing.assert_allclose(
            record.force[0], pulls(record.strain, 0.94) / WIDTH, atol=0.01 * record.force.max()
        )
        curves[cycle] = record.strain.max()
    assert curves[1] < 0.62 < 1.9 < curves[2]


@pytest.mark.slow
def test_forces_over_the_width_are_those_of_rows_as_wide_as_cells_are_long():
    strain = np.linspace(0.0, 2.0, 30)
    force = np.asarray(compiled_tension_across(PureStripe.of(RIB), jnp.asarray(strain)))
    per_row = kl.calibrate(strain, force, period=10.0)
    per_width = kl.calibrate(strain, force / ROW, period=10.0, per_width=True)
    for name, value in per_row.values.items():
        assert per_width.values[name] == pytest.approx(value, rel=1e-6)


@pytest.mark.slow
@settings(deadline=None, max_examples=20)
@given(shift=st.floats(-0.01, 0.01), seed=st.integers(0, 100))
def test_records_that_start_off_zero_are_cut_there(tmp_path_factory, shift, seed):
    folder = tmp_path_factory.mktemp("record")
    strain = np.linspace(shift, 1.0, 200) + 0.002 * np.random.default_rng(seed).normal(size=200)
    rows = [f"{a},{b}" for a, b in zip(strain, pulls(strain), strict=True)]
    record = read_tension_record(written(folder, "\n".join(["strain [1],force [N]", *rows])))
    assert record.strain.min() >= 0
    assert np.all(np.diff(record.strain) > 0)
    np.testing.assert_allclose(
        record.force[0], pulls(record.strain), atol=0.02 * record.force.max()
    )


def test_the_period_follows_from_stitches():
    assert relaxed_period(4, gauge_length=80.0, gauge_stitches=64) == pytest.approx(10.0)
    assert relaxed_period(4, 10.0) == 10.0
    for twice in ({"period": 1.0, "gauge_stitches": 4.0}, {}, {"gauge_stitches": 4.0}):
        with pytest.raises(InputError):
            relaxed_period(4, **twice)


def gripped(tmp_path, tension=0.0, offset=0.0, noise=0.0, seed=3, repeats=1, points=200):
    """A spring of 2 N, gripped under a tension; the gauge length is that between the grips."""
    random = np.random.default_rng(seed)
    first, rows = tension / 2, []
    for repeat in range(1, repeats + 1):
        relaxed = np.linspace(first, first + 0.5, points)
        force = 2 * relaxed + offset + noise * random.normal(size=points)
        measured = (1 + relaxed) / (1 + first) - 1
        rows += [f"{repeat},{e:.9f},{f:.9f}" for e, f in zip(measured, force, strict=True)]
    return written(tmp_path, "\n".join(["repeat,strain [1],force [N]", *rows, ""]))


@pytest.mark.parametrize("noise", [0.0, 0.005])
@pytest.mark.parametrize(
    ("truth", "known"),
    [
        ({}, {}),
        ({"tension": 0.06}, {"preload": 0.06}),
        ({"offset": 0.06}, {"zero": "start"}),
        ({"offset": -0.06}, {"zero": "start"}),
        ({"offset": 0.06}, {"zero": 0.06}),
        ({"tension": 0.06, "offset": -0.06}, {"zero": "start", "preload": 0.06}),
        ({"tension": 0.06, "offset": 0.2}, {"zero": 0.2, "preload": 0.06}),
    ],
)
@pytest.mark.parametrize("width", [None, 50.0])
def test_a_known_start_gives_the_curve_of_the_spring(tmp_path, truth, known, noise, width):
    path = gripped(tmp_path, **truth, noise=noise, repeats=2)
    record = read_tension_record(path, width=width, **known)
    force = record.force * (width or 1.0)
    np.testing.assert_allclose(force, [2 * record.strain] * 2, atol=max(1e-6, 3 * noise))
    said = " ".join(record.summary)
    assert ("is subtracted from the force" in said) == ("zero" in known)
    assert ("preload of 0.06 N" in said and "%" in said) == ("preload" in known)
    one = kl.read_cycles(path, width=width, **known).passages[0]
    force = one.force * (width or 1.0)
    np.testing.assert_allclose(force, 2 * one.strain, atol=max(1e-6, 3 * noise))


@pytest.mark.parametrize("truth", [{"tension": 0.06}, {"offset": 0.06}, {"offset": -0.06}])
@pytest.mark.parametrize("noise", [0.0, 0.005])
@pytest.mark.parametrize("read", [read_tension_record, kl.read_cycles])
def test_a_force_at_zero_strain_is_refused_with_both_remedies(tmp_path, truth, noise, read):
    with pytest.raises(InputError) as caught:
        read(gripped(tmp_path, **truth, noise=noise))
    (message,) = str(caught.value).splitlines()
    size = float(message.split(" is ")[1].split(" N ")[0])
    assert size == pytest.approx(sum(truth.values()), abs=3 * noise + 1e-3)
    for part in ("noise of", "zero = start", "zero = none"):
        assert part in message
    assert ("preload = " in message) == (sum(truth.values()) > 0)
    kept = read_tension_record(gripped(tmp_path, **truth, noise=noise), zero="none")
    assert "kept" in kept.summary[1]
    np.testing.assert_allclose(kept.force[0, -1], 1 + sum(truth.values()), atol=4 * noise + 0.02)


@pytest.mark.slow
@pytest.mark.nightly
def test_noise_alone_is_rarely_taken_for_an_offset_and_a_large_offset_never_for_noise(tmp_path):
    """Three repeats with noise of 1 % of the largest force."""

    def refused(**truth):
        try:
            read_tension_record(gripped(tmp_path, noise=0.01, repeats=3, **truth))
        except InputError:
            return True
        return False

    assert np.mean([refused(seed=seed) for seed in range(60)]) <= 0.1
    assert all(refused(seed=seed, offset=0.05) for seed in range(20))


def test_readings_at_rest_give_the_force_at_zero_strain(tmp_path):
    """A curve that rises steeply at first: a parabola through its first tenth would miss that."""
    strain = np.concatenate([np.zeros(20), np.linspace(0, 1, 200)])
    force = 0.3 + strain + 0.2 * np.tanh(strain / 0.02)
    rows = [
        f"{e},{f + 0.001 * (-1) ** k}" for k, (e, f) in enumerate(zip(strain, force, strict=True))
    ]
    path = written(tmp_path, "\n".join(["strain [1],force [N]", *rows]))
    assert abs(read_tension_record(path, zero="start").force[0].min()) < 0.003


@pytest.mark.slow
def test_a_preloaded_stripe_is_counted_from_its_relaxed_length(tmp_path):
    """Independent: the sheet of three unknowns, stretched by 10 % when it is gripped."""
    swatch = replace(RIB, k_s=2.6, k_t=0.93, theta_0=0.74)
    relaxed = np.linspace(0.1, 2.2, 300)
    force = np.asarray(compiled_tension_across(PureStripe.of(swatch), jnp.asarray(relaxed)))
    force = force + 1e-3 * force.max() * np.random.default_rng(0).normal(size=len(relaxed))
    rows = [f"{e},{f}" for e, f in zip((1 + relaxed) / 1.1 - 1, force, strict=True)]
    path = written(tmp_path, "\n".join(["strain [1],force [N]", *rows]))
    record = read_tension_record(path, preload=force[:5].mean())
    assert record.strain.max() == pytest.approx(2.2, rel=0.02)
    assert "preload" in record.summary[1]


@pytest.mark.parametrize(
    ("truth", "known", "parts"),
    [
        ({"offset": 0.06}, {"preload": 0.3}, ("0.06 N", "0.3 N", "zero = start")),
        ({"tension": 0.06, "offset": -0.06}, {"preload": 0.06}, ("zero = start",)),
        ({"tension": 0.06}, {"zero": 0.05, "preload": 0.06}, ("0.01 N", "preload")),
        ({"offset": 3.0}, {"preload": 3.0}, ("no relaxed length", "preload of 3 N")),
        ({}, {"zero": "begin"}, ("zero", "'begin'", "none, start, or a number")),
        ({}, {"zero": float("nan")}, ("zero", "nan")),
        ({}, {"preload": -1.0}, ("preload", "-1 N", "above 0")),
    ],
)
def test_what_contradicts_the_record_is_refused(tmp_path, truth, known, parts):
    with refused(*parts):
        read_tension_record(gripped(tmp_path, **truth), **known)


def test_newtons_are_not_subtracted_from_a_stress_and_a_late_start_has_no_zero(tmp_path):
    stress = GOOD.replace("force [N]", "stress [N/mm]")
    for known in ({"zero": 0.1}, {"preload": 0.1}):
        (name,) = known
        with refused(name, "stress"):
            read_tension_record(written(tmp_path, stress), **known)
    late = GOOD.replace("0,0\n", "").replace("0.3,", "0.4,0.8\n0.5,")
    for known in ({"zero": "start"}, {"preload": 0.1}):
        with refused("near zero strain"):
            read_tension_record(written(tmp_path, late), **known)
    assert read_tension_record(written(tmp_path, late), zero=0.1).force.max() == pytest.approx(0.8)
