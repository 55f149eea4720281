"""Fills the template of a report: one HTML page that needs nothing from outside.

Never computes what it shows. What comes from files (names, messages) is escaped by the template
engine; without JavaScript all of it can still be read.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any

TEMPLATE = "report.html.j2"  # in `templates`, beside this module


def render_page(**content: Any) -> str:
    """The page's text. What is not given is left out; `title` and `verdict` always are."""
    nothing: dict[str, Any] = {
        "facts": {},
        "curves": "",
        "limits": {},
        "key": "",
        "galleries": [],
        "tables": [],
        "text": "",
    }
    text: str = _template().render(**{**nothing, **content})
    return text


@lru_cache(maxsize=1)
def _template() -> Any:
    from importlib import resources

    from jinja2 import Environment, StrictUndefined

    source = resources.files(__package__).joinpath("templates", TEMPLATE)
    environment = Environment(autoescape=True, undefined=StrictUndefined, trim_blocks=True)
    return environment.from_string(source.read_text(encoding="utf-8"))
