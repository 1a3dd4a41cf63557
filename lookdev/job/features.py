"""The features of a job that only some backends support: a table of them, and the check of a job's values."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from pydantic import AfterValidator, ValidationInfo

from lookdev.job.keys import key_error
from lookdev.rendering.backends import BACKENDS, Backend, job_backends


@dataclass(frozen=True)
class BackendFeature:
    """A feature that only some backends support.

    A *value* is the value of the job's key that asks for the feature.

    Attributes
    ----------
    available
        Returns whether a backend supports a value.
    problem
        Returns the message about a backend that does not support a value. The message continues the backend's name.
    hint
        Returns keys with values that would be right with the same backend, as texts.
    """

    available: Callable[[Backend, Any], bool]
    problem: Callable[[Backend, Any], str]
    hint: Callable[[Backend], tuple[str, ...]] = lambda backend: ()


def _quote_names(names: Any) -> str:
    return " or ".join(f'"{name}"' for name in names)


def _missing_passes(backend: Backend, passes: Any) -> str:
    return " and no ".join(name for name in passes if name not in backend.passes)


BACKEND_FEATURES: dict[str, BackendFeature] = {
    "device": BackendFeature(
        lambda backend, device: device in backend.devices,
        lambda backend, device: f"cannot run on '{device}': it is {backend.help}",
        lambda backend: (f"device = {_quote_names(backend.devices)}",),
    ),
    "denoise": BackendFeature(
        lambda backend, denoise: denoise == "off" or backend.has_denoising_guides,
        lambda backend, denoise: "renders no albedos and normals to denoise by",
    ),
    "space": BackendFeature(
        lambda backend, space: space in backend.spaces,
        lambda backend, space: "renders in linear Rec.709 alone",
    ),
    "passes": BackendFeature(
        lambda backend, passes: set(passes) <= set(backend.passes),
        lambda backend, passes: f"makes no {_missing_passes(backend, passes)}; it makes {', '.join(backend.passes)}",
    ),
    "charts": BackendFeature(
        lambda backend, charts: backend.has_isolated_parts,
        lambda backend, charts: "lets the props shadow one another",
    ),
    "ground": BackendFeature(
        lambda backend, kind: kind != "catcher" or backend.can_catch_shadows,
        lambda backend, kind: "renders no shadow catcher",
        lambda backend: ('kind = "plane"',),
    ),
    "light integrals": BackendFeature(
        lambda backend, value: backend.has_light_integral,
        lambda backend, value: "does not use this key",
    ),
}
"""The features by name.

The feature ``"light integrals"`` is that of all keys that control a backend's integral of the light, such as
``brdf_samples``. Each other feature has the name of its key; ``"ground"`` is that of the ground's ``kind``.
"""


def backend_supports(name: str) -> AfterValidator:
    """Return the validator of a key that needs a feature of `BACKEND_FEATURES`; the key ``backend`` comes before it."""

    def check(value: Any, info: ValidationInfo) -> Any:
        check_feature(name, info.data.get("backend", ""), value)
        return value

    return AfterValidator(check)


def check_feature(name: str, backend_name: str, value: Any) -> None:
    """Raise a key error if the backend of a job does not support a value of the job.

    `name` is the name of the feature. If there is no such backend, no error is raised here, because the validator of
    the key ``backend`` reports it.
    """
    feature, backend = BACKEND_FEATURES[name], BACKENDS.get(backend_name)
    if backend is None or feature.available(backend, value):
        return
    others = [other_name for other_name, other in job_backends().items() if feature.available(other, value)]
    hints = (*feature.hint(backend), *([f"backend = {_quote_names(others)}"] if others else []))
    raise key_error(f"backend '{backend.name}' {feature.problem(backend, value)}", ", or ".join(hints))
