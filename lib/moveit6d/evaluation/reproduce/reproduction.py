"""What a reproduction gives: tables, charts and notes, as Markdown, CSV and JSON.

Never computes a figure and never draws.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from statistics import median_low
from typing import Any

import numpy as np

from ...io import replacing, write_json
from ...visualization.charts import Chart, Sheet
from ..tables import markdown

Cell = float | int | str | None


@dataclass(frozen=True)
class Table:
    """A table; `name` is a file's stem. A cell of None is a dash: nobody has a figure there."""

    name: str
    title: str
    head: tuple[str, ...]
    rows: tuple[tuple[Cell, ...], ...]
    digits: int = 2

    def markdown(self) -> str:
        """The table in Markdown under its title."""
        rows = [[_text(cell, self.digits) for cell in row] for row in self.rows]
        return f"## {self.title}\n\n{markdown(self.head, rows)}\n"

    def csv(self) -> str:
        """The table with all digits; empty where there is no figure."""
        out = io.StringIO()
        writer = csv.writer(out, lineterminator="\n")
        writer.writerow(self.head)
        writer.writerows(["" if cell is None else cell for cell in row] for row in self.rows)
        return out.getvalue()


@dataclass(frozen=True)
class Reproduction:
    """One reproduction. `data` says in words what it was run on; `facts` are settings."""

    name: str
    title: str
    data: str
    tables: tuple[Table, ...]
    charts: tuple[Chart, ...] = ()
    notes: tuple[str, ...] = ()
    facts: Mapping[str, Any] = field(default_factory=dict)

    def markdown(self) -> str:
        """The report as it is printed and as NAME.md has it."""
        parts = [f"# {self.title}\n", f"Data: {self.data}.\n"]
        parts += [table.markdown() for table in self.tables]
        if self.notes:
            parts.append("Notes:\n\n" + "\n".join(f"- {note}" for note in self.notes) + "\n")
        return "\n".join(parts)


def write_reproduction(reproduction: Reproduction, folder: Path) -> list[Path]:
    """Write NAME.md, NAME.json and a CSV a table; the paths written.

    With one table the CSV is NAME.csv, with several NAME_TABLE.csv. Each file appears whole.
    """
    written = [folder / f"{reproduction.name}.md", folder / f"{reproduction.name}.json"]
    with replacing(written[0]) as temporary:
        temporary.write_text(reproduction.markdown(), encoding="utf-8")
    write_json(written[1], _content(reproduction))
    for table in reproduction.tables:
        stem = (
            reproduction.name
            if len(reproduction.tables) == 1
            else f"{reproduction.name}_{table.name}"
        )
        written.append(folder / f"{stem}.csv")
        with replacing(written[-1]) as temporary:
            temporary.write_text(table.csv(), encoding="utf-8")
    return written


def mean(values: Sequence[float | None]) -> float | None:
    """Mean of the figures that there are; None for none."""
    known = [value for value in values if value is not None]
    return float(np.mean(known)) if known else None


def median(counts: Sequence[int | None]) -> int | None:
    """Median of the counts that there are, the lower of two; None for none."""
    known = [count for count in counts if count is not None]
    return median_low(known) if known else None


def _content(reproduction: Reproduction) -> dict[str, Any]:
    """Everything but pictures."""
    curves = {
        chart.name: asdict(chart) for chart in reproduction.charts if not isinstance(chart, Sheet)
    }
    tables = {
        table.name: [dict(zip(table.head, row, strict=True)) for row in table.rows]
        for table in reproduction.tables
    }
    return {
        "name": reproduction.name,
        "title": reproduction.title,
        "data": reproduction.data,
        "facts": dict(reproduction.facts),
        "tables": tables,
        "charts": curves,
        "notes": list(reproduction.notes),
    }


def _text(cell: Cell, digits: int) -> str:
    if cell is None:
        return "-"
    return f"{cell:.{digits}f}" if isinstance(cell, float) else str(cell)
