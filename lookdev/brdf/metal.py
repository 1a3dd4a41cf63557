"""Parameters of Fresnel's equations."""

from __future__ import annotations

from lookdev.brdf.parameters import Parameter

INTERFACE: dict[str, Parameter] = {
    parameter.name: parameter
    for parameter in (
        Parameter("eta", "float", 1.5, (0.05, 10.0), (0.05, 5.0), help="Real part of the index of refraction."),
        Parameter("k", "float", 0.0, (0.0, 20.0), (0.0, 10.0), help="Imaginary part of the index of refraction."),
        Parameter("externalIor", "float", 1.0, (1.0, 4.0), (1.0, 2.0), help="Index from which light arrives."),
        Parameter("polarisation", "float", 0.5, help="0 all perpendicular to the plane of incidence, 1 all parallel."),
    )
}
"""Between a dielectric and what may be a conductor, for one wavelength."""
