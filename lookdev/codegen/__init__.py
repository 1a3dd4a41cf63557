"""From a model to shader code: symbolic arrays trace it, an emitter writes it."""

from lookdev.codegen.source import AttributeBinding, ShaderSource, TextureBinding

__all__ = ["AttributeBinding", "ShaderSource", "TextureBinding"]
