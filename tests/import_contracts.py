"""A type of contract for import-linter, which restricts the modules that may import a package."""

from typing import Any

from importlinter import Contract, ContractCheck, fields, output


class Importers(Contract):  # type: ignore[misc]
    """A contract that only some modules of `lookdev` import certain packages.

    A line of `importers` is ``package: module ...``: only these modules, and modules below them, may import the
    package.
    """

    importers = fields.ListField(subfield=fields.StringField())

    def check(self, graph: Any, verbose: bool) -> ContractCheck:
        """Return the imports of each package by modules that are not in its line."""
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
