"""The light: environment maps, their mapping to directions, and the tables that importance-sample them."""

from lookdev.light.environment import BUILTIN_LIGHTS, EnvironmentMap, Repairs, load_environment
from lookdev.light.tables import LightDistribution, LightTables, prepare_light, read_distribution

__all__ = [
    "BUILTIN_LIGHTS",
    "EnvironmentMap",
    "LightDistribution",
    "LightTables",
    "Repairs",
    "load_environment",
    "prepare_light",
    "read_distribution",
]
