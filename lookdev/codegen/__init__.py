"""From a model to shader code: symbolic arrays trace it, emitters write it."""

from lookdev.codegen.source import (
    HANDEDNESS,
    TANGENT,
    AttributeBinding,
    GroupSocket,
    Link,
    NodeSource,
    NodeTree,
    PrincipledSource,
    ShaderNode,
    ShaderSource,
    Source,
    TableBinding,
    TextureBinding,
    short_name,
)

__all__ = [
    "HANDEDNESS",
    "TANGENT",
    "AttributeBinding",
    "GroupSocket",
    "Link",
    "NodeSource",
    "NodeTree",
    "PrincipledSource",
    "ShaderNode",
    "ShaderSource",
    "Source",
    "TableBinding",
    "TextureBinding",
    "short_name",
]
