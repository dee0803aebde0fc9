"""Invalid values are InputError from the constructors of all public settings, at once."""

import numpy as np
import pytest

import knitlab as kl
from tests.refusals import refused

STRIPE = {"knit": "rib", "n": 4, "period": 1.4, "k_s": 0.8, "theta_0": 0.7, "k_t": 0.01}
RIB = kl.Stripe(**STRIPE)
CAPACITOR = {
    "layout": kl.ElectrodeLayout(),
    "electrode_length": 10.0,
    "permittivity": 1.0,
    "clearance": 0.1,
    "accuracy": 0.05,
    "linearity": 0.99,
    "unfolded": 0.1,
}


@pytest.mark.parametrize(
    ("kind", "values", "field", "given"),
    [
        (kl.Pattern, {"rows": ("GX", "RG")}, "column 2", "X"),
        (kl.Pattern, {"rows": ("GR",), "map": "a.txt"}, "rows and map", "one of"),
        (kl.Pattern, {"row": ("GR",)}, "row", "spelling"),
        (kl.Pattern, {"rows": ("GR",), "column_stitches": (0, 4)}, "column_stitches", "0"),
        (kl.Model, {"cell_size": "folded"}, "cell_size", "folded"),
        (kl.Model, {"length_scale": -1.0}, "length_scale", "-1"),
        (kl.Model, {"cells_per_period": 5}, "cells_per_period", "5"),
        (kl.Design, {"n_stripe": 4, "n_subunit": 17}, "n_subunit", "17"),
        (kl.Design, {"n_stripe": 4, "n_subunit": 16, "boundary": "open"}, "boundary", "open"),
        (kl.Design, {"n_stripe": 4, "n_subunit": 16, "unit_cells": (0, 1)}, "unit_cells", "0"),
        (kl.Design, {"n_stripe": 4, "n_subunit": 16, "needles": -3}, "needles", "-3"),
        (kl.Design, {"n_stripe": 4, "n_subunit": 16, "pattern": ("GX", "RG")}, "pattern", "X"),
        (kl.Stripe, STRIPE | {"period": -1.0}, "period", "-1"),
        (kl.Stripe, STRIPE | {"knit": "purl"}, "knit", "purl"),
        (kl.Stripe, STRIPE | {"theta_0": 4.0}, "theta_0", "4"),
        (kl.Stripe, STRIPE | {"k_s": float("nan")}, "k_s", "nan"),
        (kl.Stripe, STRIPE | {"k_t": float("inf")}, "k_t", "inf"),
        (kl.Sheet, {"z_max": 0.0, "k_wall": 100.0}, "z_max", "0"),
        (kl.PlainKnit, dict.fromkeys(vars(kl.defaults().plain), -2.0), "plain_bend_warp", "-2"),
        (kl.Capacitor, CAPACITOR | {"permittivity": 0.5}, "permittivity", "0.5"),
        (kl.Capacitor, CAPACITOR | {"layout": "wale"}, "layout", "wale"),
        (kl.ElectrodeLayout, {"along": "bias"}, "along", "bias"),
        (kl.ElectrodeLayout, {"ridges": (0, 1)}, "ridges", "0"),
        (kl.ElectrodeLayout, {"mask": ("AX",)}, "mask", "X"),
        (kl.Protocol, {"strain_max": -0.1}, "strain_max", "-0.1"),
        (kl.Protocol, {"strain_most": 0.1}, "strain_most", "spelling"),
        (kl.Solver, {"tolerance": -1.0}, "tolerance", "-1"),
        (kl.Solver, {"max_iterations": [1, 2]}, "max_iterations", "list"),
        (kl.ElectrodeLayout, {"width": "wide"}, "width", "wide"),
        (kl.Dynamics, {"ending": "never"}, "ending", "never"),
        (kl.Friction, {"fold_friction": -1.0}, "fold_friction", "-1"),
        (kl.Gauge, {"stitch_width": 0.0, "stitch_height": 1.0}, "stitch_width", "0"),
        (kl.Material, {"stripes": ()}, "stripes", "give"),
        (kl.Material, {"stripes": (RIB, RIB)}, "rib 4", "twice"),
        (kl.Material, {"stripes": (RIB,), "z_max": -1.0}, "z_max", "-1"),
        (kl.Material, {"stripes": (RIB,), "surface_density": -2}, "surface_density", "-2"),
        (kl.Material, {"stripes": (RIB,), "stitch_size": -1}, "stitch_size", "-1"),
        (kl.Material, {"stripes": (RIB,), "plated_stitch_size": "a"}, "plated_stitch_size", "a"),
        (kl.Material, {"stripes": (RIB,), "yarn": "two\nlines"}, "yarn", "printed"),
        (kl.Material, {"stripes": (RIB,), "machine": ""}, "machine", "1 character"),
        (kl.Material, {"stripes": (RIB,), "name": "\u202ea"}, "name", "printed"),
        (kl.Material, {"stripes": (RIB,), "name": "a" * 501}, "name", "500"),
    ],
)
def test_an_invalid_value_is_an_input_error_that_names_it(kind, values, field, given):
    with pytest.raises(kl.InputError) as error:
        kind(**values)
    text = str(error.value)
    assert field in text
    assert given in text


def test_all_invalid_values_are_named_at_once():
    with pytest.raises(kl.InputError) as error:
        kl.Model(cell_size="folded", length_scale=0.0)
    assert {"cell_size", "length_scale"} <= {
        each.path.split(": ")[-1] for each in error.value.mistakes
    }


def test_numbers_of_numpy_are_numbers():
    stripe = kl.Stripe(**STRIPE | {"n": np.int64(4), "period": np.float32(1.5)})
    assert stripe.period == 1.5


def test_one_text_is_read_as_a_list_of_it():
    of_stripe = kl.plan("preview", ["n_stripe=4"])
    assert kl.plan("preview", "n_stripe=4").cases == of_stripe.cases
    with refused("electrodes", "w1", "two"):
        kl.capacitance_matrix("results/reference/sensor", "w1", n_stripe=4, n_subunit=16)
