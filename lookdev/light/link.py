"""Which parts of an asset a light is linked to: light links and shadow links, as plain data."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

MOST_GROUPS = 80
"""How many groups of parts shadow links can tell apart, besides those that cast all shadows."""


@dataclass(frozen=True)
class Link:
    """The parts of an asset that a light shines on, or that cast its shadow.

    `rules` are (path, rule), sorted, each rule ``"expandPrims"``, ``"explicitOnly"`` or ``"exclude"``: those of
    `UsdCollectionMembershipQuery`, with paths of the asset as `lookdev.scene.dress.Part.path` has them.
    """

    rules: tuple[tuple[str, str], ...]

    @cached_property
    def _rules(self) -> Mapping[str, str]:
        return dict(self.rules)

    def includes(self, path: str) -> bool:
        """Return whether a part is linked: by the rule of its path, or of the nearest prim above it that has one.

        ``"explicitOnly"`` counts for its path alone.
        """
        if (rule := self._rules.get(path)) is not None:
            return rule != "exclude"
        while path.strip("/"):
            path = path.rpartition("/")[0] or "/"
            if (rule := self._rules.get(path)) in ("expandPrims", "exclude"):
                return rule == "expandPrims"
        return False
