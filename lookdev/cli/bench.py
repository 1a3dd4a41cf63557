"""The verb that measures speed: bench."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Annotated

import typer

from lookdev.cli.options import say

app = typer.Typer()

_KINDS = "Other benchmarks"
_CHOICE = "Selection"


def _number(name: str, help_text: str) -> object:
    """Return the option of a number whose default depends on the kind of benchmark."""
    return typer.Option(name, metavar="N", help=help_text, show_default=False, rich_help_panel=_CHOICE)


def _names(name: str, help_text: str) -> object:
    return typer.Option(name, metavar="NAMES", help=help_text, show_default=False, rich_help_panel=_CHOICE)


def _document(name: str, help_text: str) -> object:
    return typer.Option(name, metavar="FILE", help=help_text, show_default=False, rich_help_panel=_KINDS)


@app.command(rich_help_panel="Accuracy and speed")
def bench(
    table: Annotated[
        Path | None, _document("--table", "Time to an error beside other renderers, growth, plots: for docs/bench.md.")
    ] = None,
    profile: Annotated[
        Path | None, _document("--profile", "Where a second of rendering goes: for docs/bench.md.")
    ] = None,
    setup: Annotated[
        Path | None,
        typer.Option(
            "--setup",
            metavar="FILE",
            help="Whole commands, a first frame, changes of scene: for docs/bench.md.",
            rich_help_panel=_KINDS,
        ),
    ] = None,
    sequence: Annotated[
        bool, typer.Option("--sequence", help="Turntables against a plain Blender script.", rich_help_panel=_KINDS)
    ] = False,
    scale: Annotated[
        bool, typer.Option("--scale", help="Large assets, against Blender's own import.", rich_help_panel=_KINDS)
    ] = False,
    denoise_trial: Annotated[
        bool,
        typer.Option(
            "--denoise-trial", help="Random denoised frames: is their error as measured?", rich_help_panel=_KINDS
        ),
    ] = False,
    scenes: Annotated[str, _names("--scenes", "Scenes, separated by commas.")] = "",
    ibls: Annotated[str, _names("--ibls", "Lights.")] = "",
    looks: Annotated[str, _names("--looks", "Looks.")] = "",
    backends: Annotated[str, _names("--backends", "Backends.")] = "",
    samples: Annotated[str, _names("--samples", "Increasing powers of two, like 4,16,64.")] = "",
    resolution: Annotated[int | None, _number("--resolution", "Side of the frame, pixels.")] = None,
    repeats: Annotated[int | None, _number("--repeats", "Renders with each number of samples.")] = None,
    reference: Annotated[
        int | None, _number("--reference", "Samples of a reference, as a multiple of the largest count.")
    ] = None,
    seed: Annotated[int | None, _number("--seed", "Seed of the samples.")] = None,
    frames: Annotated[
        int | None, _number("--frames", "Frames of the sequence whose growth is measured, or of the trial.")
    ] = None,
    everything: Annotated[
        bool, typer.Option("--all", help="Default to all names instead of a few.", rich_help_panel=_CHOICE)
    ] = False,
    fresh: Annotated[bool, typer.Option("--fresh", help="Render references anew.")] = False,
    out: Annotated[Path, typer.Option("--out", metavar="DIR", help="Folder of the results.")] = Path("out/bench"),
    show: Annotated[bool, typer.Option("--list", help="Only list the names.")] = False,
) -> None:
    """Measure time against error, beside other renderers; Ctrl-C keeps the results so far (exit code 130)."""
    from lookdev.bench.kinds import KINDS
    from lookdev.bench.options import list_names, parse_options
    from lookdev.errors import LookdevError

    if show:
        say(list_names())
        return
    files = {"table": table, "profile": profile, "setup": setup}
    kinds: dict[str, Path | None] = {name: file for name, file in files.items() if file}
    flags = {"sequence": sequence, "denoise-trial": denoise_trial, "scale": scale}
    kinds |= {name: None for name, is_set in flags.items() if is_set}
    if len(kinds) > 1:
        raise LookdevError(f"one kind of benchmark at a time, not {' and '.join(f'--{name}' for name in kinds)}")
    name, document = next(iter(kinds.items()), ("matrix", None))
    options = parse_options(
        {"scenes": scenes, "ibls": ibls, "looks": looks, "backends": backends, "samples": samples},
        defaults=KINDS[name].DEFAULTS,
        everything=everything,
        resolution=resolution,
        repeats=repeats,
        reference=reference,
        seed=seed,
        frames=frames,
        fresh=fresh,
    )
    benchmark = KINDS[name](options=options, report=partial(say, err=True))
    benchmark.run(out, document)
    say(benchmark.summary())
    raise typer.Exit(benchmark.exit_code)
