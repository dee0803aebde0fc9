"""The command ``export``."""

from pathlib import Path

import click

from knitlab.cli.options import (
    explains_bad_input,
    read_selections,
    repeats_option,
    select_option,
    two_counts,
)


@click.command()
@click.argument("cube", type=click.Path(path_type=Path))
@select_option
@click.option(
    "-o",
    "--output",
    type=click.Path(path_type=Path, dir_okay=False),
    required=True,
    help="File to write, .vtu, .ply, .obj, .stl or .glb; .pvd is a series over the strain.",
)
@repeats_option
@click.option("--triangles", is_flag=True, help="Divide every grid cell into two triangles.")
@click.option(
    "--thickness",
    type=float,
    metavar="MM",
    help="Thickness of a closed solid, to print; without it the mesh is an open sheet.",
)
@explains_bad_input
def export(
    cube: Path,
    selections: tuple[str, ...],
    output: Path,
    repeats: str | None,
    triangles: bool,
    thickness: float | None,
) -> None:
    """Write the shape of one design of CUBE as a mesh for other programs.

    Shapes are in the case files beside a cube. Of a single file the strain is 0 unless it is
    selected; a series has every strain that was reached.
    """
    from knitlab.api.exporting import export as export_shape

    exported = export_shape(
        cube,
        output,
        read_selections(selections),
        repeats=two_counts(repeats) or (1, 1),
        triangles=triangles,
        thickness=thickness,
    )
    for strain, mesh, crossing in zip(
        exported.applied_strain, exported.meshes, exported.self_intersections, strict=True
    ):
        corners = {3: "triangles", 4: "quads"}[mesh.faces.shape[1]]
        size = " × ".join(f"{length:.3g}" for length in mesh.size)
        click.echo(
            f"applied_strain {strain:g}: {len(mesh.nodes)} nodes, {len(mesh.faces)} {corners},"
            f" {size} mm of the model"
            + (f", {crossing} pairs of cells pass through each other" if crossing else "")
        )
    click.echo(f"mesh    {exported.files[0]}")
