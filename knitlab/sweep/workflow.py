"""Workflows: one short TOML file an experiment, the overrides of ``--set``, and what they mean."""

import tomllib
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field, PositiveFloat, PositiveInt, ValidationError, field_validator

from knitlab.model.pattern import patch_map
from knitlab.model.reading import (
    Boundary,
    CellSize,
    FoldPhase,
    GarterStart,
    Hinges,
    HingeStiffness,
)
from knitlab.sweep.faults import BadInput, Fault, fault, faults_of
from knitlab.sweep.parameters import Fraction, Strict
from knitlab.sweep.shipped import shipped
from knitlab.sweep.toml import read_toml

Figure = Literal["curves", "auxetic", "shape"]
Whole = Annotated[tuple[PositiveInt, ...], Field(min_length=1, strict=False)]


class DesignSection(Strict):
    """``[design]``: which designs, as a named set or as a grid, and the sample they make.

    With a set, ``n_stripe`` or ``n_subunit`` alone keep those members of it; both together
    replace it by their grid.
    """

    set: str | None = None
    n_stripe: Whole | None = None
    n_subunit: Whole | None = None
    pattern: Annotated[tuple[str, ...], Field(strict=False)] = ("GR", "RG")
    unit_cells: Annotated[tuple[PositiveInt, PositiveInt], Field(strict=False)] = (1, 1)

    @field_validator("pattern")
    @classmethod
    def _is_a_patch_map(cls, rows: tuple[str, ...]) -> tuple[str, ...]:
        patch_map(rows, periods=1)
        return rows


class ProtocolSection(Strict):
    """``[protocol]``: the strains of the tensile test."""

    strain_max: Annotated[float, Field(ge=0)] = 0.45
    strain_step: PositiveFloat = 0.03


class ModelSection(Strict):
    """``[model]``: what replaces the values of ``reading.toml`` and ``sheet.toml``."""

    cell_size: CellSize | None = None
    fold_phase: FoldPhase | None = None
    hinges: Hinges | None = None
    hinge_stiffness: HingeStiffness | None = None
    garter_start: GarterStart | None = None
    length_scale: PositiveFloat | None = None
    boundary: Boundary | None = None
    z_max: PositiveFloat | None = None
    k_wall: PositiveFloat | None = None
    surface_density: PositiveFloat | None = None
    damping: PositiveFloat | None = None


class SolverSection(Strict):
    """``[solver]``: what replaces the values of ``solver.toml``."""

    tolerance: PositiveFloat | None = None
    max_iterations: PositiveInt | None = None
    step_limit: Fraction | None = None
    smallest_shift: PositiveFloat | None = None
    ramp_steps: PositiveInt | None = None
    path_step: Fraction | None = None
    smallest_step: Fraction | None = None


class Workflow(Strict):
    """A workflow file, with what ``--set`` changed."""

    title: str = Field(min_length=1)
    figures: Annotated[tuple[Figure, ...], Field(strict=False)] = ()
    design: DesignSection
    protocol: ProtocolSection = ProtocolSection()
    model: ModelSection = ModelSection()
    solver: SolverSection = SolverSection()


SECTIONS: dict[str, type[Strict]] = {
    "design": DesignSection,
    "protocol": ProtocolSection,
    "model": ModelSection,
    "solver": SolverSection,
}
SECTION_OF = {key: name for name, section in SECTIONS.items() for key in section.model_fields}


def workflow_file(workflow: str) -> Path:
    """The file of a workflow given by its name or its path.

    Raises:
        BadInput: if there is none.
    """
    named = shipped("workflows") / f"{workflow}.toml"
    if named.is_file():
        return named
    path = Path(workflow)
    if path.is_file():
        return path
    names = ", ".join(sorted(file.stem for file in shipped("workflows").glob("*.toml")))
    raise fault(workflow, f"is neither a workflow ({names}) nor a file; give one of these")


def read_workflow(path: Path, overrides: tuple[str, ...] = ()) -> Workflow:
    """Read a workflow and apply the ``KEY=VALUE`` overrides of ``--set``.

    Raises:
        BadInput: with every fault of the file and of the overrides.
    """
    table = read_toml(path)
    faults, overridden = [], dict[tuple[str, str], str]()
    for override in overrides:
        key, equals, text = override.partition("=")
        name = key.strip().rpartition(".")[2]
        section = SECTION_OF.get(name)
        if not equals or not text.strip():
            faults.append(Fault(f"--set {override}", "is not KEY=VALUE; give both"))
        elif section is None or key.strip() not in (name, f"{section}.{name}"):
            known = ", ".join(sorted(SECTION_OF))
            faults.append(
                Fault(f"--set {override}", f"{key.strip()} is not a setting; choose of {known}")
            )
        else:
            part = table.setdefault(section, {})
            if isinstance(part, dict):
                part[name] = _overriding_value(text, SECTIONS[section], name)
            overridden[section, name] = f"--set {override}"
    try:
        workflow = Workflow.model_validate(table)
    except ValidationError as error:
        for entry in faults_of(error, str(path)):
            place = entry.path.removeprefix(f"{path}: ").split(".")
            source = overridden.get((place[0], place[1] if len(place) > 1 else ""))
            faults.append(Fault(source, entry.problem) if source else entry)
    if faults:
        raise BadInput(faults)
    return workflow


def _overriding_value(text: str, section: type[Strict], name: str) -> Any:
    annotation = str(section.model_fields[name].annotation)
    values = [_scalar(part.strip()) for part in text.split(",")]
    takes_list = "tuple" in annotation
    return values if takes_list or len(values) > 1 else values[0]


def _scalar(text: str) -> Any:
    try:
        return tomllib.loads(f"value = {text}")["value"]
    except tomllib.TOMLDecodeError:
        return text
