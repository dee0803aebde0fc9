"""One design, simulated in this process, and own functions of its shape."""

import warnings
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import KW_ONLY, dataclass, replace
from pathlib import Path
from typing import get_args

import jax.numpy as jnp
import numpy as np
import xarray as xr
from jaxtyping import Float

from knitlab.cubes.case_file import configurations
from knitlab.cubes.derived import with_derived
from knitlab.cubes.normalised import normalised
from knitlab.cubes.recorded_case import recorded_case
from knitlab.design.trial import ShapeFunction, shape_measure, state_slopes
from knitlab.io.errors import ErrorCollector, Mistake, invalid, naming, raise_if_any, shown
from knitlab.model.computing import computing
from knitlab.model.electrodes import Capacitor
from knitlab.model.settings import Boundary, Friction, ModelOptions, PlainKnit, Sheet
from knitlab.model.stitches import Gauge
from knitlab.model.stripe import GARTER_STITCHES_PER_RIB_STITCH, Stripe, periods_per_patch
from knitlab.observables.case_variables import STRIPE_PARAMETERS
from knitlab.observables.schema import described
from knitlab.observables.sensitivity import adjoint_of
from knitlab.observables.status import Status
from knitlab.runs.case_settings import CaseSettings
from knitlab.runs.cases import cases, checkerboard_designs, electrode_problems
from knitlab.runs.cube import cloth_sizes, gauge_attributes, input_values
from knitlab.runs.material import Material, known_parameters
from knitlab.runs.parameters import Parameters
from knitlab.runs.patterns import Pattern
from knitlab.runs.progress import CaseProgress
from knitlab.runs.simulate import simulated
from knitlab.runs.workflow import DesignSection, ElectrodesSection, Protocol, Workflow
from knitlab.solvers.case import Case
from knitlab.solvers.dynamics.settings import Dynamics
from knitlab.solvers.equilibrium.adjoint import NoDerivative
from knitlab.solvers.equilibrium.settings import Solver

OWN_PATTERN = "own pattern"  # name of a pattern that is given as an object


class NotConverged(UserWarning):
    """A test that did not reach its last strain: missing results are NaN, see ``status``."""


@dataclass(frozen=True)
class Design:
    """One knit: its pattern, its sample, and optionally its stripes.

    Attributes:
        n_stripe: stitches across a rib stripe; the garter stripe has twice as many courses.
        n_subunit: stitches along a garter stripe, a multiple of ``2 * n_stripe``.
        boundary: ``"periodic"`` for fabric without edges, ``"clamped"`` for a sample whose first
            and last row are held, as the paper tests it.
        pattern: the patches that repeat: a map, top course first, with R for rib, G for garter
            and P for plain knit; the name of a pattern of ``params/patterns.toml``; or a
            :class:`knitlab.Pattern` with sizes, stripes or folds of its own.
        unit_cells: repeats of the pattern along the warp (y) and the weft (x); 1 × 1 by default.
        needles: needles of the machine, in place of ``unit_cells``: the sample is as wide as
            whole unit cells fit on them, and twice as long.
        rib: stripe of the rib patches; by default that of ``params/stripes.toml`` [mm, N, rad].
        garter: stripe of the garter patches, likewise.
        further_stripes: likewise, stripes of other sizes than n_stripe, which a pattern with
            stripes of its own may have.

    Raises:
        InputError: with every value that is out of range, and stripes of the wrong knit or number
            of stitches.

    Example:
        >>> kl.Design(4, 16, boundary="periodic").rib is None
        True
    """

    n_stripe: int
    n_subunit: int
    _: KW_ONLY
    boundary: Boundary = "clamped"
    pattern: tuple[str, ...] | str | Pattern = ("GR", "RG")
    unit_cells: tuple[int, int] | None = None
    needles: int | None = None
    rib: Stripe | None = None
    garter: Stripe | None = None
    further_stripes: tuple[Stripe, ...] = ()

    def __post_init__(self) -> None:
        stitches = {"rib": self.n_stripe, "garter": GARTER_STITCHES_PER_RIB_STITCH * self.n_stripe}
        mistakes = ErrorCollector()
        try:
            periods_per_patch(self.n_stripe, self.n_subunit)
        except (ValueError, TypeError, ZeroDivisionError) as message:
            mistakes.all.append(Mistake("Design", str(message)))
        further = [("further_stripes", stripe) for stripe in self.further_stripes]
        for name, stripe in (("rib", self.rib), ("garter", self.garter), *further):
            if stripe is None:
                continue
            if name in stitches and (stripe.knit, stripe.n) != (name, stitches[name]):
                is_given = f"is a {stripe.knit} stripe of {stripe.n} stitches"
                wanted = f"n_stripe = {self.n_stripe} takes a {name} stripe of {stitches[name]}"
                mistakes.all.append(Mistake(name, f"{is_given}, and {wanted}"))
        if self.boundary not in get_args(Boundary):
            known = " or ".join(get_args(Boundary))
            mistakes.all.append(Mistake("boundary", f"is {shown(self.boundary)}; give {known}"))
        with mistakes:
            assert self.section
        raise_if_any(mistakes.all)

    @property
    def section(self) -> DesignSection:
        """The design as a workflow states it; InputError if a value is invalid."""
        pattern = OWN_PATTERN if isinstance(self.pattern, Pattern) else self.pattern
        with naming("Design"):
            return DesignSection(
                n_stripe=(self.n_stripe,),
                n_subunit=(self.n_subunit,),
                pattern=(pattern,) if isinstance(pattern, str) else pattern,
                unit_cells=self.unit_cells,
                needles=self.needles,
            )

    @property
    def stripes(self) -> tuple[Stripe, ...]:
        """The stripes that are given."""
        own = (self.rib, self.garter)
        return (*self.further_stripes, *(stripe for stripe in own if stripe is not None))


@computing()
def simulate(
    design: Design,
    applied_strain: Sequence[float] | Float[np.ndarray, " strain"] | None = None,
    *,
    protocol: Protocol | None = None,
    model: ModelOptions | None = None,
    sheet: Sheet | None = None,
    plain: PlainKnit | None = None,
    solver: Solver | None = None,
    dynamics: Dynamics | None = None,
    friction: Friction | None = None,
    capacitor: Capacitor | None = None,
    gauge: Gauge | None = None,
    material: Material | None = None,
    progress: bool = True,
) -> xr.Dataset:
    """Relax a fabric and pull it, in this process; along the warp, unless the protocol has a load.

    The test is that of the paper, Sec. "Kinematics under tension". Settings that are left out are
    those of :func:`knitlab.defaults`; without a capacitor the fabric has no electrodes.

    Args:
        design: the knit and its sample.
        applied_strain: strains of the test, ascending from 0, in place of those of
            the protocol [1].
        protocol: the strains, and how the states are reached, such as
            ``knitlab.Protocol(strain_max=0.3, method="dynamics")``.
        model: model options, such as ``knitlab.Model(cell_size="flat")``.
        sheet: the walls, and the thickness of the fabric.
        plain: stiffness of plain knit.
        solver: settings of the search for equilibria.
        dynamics: settings of motion in time.
        friction: friction at the folds, and drift of their rest angles.
        capacitor: electrodes and their layout.
        gauge: size of a stitch in cloth.
        material: stripes of another yarn and the lengths that go with them, in place of the
            paper's.
        progress: whether to show progress, after two seconds.

    Returns:
        Every variable of a cube along ``applied_strain``, each with its unit in
        ``attrs["units"]``, and ``position`` (applied_strain, node_y, node_x, component) in mm.
        ``status``, ``residual_force`` and ``iterations`` describe the convergence.

    Raises:
        InputError: if the design, the strains or a setting is invalid, or settings contradict.

    Warns:
        NotConverged: if a strain was not reached; results from there on are NaN.

    Example:
        >>> test = kl.simulate(kl.Design(4, 8, boundary="periodic"), [0, 0.03, 0.06])
        >>> bool(test["poisson_ratio"].sel(applied_strain=0.06) < 0)
        True
    """
    if not isinstance(design, Design):
        raise invalid("design", f"is {design!r}; give a knitlab.Design, such as Design(4, 16)")
    parameters = known_parameters(material, model)
    settings: dict[str, object] = {"model": model, "sheet": sheet, "plain": plain, "solver": solver}
    settings |= {"dynamics": dynamics, "friction": friction, "capacitor": capacitor, "gauge": gauge}
    parameters = parameters.with_tables(**settings)
    protocol = protocol or Protocol()
    given = protocol.applied_strain if applied_strain is None else applied_strain
    strains = np.asarray(given, dtype=float).tolist()
    case = case_of_design(design, strains, parameters, protocol, electrodes=capacitor is not None)
    with CaseProgress({case.case_id: case}, progress) as shown:
        results = simulated(case, shown.reached)
    values = {str(name): array.values for name, array in results.data_vars.items()}
    sizes = cloth_sizes(case, values, parameters.gauge)
    results = results.assign(input_values(case) | sizes)
    results.attrs |= gauge_attributes(parameters.gauge)
    if material is not None:
        results.attrs |= {"material": material.name} | material.on_machine.attributes
    if results["status"] != Status.ok:
        warnings.warn(f"{case.label}: {results.attrs['reason']}", NotConverged, stacklevel=2)
    return with_derived(described(results))


def case_of_design(
    design: Design,
    applied_strain: Sequence[float],
    parameters: Parameters,
    protocol: Protocol,
    *,
    electrodes: bool,
) -> Case:
    """The case of a design, with tabulated stripes where it has none; or InputError."""
    strains = tuple(map(float, applied_strain))
    mistakes = ErrorCollector()
    if not strains or strains[0] != 0:
        message = f"begins at 0, the relaxed fabric, but is {list(strains)}"
        mistakes.all.append(Mistake("applied_strain", message))
    elif list(strains) != sorted(set(strains)):
        message = f"ascends, but is {list(strains)}; sort it and keep each once"
        mistakes.all.append(Mistake("applied_strain", message))
    section = design.section
    if isinstance(design.pattern, Pattern):
        named = parameters.patterns | {OWN_PATTERN: (design.pattern, Path())}
        parameters = replace(parameters, patterns=named)
    if parameters.model.boundary == "periodic" and design.boundary == "clamped":
        message = "is periodic, and the design is clamped; give the boundary to knitlab.Design"
        mistakes.all.append(Mistake("model.boundary", message))
    raise_if_any(mistakes.all)
    parameters = replace(
        parameters.with_tables(model=replace(parameters.model, boundary=design.boundary)),
        stripes=parameters.stripes.with_stripes(design.stripes),
    )
    workflow = Workflow(
        title="single design",
        design=section,
        protocol=protocol,
        electrodes=ElectrodesSection() if electrodes else None,
    )
    designs = checkerboard_designs(section, parameters, str)
    (case,) = cases(CaseSettings(workflow, {}, parameters, str), designs)
    if messages := electrode_problems(case):
        raise invalid("layout", "; ".join(messages))
    return replace(case, applied_strain=strains)


@computing()
def evaluate(
    test: xr.Dataset, *, sensitivities: bool = True, **measures: ShapeFunction
) -> xr.Dataset:
    """Evaluate own functions of the shape at every strain of a test.

    Derivatives are exact, by one adjoint solve for each state: the change of the value as the
    fabric follows a change of its stripe parameters at fixed applied strain.

    Args:
        test: dataset of :func:`knitlab.simulate`, or of a case file.
        sensitivities: whether to compute derivatives.
        measures: functions of a configuration, with ``positions`` (node_y, node_x, 3) and
            ``lengths`` (2) in mm, that return one number and are written in JAX.

    Returns:
        For each function a variable with its name, along ``applied_strain``, and its logarithmic
        derivatives p ∂f/∂p as ``NAME_sensitivity`` (applied_strain, stripe_parameter). Values
        are NaN where the test did not converge; derivatives are also NaN at snaps.

    Raises:
        InputError: if the dataset has no shapes, or a function does not return one number.

    Example:
        >>> import jax.numpy as jnp
        >>> test = kl.simulate(kl.Design(4, 8, boundary="periodic"), [0, 0.03])
        >>> evaluated = kl.evaluate(test, height=lambda shape: jnp.ptp(shape.positions[..., 2]))
        >>> evaluated["height_sensitivity"].dims
        ('applied_strain', 'stripe_parameter')
    """
    if "position" not in test or "parameters" not in test.attrs:
        raise invalid("test", "has no node positions; give a dataset of knitlab.simulate")
    test = normalised(test, "test")
    shapes = configurations(test)
    strains = test["applied_strain"]
    arrays = {name: given for name, f in measures.items() if (given := jnp.shape(f(shapes[0])))}
    message = "returns an array of shape {}; return one number"
    raise_if_any([Mistake(name, message.format(given)) for name, given in arrays.items()])
    reached = np.flatnonzero(np.isfinite(shapes.positions).all(axis=(1, 2, 3)))
    values = np.full((len(strains), len(measures)), np.nan)
    slopes = np.full((*values.shape, len(STRIPE_PARAMETERS)), np.nan)
    for k in reached:
        values[k] = [float(function(shapes[k])) for function in measures.values()]
    found = {name: ("applied_strain", values[:, k]) for k, name in enumerate(measures)}
    evaluated = xr.Dataset(found, {"applied_strain": strains})
    if not (sensitivities and len(reached)):
        return evaluated
    case = recorded_case(test)
    own = tuple(measures.items())
    measure = shape_measure(case.mesh_shape, case.cell_grid, tuple(measures), own)
    with suppress(NoDerivative):
        adjoint = adjoint_of(case, shapes[0])
        for k in reached:
            with suppress(NoDerivative):
                slopes[k] = state_slopes(case, adjoint, float(strains[k]), shapes[k], measure)
    for name, of_one in zip(measures, slopes.swapaxes(0, 1), strict=True):
        evaluated[f"{name}_sensitivity"] = (("applied_strain", "stripe_parameter"), of_one)
    return evaluated.assign_coords(stripe_parameter=list(STRIPE_PARAMETERS))
