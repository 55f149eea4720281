"""What a reproduction gives as files: Markdown for people, CSV and JSON with all digits."""

import csv
import json
from pathlib import Path

from moveit6d.evaluation.reproduce.reproduction import Reproduction, Table, mean, write_reproduction
from moveit6d.visualization.charts import Curve, LineChart, Panel, Sheet

TABLE = Table("main", "Errors", ("object", "ours", "n"), (("cup", 1 / 3, 4), ("pan", None, 0)))


def a_reproduction(*tables: Table) -> Reproduction:
    chart = LineChart("curve", "C", "m", "%", (Curve("ours", (0.0, 1.0), (2.0, float("inf"))),))
    sheet = Sheet("sheet", "S", 1, (Panel("nothing"),))
    return Reproduction(
        "demo", "A demonstration", "surrogate", tables, (chart, sheet), ("A note.",), {"mode": "x"}
    )


def test_a_figure_that_nobody_has_is_a_dash() -> None:
    text = a_reproduction(TABLE).markdown()
    assert "Data: surrogate." in text and "- A note." in text
    rows = [line for line in text.splitlines() if line.startswith("|")]
    assert [cell.strip() for cell in rows[2].split("|")[1:-1]] == ["cup", "0.33", "4"]
    assert [cell.strip() for cell in rows[3].split("|")[1:-1]] == ["pan", "-", "0"]


def test_files_hold_all_digits(tmp_path: Path) -> None:
    written = write_reproduction(a_reproduction(TABLE), tmp_path / "new")
    assert [path.name for path in written] == ["demo.md", "demo.json", "demo.csv"]
    rows = list(csv.reader(written[2].read_text(encoding="utf-8").splitlines()))
    assert rows == [["object", "ours", "n"], ["cup", str(1 / 3), "4"], ["pan", "", "0"]]
    content = json.loads(written[1].read_text(encoding="utf-8"))
    assert content["tables"]["main"][0] == {"object": "cup", "ours": 1 / 3, "n": 4}
    assert content["tables"]["main"][1]["ours"] is None and content["facts"] == {"mode": "x"}
    assert content["charts"]["curve"]["curves"][0]["y"] == [2.0, None]
    assert "sheet" not in content["charts"]


def test_several_tables_are_several_files(tmp_path: Path) -> None:
    other = Table("more", "More", ("a",), ((1,),))
    written = write_reproduction(a_reproduction(TABLE, other), tmp_path)
    assert [path.name for path in written[2:]] == ["demo_main.csv", "demo_more.csv"]


def test_the_mean_leaves_out_what_is_missing() -> None:
    assert mean([1.0, None, 2.0]) == 1.5
    assert mean([None]) is None
