"""From a model to shader code: symbolic arrays trace it, an emitter writes it."""

from lookdev.codegen.source import HANDEDNESS, AttributeBinding, PrincipledSource, ShaderSource, TextureBinding

__all__ = ["HANDEDNESS", "AttributeBinding", "PrincipledSource", "ShaderSource", "TextureBinding"]
