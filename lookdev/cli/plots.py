"""The verbs that show and fit reflectance: plot and fit."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from lookdev.cli.options import AsJson, say, say_json

app = typer.Typer()

What = Annotated[
    list[str],
    typer.Argument(
        metavar="WHAT...",
        help="A model (disney:roughness=.3,baseColor=.8/.2/.1), a preset, a look (FILE, FILE:LAYER, FILE@U,V), or "
        "measured data (FILE); LABEL= before it names it in the legend.",
        show_default=False,
    ),
]
Library = Annotated[
    Path | None, typer.Option("--library", metavar="DIR", help="A folder of presets.", show_default=False)
]


@app.command(rich_help_panel="Looks")
def plot(
    kind: Annotated[
        str,
        typer.Argument(
            metavar="KIND",
            help="slice, polar, lobe3d, cartesian, albedo, sphere, retro, fresnel, difference or sampling.",
            show_default=False,
        ),
    ],
    what: What,
    output: Annotated[Path, typer.Option("--output", "-o", metavar="FILE", help="PNG, SVG, PDF, or CSV: the numbers.")],
    theta: Annotated[float, typer.Option("--theta", help="Degrees of the view, or of the angle that stays.")] = 45.0,
    phi: Annotated[float, typer.Option("--phi", help="Degrees of phi_d, or of the view's azimuth.")] = 90.0,
    axis: Annotated[str, typer.Option("--axis", help="Of cartesian: theta_h, theta_d or theta_i.")] = "theta_h",
    scale: Annotated[str, typer.Option("--scale", help="Of values: linear, sqrt or log.")] = "linear",
    angles: Annotated[str, typer.Option("--angles", help="Of angles: linear or sqrt.")] = "linear",
    limit: Annotated[float, typer.Option("--limit", help="The largest angle, in degrees.")] = 90.0,
    channels: Annotated[str, typer.Option("--channels", help="Of curves: luminance or rgb.")] = "luminance",
    exposure: Annotated[float, typer.Option("--exposure", help="Of pictures, in stops.")] = 0.0,
    chroma: Annotated[bool, typer.Option("--chroma", help="Pictures divided by their largest channel.")] = False,
    cosine: Annotated[bool, typer.Option("--cosine", help="f times the cosine of the light.")] = False,
    size: Annotated[int, typer.Option("--size", help="Samples along an axis, or pixels; 0: the kind's own.")] = 0,
    library: Library = None,
) -> None:
    """Plot reflectance: models, presets, looks and measured data, over one another."""
    from lookdev.plot import Options, draw, kind_named, read_subject
    from lookdev.plot.figure import checked_suffix

    options = Options(
        theta=theta, phi=phi, axis=axis, scale=scale, angles=angles, limit=limit, channels=channels,
        exposure=exposure, chroma=chroma, cosine=cosine, size=size,
    )  # fmt: skip
    kind_named(kind)
    checked_suffix(output)
    made = draw(kind, [read_subject(each, library) for each in what], options)
    made.write(output)
    for note in made.notes:
        say(note)
    say(f"{output}: {kind}")


@app.command(rich_help_panel="Looks")
def fit(
    what: Annotated[
        str,
        typer.Argument(metavar="DATA", help="Measured data, or anything else that plot shows.", show_default=False),
    ],
    model: Annotated[
        str, typer.Option("--model", metavar="MODEL", help="The model; parameters given with it stay: disney:sheen=0.")
    ] = "disney",
    only: Annotated[
        list[str] | None,
        typer.Option("--only", metavar="NAME", help="Fit this parameter, not all. Repeatable.", show_default=False),
    ] = None,
    loss: Annotated[str, typer.Option("--loss", help="Of f cos: log, cbrt or linear.")] = "log",
    starts: Annotated[int, typer.Option("--starts", help="How many of the best random starts are followed.")] = 4,
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", metavar="FILE", help="The difference as a plot.", show_default=False),
    ] = None,
    look: Annotated[
        Path | None, typer.Option("--look", metavar="FILE", help="The result as a look, USD.", show_default=False)
    ] = None,
    as_json: AsJson = False,
    library: Library = None,
) -> None:
    """Fit the parameters of a model to measured data, a look or another model."""
    from lookdev.fit import fit as fitted
    from lookdev.fit import fit_text
    from lookdev.material.library.edit import model_look
    from lookdev.plot import draw, read_subject
    from lookdev.plot.figure import checked_suffix
    from lookdev.plot.subject import read_model

    if output is not None:
        checked_suffix(output)
    data = read_subject(what, library)
    found = fitted(data, *read_model(model), wanted=only or (), loss=loss, starts=starts)
    if as_json:
        say_json(found.data())
    else:
        say(fit_text(found))
    if output is not None:
        draw("difference", [data, found.subject]).write(output)
    if look is not None:
        model_look(look, found.model, found.values)
