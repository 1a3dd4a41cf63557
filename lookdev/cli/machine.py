"""The verb that checks this machine: doctor."""

from __future__ import annotations

import typer

from lookdev.cli.options import say

app = typer.Typer()


@app.command(rich_help_panel="Installation")
def doctor() -> None:
    """Check that this machine can render; list what is missing, and how to get it."""
    from lookdev.inspect.doctor import describe, examine

    findings = list(examine())
    say(describe(findings))
    raise typer.Exit(0 if all(finding.good for finding in findings) else 1)
