"""Remarks on values of a workflow that may be mistakes: unusual ones, and ones that are ignored."""

from collections.abc import Iterable, Iterator

from knitlab.model.stripe import STRIPE_QUANTITIES, flat_stitch
from knitlab.runs.case_settings import CaseSettings
from knitlab.runs.material import SCALED, STITCH
from knitlab.runs.parameters import KNITS, UNITS, Parameters
from knitlab.solvers.case import Case
from knitlab.solvers.loads import LOADS
from knitlab.solvers.methods import METHODS

USUAL_STRAIN = 2.0  # largest usual applied strain: that of pure stripes, which unfold furthest
STITCH_TOLERANCE = 0.05  # part by which the stitches of a stripe and of the gauge may differ
UNUSUAL = 10.0  # factor beyond the values of the tables from which a value is unusual


def _other_stitches(parameters: Parameters) -> Iterator[str]:
    """Sentences on stripes of a material whose stitches have another size than its gauge."""
    for knit, name in zip(KNITS, STITCH, strict=True):
        given = getattr(parameters.gauge, name)
        for n in parameters.stripes.rows(knit):
            stripe = parameters.stripes.stripe(knit, n)
            implied = flat_stitch(stripe, parameters.model.cell_size)
            if abs(implied / given - 1) > STITCH_TOLERANCE:
                sizes = f"{given:.3g} mm, and the period of {knit} {n} implies {implied:.3g} mm"
                yield (
                    f"{name} = {sizes};"
                    " forces and lengths of the cloth are off by as much: measure the period and"
                    " count its stitches again, or leave the size of the stitch out"
                )


def unusual_values(settings: CaseSettings, cases: Iterable[Case]) -> tuple[str, ...]:
    """Sentences on values that may be mistakes: far from the tables, or ignored by the method."""
    workflow, parameters = settings.workflow, settings.parameters
    cases = tuple(cases)
    contact = any(case.options.contact != "none" for case in cases)
    uses = {"sheet": True, "gauge": not workflow.stripes, "capacitor": bool(workflow.electrodes)}
    scaled = [
        f"{name} = {value:.3g} mm"
        for name, value in sorted(parameters.scaled.items())
        if uses[SCALED[name]] and (contact or name != "thickness")
    ]
    sentences = []
    if scaled:
        origin = f"the paper's, scaled to the stitches of the material {parameters.material!r}"
        sentences.append(f"{', '.join(scaled)}: {origin}; give others in its file or as settings")
    if parameters.material is not None:
        sentences += _other_stitches(parameters)
    for case in cases:
        if (strain := case.applied_strain[-1]) > USUAL_STRAIN:
            usual = "usual are 0.2 to 0.6, and 0.15 is 15 %"
            sentences.append(f"strain_max = {strain:g} is {strain:.0%} of the length; {usual}")
        for stripe in (case.weft, case.warp):
            rows = parameters.stripes.rows(stripe.knit).values()
            for name in STRIPE_QUANTITIES:
                value, unit = getattr(stripe, name), UNITS[name]
                known = [getattr(row, name) for row in rows]
                if not min(known) / UNUSUAL <= value <= max(known) * UNUSUAL:
                    usual = f"usual are {min(known):g} to {max(known):g} {unit}"
                    subject = f"{name} of {stripe.knit} {stripe.n}"
                    sentences.append(f"{subject} is {value:.4g} {unit}; {usual}")
    protocol = workflow.protocol
    used = {setting for case in cases for setting in case.load.settings}
    for setting in dict.fromkeys(each for load in LOADS.values() for each in load.settings):
        if setting not in used and getattr(protocol, setting.name) is not None:
            ignored = f"{setting.name} is ignored by load = {protocol.load}"
            kinds = [kind for kind, load in LOADS.items() if setting in load.settings]
            sentences.append(f"{ignored}; take load = {' or '.join(kinds)}")
    if protocol.cycle > 1 and not any(case.friction.acts for case in cases):
        same = f"cycle = {protocol.cycle} is as the first without friction, unless the fabric snaps"
        sentences.append(f"{same}; give fold_friction or fold_drift")
    sentences += METHODS[protocol.method].remarks(settings.combination)
    return tuple(dict.fromkeys(sentences))
