"""Tables as text: aligned for the eye, or Markdown for files.

Never computes what it prints.
"""

from __future__ import annotations

from collections.abc import Sequence


def markdown(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A Markdown table, aligned so that it also reads as plain text.

    Examples:
        >>> print(markdown(["object", "ADD"], [["cup", "99 %"]]))
        | object |  ADD |
        | ------ | ---- |
        | cup    | 99 % |
    """
    widths = _widths(head, rows)
    lines = [_line(head, widths, " | "), _line(["-" * width for width in widths], widths, " | ")]
    lines += [_line(row, widths, " | ") for row in rows]
    return "\n".join(f"| {line} |" for line in lines)


def plain(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Aligned columns two spaces apart: the first to the left, the others to the right."""
    widths = _widths(head, rows)
    return "\n".join(_line(row, widths, "  ").rstrip() for row in (head, *rows))


def percent(share: float) -> str:
    """A share of 1 as percent with one digit.

    Examples:
        >>> percent(0.1234)
        '12.3 %'
    """
    return f"{100 * share:.1f} %"


def _widths(head: Sequence[str], rows: Sequence[Sequence[str]]) -> list[int]:
    return [max(len(cells[k]) for cells in (head, *rows)) for k in range(len(head))]


def _line(cells: Sequence[str], widths: Sequence[int], gap: str) -> str:
    first = cells[0].ljust(widths[0])
    others = [cell.rjust(width) for cell, width in zip(cells[1:], widths[1:], strict=True)]
    return gap.join([first, *others])
