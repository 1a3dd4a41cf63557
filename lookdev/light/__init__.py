"""The light: environment maps, their mapping to directions, and the tables that importance-sample them."""

from lookdev.light.environment import BUILTIN_LIGHTS, EnvironmentMap, Repairs, load_environment
from lookdev.light.tables import LightDistribution, LightTables, prepare_light, read_distribution

LIGHT_TYPES: dict[str, type[LightTables]] = {"dome": LightTables}
"""The type of each kind of light."""

__all__ = [
    "BUILTIN_LIGHTS",
    "LIGHT_TYPES",
    "EnvironmentMap",
    "LightDistribution",
    "LightTables",
    "Repairs",
    "load_environment",
    "prepare_light",
    "read_distribution",
]
