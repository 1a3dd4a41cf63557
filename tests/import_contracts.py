"""A contract of import-linter that the gate checks: which modules may import a package."""

from typing import Any

from importlinter import Contract, ContractCheck, fields, output


class Importers(Contract):  # type: ignore[misc]
    """Each line of `importers` is ``package: module ...``: these modules of `lookdev` import the package, no others.

    A module's name includes all modules below it.
    """

    importers = fields.ListField(subfield=fields.StringField())

    def check(self, graph: Any, verbose: bool) -> ContractCheck:
        """Return the imports of each package by modules that its line does not name."""
        wrong = []
        for line in self.importers:
            package, _, names = line.partition(":")
            allowed = [f"lookdev.{name}" for name in names.split()]
            importers = graph.find_modules_that_directly_import(package) if package in graph.modules else ()
            wrong += [
                (package, module)
                for module in sorted(importers)
                if not any(f"{module}.".startswith(f"{name}.") for name in allowed)
            ]
        return ContractCheck(kept=not wrong, metadata={"wrong": wrong})

    def render_broken_contract(self, check: ContractCheck) -> None:
        """Print each import that is not allowed."""
        for package, module in check.metadata["wrong"]:
            output.print_error(f"{module} imports {package}", bold=False)
