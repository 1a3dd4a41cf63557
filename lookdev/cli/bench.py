"""The verb that measures speed: bench."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Annotated

import typer

from lookdev.cli.options import say

app = typer.Typer()


@app.command(rich_help_panel="Accuracy and speed")
def bench(
    scenes: Annotated[str, typer.Option("--scenes", metavar="NAMES", help="Scenes, separated by commas.")] = "",
    ibls: Annotated[str, typer.Option("--ibls", metavar="NAMES", help="Lights.")] = "",
    looks: Annotated[str, typer.Option("--looks", metavar="NAMES", help="Looks.")] = "",
    backends: Annotated[str, typer.Option("--backends", metavar="NAMES", help="What renders them.")] = "",
    samples: Annotated[str, typer.Option("--samples", metavar="COUNTS", help="Increasing powers of two.")] = "4,16,64",
    resolution: Annotated[
        int | None,
        typer.Option(
            "--resolution",
            metavar="PIXELS",
            help="Side of the frame; 256, with --denoise-trial 96.",
            show_default=False,
        ),
    ] = None,
    repeats: Annotated[
        int | None,
        typer.Option("--repeats", metavar="N", help="Renders of each count; 3, with --sequence 1.", show_default=False),
    ] = None,
    reference: Annotated[
        int, typer.Option("--reference", metavar="N", help="Samples of a reference, in largest counts.")
    ] = 8,
    seed: Annotated[int, typer.Option("--seed", metavar="N", help="Chooses the samples.")] = 0,
    everything: Annotated[bool, typer.Option("--all", help="Default to all names instead of a few.")] = False,
    sequence: Annotated[
        bool, typer.Option("--sequence", help="Turntables against a plain Blender script, and how cost grows.")
    ] = False,
    scale: Annotated[
        bool, typer.Option("--scale", help="Large assets up to the first sample, against Blender's own import.")
    ] = False,
    denoise_trial: Annotated[
        bool, typer.Option("--denoise-trial", help="Random denoised frames: is their error as measured?")
    ] = False,
    frames: Annotated[
        int,
        typer.Option("--frames", metavar="N", min=4, help="Of the growth test of --sequence, or of --denoise-trial."),
    ] = 100,
    fresh: Annotated[bool, typer.Option("--fresh", help="Render references anew.")] = False,
    out: Annotated[Path, typer.Option("--out", metavar="DIR", help="Folder of the results.")] = Path("out/bench"),
    show: Annotated[bool, typer.Option("--list", help="Only list the names.")] = False,
) -> None:
    """Measure time against error, beside other renderers; results so far are kept on Ctrl-C (exit code 130)."""
    from lookdev.bench.matrix import listing

    if show:
        say(listing())
        return
    from rich.console import Console

    from lookdev.bench.matrix import parse_options
    from lookdev.bench.report import print_results
    from lookdev.bench.run import run_matrix, run_sequence

    report = partial(say, err=True)
    if scale:
        from lookdev.bench.report import print_scale
        from lookdev.bench.scale import run_scale

        print_scale(run_scale(out, report, repeats=repeats or 3), Console())
        return
    if denoise_trial:
        from lookdev.bench import denoise_trial as trial

        side = resolution or trial.SIDE
        measured = trial.run_trial(frames, out, report, seed=seed, resolution=side, reference=reference, fresh=fresh)
        say(trial.summary(measured))
        raise typer.Exit(0 if len(measured) == frames else 130)
    options = parse_options(
        {"scenes": scenes, "ibls": ibls, "looks": looks, "backends": backends, "samples": samples},
        everything=everything,
        sequence=sequence,
        resolution=resolution,
        repeats=repeats,
        reference=reference,
        seed=seed,
        fresh=fresh,
    )

    results = run_sequence(options, out, report, frames=frames) if sequence else run_matrix(options, out, report)
    print_results(results, Console())
    raise typer.Exit(0 if results.complete else 130)
