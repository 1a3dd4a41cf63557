"""The writer of HTML reports: a Jinja2 template becomes one page, without scripts and without further files.

A template extends ``html_page.html``, which is beside this module.
"""

from __future__ import annotations

from base64 import b64encode
from pathlib import Path

from lookdev.cache import write_file
from lookdev.errors import replace_controls


def write_html_page(file: Path, template: Path, title: str, **values: object) -> None:
    """Write a page, complete or not at all, from a template and its `values`; text in the values is escaped.

    Raises UndefinedError where the template has a name without a value.
    """
    from jinja2 import Environment, FileSystemLoader, StrictUndefined  # not at the top: few commands write a page

    environment = Environment(
        loader=FileSystemLoader([template.parent, Path(__file__).parent]),
        autoescape=True,
        undefined=StrictUndefined,
        # Only plain text: the output of a macro is Markup, a subclass of str, and escaped already.
        finalize=lambda value: replace_controls(value) if type(value) is str else value,
    )
    environment.filters["base64"] = lambda data: b64encode(data).decode()
    write_file(file, environment.get_template(template.name).render(title=title, **values))
