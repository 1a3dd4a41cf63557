"""Looks that together use every lobe: rough and retroreflecting, coated, anisotropic, and near a mirror."""

from __future__ import annotations

from typing import Any

LOOKS: dict[str, dict[str, Any]] = {
    "diffuse": {"baseColor": (0.5, 0.4, 0.3), "roughness": 1.0},
    "cloth": {"baseColor": (0.3, 0.1, 0.4), "roughness": 0.8, "sheen": 1.0, "subsurface": 0.7, "variant": "2012"},
    "coated": {"baseColor": (0.1, 0.2, 0.5), "roughness": 0.4, "clearcoat": 1.0, "clearcoatGloss": 0.5},
    "brushed": {"baseColor": (0.9, 0.7, 0.4), "metallic": 1.0, "roughness": 0.4, "anisotropic": 0.8},
    "polished": {"baseColor": (0.9, 0.7, 0.4), "metallic": 1.0, "roughness": 0.15},
}
