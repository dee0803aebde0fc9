"""Variables that no case file holds: of cubes, experiments, and tables of designs."""

from knitlab.observables.observable import REGISTRY, Group, curve, number

DESIGN = Group("design", "The sample")
STRIPES = Group("stripes", "Stripe parameters")
CLOTH = Group("cloth", "Sizes in cloth")
LABORATORY = Group("laboratory", "Experiments")
CANDIDATE = Group("candidate", "Candidates of a design")
DERIVED = Group("derived", "Derived when a cube is opened")
SAMPLE_OR_PERIOD = "of the simulated sample, or of the period of periodic fabric"
BY_GAUGE = (
    "by the cube's gauge (gauge_stitch_width and gauge_stitch_height, in mm), which changes"
    " no other variable. Sizes by the default gauge are approximate: samples are wider than the"
    " paper's. Ratios between designs do not depend on the gauge"
)
KNIT_CELL = f"relaxed over flat cell, times stitches across it, times size of a stitch, {BY_GAUGE}"
KNIT_WAVE = (
    "wavelength of the boundary, times the knit cell over the relaxed cell; missing"
    f" where it crosses a single unit cell; {BY_GAUGE}"
)
KNIT_SAMPLE = f"knit cell times unit cells; missing for periodic fabric; {BY_GAUGE}"
SCATTER = "of the curve that is fitted to the records near a strain"
WAVES = (
    "of the boundary whose wavelength is measured; unit cells that it crosses. Wavelength "
    "and amplitude from fewer than 3 waves can be wrong by more than 5 %"
)

REGISTRY.declare(
    DESIGN,
    {
        "unit_cells_y": number(
            "unit cells along the warp", description=SAMPLE_OR_PERIOD, integer=True
        ),
        "unit_cells_x": number(
            "unit cells along the weft", description=SAMPLE_OR_PERIOD, integer=True
        ),
    },
)
REGISTRY.declare(
    STRIPES,
    {
        "rib_period": number("period of the rib stripe", "mm", description="the paper's w"),
        "rib_k_s": number("extensional stiffness of the rib stripe", "N/mm"),
        "rib_theta_0": number("rest angle of the rib stripe", "rad"),
        "rib_k_t": number("torsional stiffness of the rib stripe", "N"),
        "garter_period": number("period of the garter stripe", "mm", description="the paper's h"),
        "garter_k_s": number("extensional stiffness of the garter stripe", "N/mm"),
        "garter_theta_0": number("rest angle of the garter stripe", "rad"),
        "garter_k_t": number("torsional stiffness of the garter stripe", "N"),
    },
)
REGISTRY.declare(
    CLOTH,
    {
        "knit_cell_x": number(
            "finished unit cell in cloth along the weft", "mm", description=KNIT_CELL
        ),
        "knit_cell_y": number(
            "finished unit cell in cloth along the warp", "mm", description=KNIT_CELL
        ),
        "knit_wavelength_x": number(
            "wavelength in cloth along the weft", "mm", description=KNIT_WAVE
        ),
        "knit_wavelength_y": number(
            "wavelength in cloth along the warp", "mm", description=KNIT_WAVE
        ),
        "knit_width": number(
            "finished width of the sample in cloth", "mm", description=KNIT_SAMPLE
        ),
        "knit_length": number(
            "finished length of the sample in cloth", "mm", description=KNIT_SAMPLE
        ),
    },
)
REGISTRY.declare(
    LABORATORY,
    {
        "mean_strain_xx_error": curve(
            "standard error of the mean transverse strain", description=SCATTER
        ),
        "mean_strain_yy_error": curve(
            "standard error of the mean axial strain", description=SCATTER
        ),
        "poisson_ratio_error": curve("standard error of Poisson's ratio", description=SCATTER),
        "reaction_force_error": curve(
            "standard error of the reaction force", "N", description=SCATTER
        ),
        "force_per_width": curve(
            "reaction force per width",
            "N/mm",
            description="of the relaxed sample between the clamps, in millimetres of cloth",
        ),
        "markers_lost": curve(
            "markers lost", description="corners of unit cells that are not seen", integer=True
        ),
        "cells_lost": curve(
            "unit cells lost",
            description="cells with a corner that is not seen; no mean includes them",
            integer=True,
        ),
    },
)
REGISTRY.declare(
    DERIVED,
    {
        "force_per_width_across": curve(
            "reaction force across the pull, per length along it",
            "N/mm",
            description="under biaxial loads, of the relaxed sample, in millimetres of cloth",
        ),
        "force_ratio": curve(
            "force_per_width_across over force_per_width",
            description="under biaxial loads, beside zero strain",
        ),
        "tangent_stiffness": curve(
            "tangent stiffness per width",
            "N/mm",
            description="derivative of force_per_width with respect to the applied strain",
        ),
        "stretch_energy": curve(
            "energy to stretch, per area",
            "N/mm",
            description=(
                "integral of force_per_width over the applied strain, in mJ per mm² of relaxed "
                "cloth; missing under biaxial loads"
            ),
        ),
        "energy_recovery": number(
            "energy that unloading gives back, over that of loading",
            description="less than 1 where the fabric snaps, or with friction at the folds",
        ),
        "energy_lost": number(
            "energy lost in a cycle, per area", "N/mm", description="in mJ per mm² of relaxed cloth"
        ),
        "residual_strain": number(
            "strain without force during unloading",
            description=(
                "the set that the fabric keeps; below it real cloth is slack, and here it is pushed"
            ),
        ),
        "intersections_at_min": number(
            "pairs of grid cells that pass through each other at the lowest Poisson's ratio",
            description="where there are any, that ratio is not one of a real fabric",
            integer=True,
        ),
        "waves_x": number("waves along the weft", description=WAVES, integer=True),
        "waves_y": number("waves along the warp", description=WAVES, integer=True),
    },
)
REGISTRY.declare(
    CANDIDATE,
    {
        "distance": number(
            "distance from the targets of a design",
            description="root mean square over the targets, each over its tolerance",
        ),
        "distance_worst": number(
            "distance from the targets within the spread",
            description="the largest distance within the spread",
        ),
    },
)
