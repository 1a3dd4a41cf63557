"""The model `MEASURED`: f is looked up in the samples of a file of measured reflectance; nothing is fitted.

The model has one lobe. `files` reads the file formats, `grids` looks up f, and `proposal` draws directions by tables
that are made from the samples. `synthetic` makes measurements of other models, for tests and for `BUILT_IN`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import lru_cache
from pathlib import Path
from threading import Lock

import numpy as np

from lookdev.brdf.frames import frame_of
from lookdev.brdf.lobes import Bsdf, DirectionPair, Lobe
from lookdev.brdf.measured.files import read_grid
from lookdev.brdf.measured.grids import IsotropicGrid, MeasurementGrid
from lookdev.brdf.measured.proposal import Proposal, make_proposal
from lookdev.brdf.measured.synthetic import plastic_grid
from lookdev.brdf.model import Model, Preview, StackLayer
from lookdev.brdf.parameters import Parameter, normal_parameter, parameters_by_name, token_parameter
from lookdev.brdf.vectors import Array, Parameters, Real, scale

BUILT_IN = "builtin:plastic"
"""The name that, in place of a file's path, selects the measurement `synthetic.plastic_grid`."""


def load_grid(file: str) -> MeasurementGrid:
    """Return the samples of a file, given by its path, or of `BUILT_IN`; raise ModelError if it is not readable."""
    return plastic_grid() if file == BUILT_IN else read_grid(Path(file))


_proposal_lock = Lock()


def _load_proposal(grid: MeasurementGrid) -> Proposal:
    """Return the sampling tables of a grid, from a cache."""
    with _proposal_lock:  # tables take seconds to make: a second thread waits for them
        return _make_cached_proposal(grid)


@lru_cache(maxsize=8)
def _make_cached_proposal(grid: MeasurementGrid) -> Proposal:
    return make_proposal(grid)


def _bsdf(p: Parameters) -> Bsdf:
    """Return the BSDF of the model (`Model.bsdf`)."""
    grid = load_grid(p["file"])
    proposal = _load_proposal(grid)

    def evaluate(d: DirectionPair) -> Array:
        return scale(grid.f(d, p["interpolation"]), p["scale"])

    def lobes(wo: Array) -> tuple[Lobe, ...]:
        frame = frame_of(p["normal"]).bend_towards(wo)
        local = frame.to_local(wo)
        lobe = Lobe(
            "measured",
            "measured",
            share=p["scale"] * float(np.mean(proposal.albedo)),
            evaluate=evaluate,
            pdf=proposal.pdf,
            sample=lambda u1, u2: proposal.sample(local, u1, u2),
            group="specular",
            frame=frame,
        )
        return (lobe,)

    return Bsdf(lobes)


def _combine(layers: Sequence[StackLayer]) -> Bsdf:
    """Return the BSDF of layers, base first; masks blend the f of the layers.

    The layers cannot be blended by their parameters, as a file is not a number.
    """

    def lobes(wo: Array) -> tuple[Lobe, ...]:
        lobes_above: tuple[Lobe, ...] = ()
        visible: Real = 1.0  # the share that the layers above leave visible; the loop begins at the top
        for layer in layers[:0:-1]:
            lobes_above = (
                *(lobe.blend(visible * layer.mask) for lobe in _bsdf(layer.parameters).lobes(wo)),
                *lobes_above,
            )
            visible = visible * (1.0 - layer.mask)
        return *(lobe.blend(visible) for lobe in _bsdf(layers[0].parameters).lobes(wo)), *lobes_above

    return Bsdf(lobes)


def _reciprocal(tokens: Mapping[str, str]) -> tuple[str, ...]:
    """Return the names of the reciprocal lobes (`Model.reciprocal`)."""
    return ("measured",) if isinstance(load_grid(tokens["file"]), IsotropicGrid) else ()


def _energy(tokens: Mapping[str, str]) -> float:
    # The tables have the albedo for some views. Between these views, the albedo differs by less than a tenth from the
    # values of the tables.
    return 1.1 * float(_load_proposal(load_grid(tokens["file"])).albedo.max())


def _preview(p: Parameters) -> dict[str, Real]:
    # The colour is the mean albedo over the views of the tables, weighted by their shares of the projected hemisphere.
    proposal = _load_proposal(load_grid(p["file"]))
    theta = (np.arange(len(proposal.albedo)) + 0.5) * 0.5 * np.pi / len(proposal.albedo)
    weights = np.sin(2.0 * theta)
    color = (proposal.albedo * weights[:, None]).sum(axis=0) / weights.sum()
    return {"diffuseColor": np.minimum(p["scale"] * color, 1.0), "f0": 0.0}


MEASURED = Model(
    name="measured",
    title="Measured",
    text="Measured reflectance: a MERL binary (Matusik et al. 2003), or anisotropic data of Ngan et al. (2005).",
    parameters=parameters_by_name(
        Parameter(
            "file",
            "token",
            "",
            choices=(BUILT_IN,),
            agreement="own",
            file=load_grid,
            help="A MERL binary or anisotropic data of Ngan et al.; builtin:plastic is a synthetic measurement.",
        ),
        token_parameter(
            "interpolation",
            ("linear", "nearest"),
            "linear: between the samples beside the angles. nearest: the sample of their cell.",
        ),
        Parameter("scale", "float", 1.0, hard=(0.0, 100.0), help="A factor of all samples."),
        normal_parameter("normal", "Normal of the lobe, in the frame of tangent, bitangent and shading normal."),
    ),
    bsdf=_bsdf,
    identifier="LookdevMeasured",
    energy=_energy,
    reciprocal=_reciprocal,
    combine=_combine,
    probe={"file": BUILT_IN},
    preview=Preview(derived=_preview),
)
