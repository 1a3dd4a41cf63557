"""Light links and shadow links: the parts of an asset that a light is linked to, as plain data."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

MOST_GROUPS = 80
"""The most groups of parts that shadow links can distinguish, not counting the group that casts all shadows."""


@dataclass(frozen=True)
class Link:
    """The parts of an asset that a light illuminates, or that cast its shadow.

    `rules` are sorted pairs of a path and a rule: ``"expandPrims"``, ``"explicitOnly"`` or ``"exclude"``, as in
    `UsdCollectionMembershipQuery`. Paths are those of `lookdev.scene.dress.Part.path`.
    """

    rules: tuple[tuple[str, str], ...]

    @cached_property
    def _rules(self) -> Mapping[str, str]:
        return dict(self.rules)

    def includes(self, path: str) -> bool:
        """Return whether a part is linked, by the rule of its path or of its nearest ancestor that has a rule.

        ``"explicitOnly"`` applies to its path alone.
        """
        if (rule := self._rules.get(path)) is not None:
            return rule != "exclude"
        while path.strip("/"):
            path = path.rpartition("/")[0] or "/"
            if (rule := self._rules.get(path)) in ("expandPrims", "exclude"):
                return rule == "expandPrims"
        return False
