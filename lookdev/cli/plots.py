"""The commands that plot reflectance, and fit models to it: plot, fit."""

from __future__ import annotations

import sys
from functools import partial
from pathlib import Path
from typing import Annotated

import typer
from typer import Argument, Option

from lookdev.cli.options import AsJson, say, say_json, say_notes
from lookdev.errors import LookdevError

app = typer.Typer()
# Makes an option of fit that goes with --picture.
_picture_option = partial(Option, rich_help_panel="Pictures")

Subjects = Annotated[
    list[str],
    Argument(
        metavar="WHAT...",
        help="A model (disney:roughness=.3,baseColor=.8/.2/.1), a preset, a look (FILE, FILE:LAYER, FILE@U,V), or "
        "measured data (FILE). A prefix LABEL= sets the name in the legend.",
    ),
]
LibraryOption = Annotated[Path | None, Option(metavar="DIR", help="A folder of presets.")]


@app.command(rich_help_panel="Looks")
def plot(
    kind: Annotated[
        str,
        Argument(
            metavar="KIND",
            help="slice, polar, lobe3d, cartesian, albedo, sphere, retro, fresnel, difference or sampling.",
        ),
    ],
    subjects: Subjects,
    output: Annotated[
        Path,
        Option("--output", "-o", metavar="FILE", help="The file to write: .png, .svg, .pdf, or .csv with the numbers."),
    ],
    theta: Annotated[float, Option(help="Polar angle of the view, or the fixed angle, in degrees.")] = 45.0,
    phi: Annotated[float, Option(help="phi_d, or the azimuth of the view, in degrees.")] = 90.0,
    axis: Annotated[str, Option(help="Axis of cartesian: theta_h, theta_d or theta_i.")] = "theta_h",
    scale: Annotated[str, Option(help="Scale of values: linear, sqrt or log.")] = "linear",
    angles: Annotated[str, Option(help="Scale of angles: linear or sqrt.")] = "linear",
    limit: Annotated[float, Option(help="The largest angle, in degrees.")] = 90.0,
    channels: Annotated[str, Option(help="Channels of curves: luminance or rgb.")] = "luminance",
    exposure: Annotated[float, Option(help="Exposure of pictures, in stops.")] = 0.0,
    chroma: Annotated[bool, Option("--chroma", help="Divide pictures by their largest channel.")] = False,
    cosine: Annotated[bool, Option("--cosine", help="Plot f times the cosine of the light.")] = False,
    size: Annotated[int, Option(help="Samples along an axis, or pixels; 0: the kind's default.")] = 0,
    library: LibraryOption = None,
) -> None:
    """Plot reflectance: models, presets, looks and measured data, in one plot."""
    from lookdev.plotting import PlotOptions, draw, kind_named, read_subject
    from lookdev.plotting.figure import check_suffix

    options = PlotOptions(
        theta=theta, phi=phi, axis=axis, scale=scale, angles=angles, limit=limit, channels=channels,
        exposure=exposure, chroma=chroma, cosine=cosine, size=size,
    )  # fmt: skip
    kind_named(kind)
    check_suffix(output)
    figure = draw(kind, [read_subject(text, library) for text in subjects], options)
    figure.write(output)
    for note in figure.notes:
        say(note)
    say(f"{output}: {kind}")


@app.command(rich_help_panel="Looks")
def fit(
    source: Annotated[
        str,
        Argument(
            metavar="DATA|JOB",
            help="Measured data, or any other subject of plot; with --picture, the job of the scene in the picture.",
        ),
    ],
    model: Annotated[
        str | None,
        Option(metavar="MODEL", help="The model. Parameters after it are fixed: disney:sheen=0. Default: disney."),
    ] = None,
    only: Annotated[list[str] | None, Option(metavar="NAME", help="Fit this parameter, not all. Repeatable.")] = None,
    loss: Annotated[str | None, Option(help="Loss of f cos: log, cbrt or linear. Default: log.")] = None,
    starts: Annotated[
        int | None, Option(help="Number of the best random starts that are optimized. Default: 4; with --picture, 2.")
    ] = None,
    output: Annotated[
        Path | None,
        Option(
            "--output",
            "-o",
            metavar="FILE",
            help="A plot of the difference; with --picture, the page, by default <picture>_fit.html in this folder.",
        ),
    ] = None,
    look: Annotated[
        Path | None,
        Option(
            metavar="FILE",
            help="The result as a look, USD; with --picture, by default <picture>_fitted.usda in this folder.",
        ),
    ] = None,
    as_json: AsJson = False,
    library: LibraryOption = None,
    picture: Annotated[
        Path | None,
        _picture_option(
            metavar="PHOTO.exr",
            help="A picture of a look of JOB, to which parameters of the look are fitted by derivatives of renders.",
        ),
    ] = None,
    parameters: Annotated[
        str,
        _picture_option(
            metavar="NAMES",
            help="The parameters to fit, separated by commas, some with bounds: roughness,Flakes.mask,sheen=0..0.3.",
        ),
    ] = "",
    frame: Annotated[
        str,
        _picture_option(
            metavar="NAME",
            help="The frame in the picture, or the start of its name: gold/city/element.0001; default: the first.",
        ),
    ] = "",
    mask: Annotated[
        Path | None,
        _picture_option(
            metavar="FILE", help="An image of the picture's size; its last channel is the weight of each pixel."
        ),
    ] = None,
    exposure: Annotated[bool, _picture_option("--exposure", help="Fit the picture's exposure, too.")] = False,
    pixels: Annotated[
        int,
        _picture_option(
            min=256, help="Average blocks of the picture's pixels, as long as at least this number of pixels is left."
        ),
    ] = 4096,
    samples: Annotated[
        int,
        _picture_option(min=8, max=4096, help="Samples of a pixel in each half of the finest renders; a power of two."),
    ] = 256,
    force: Annotated[bool, _picture_option("--force", help="Replace files that exist.")] = False,
) -> None:
    """Fit the parameters of a model to measured data, a look or another model; or those of a look to a picture."""
    data_options = {"--model": model, "--only": only, "--loss": loss, "--library": library}
    picture_options = {"--parameters": parameters, "--frame": frame, "--mask": mask, "--exposure": exposure}
    for name, value in (data_options if picture else picture_options).items():
        if value:
            raise LookdevError(f"{name} has no meaning {'with' if picture else 'without'} --picture")
    if picture is None:
        from lookdev.fitting import fit_model, format_fit
        from lookdev.material.library.edit import model_look
        from lookdev.plotting import draw, read_subject
        from lookdev.plotting.figure import check_suffix
        from lookdev.plotting.subject import read_model

        if output is not None:
            check_suffix(output)
        data, (fitted_model, values) = read_subject(source, library), read_model(model or "disney")
        start_count = 4 if starts is None else starts
        result = fit_model(data, fitted_model, values, names=only or (), loss=loss or "log", starts=start_count)
        say_json(result.data()) if as_json else say(format_fit(result))
        if output is not None:
            draw("difference", [data, result.subject]).write(output)
        if look is not None:
            model_look(look, result.model, result.values)
        return
    from lookdev.fitting.picture.fit import PictureFitRequest, fit_picture
    from lookdev.fitting.picture.search import SearchSettings
    from lookdev.run.progress import show_fit

    if samples & (samples - 1):
        raise LookdevError(f"--samples {samples}: a power of two would be right")
    if starts is not None and not 1 <= starts <= SearchSettings.start_count:
        raise LookdevError(f"--starts {starts}: 1 to {SearchSettings.start_count} would be right")
    request = PictureFitRequest(
        picture, Path(source), tuple(name for name in parameters.split(",") if name.strip()), frame,
        look or Path(f"{picture.stem}_fitted.usda"), output or Path(f"{picture.stem}_fit.html"), mask, exposure,
        look_named=look is not None, force=force, pixels=pixels,
        settings=SearchSettings(followed_count=starts or SearchSettings.followed_count, final_samples=samples),
    )  # fmt: skip
    with show_fit(sys.stderr) as report:
        fit_result = fit_picture(request, report)
    say_notes(fit_result.notes)
    say_json(fit_result.data()) if as_json else say(fit_result.text())
    raise typer.Exit(130 if fit_result.result.interrupted else 0)
