"""The page of a run: complete, self-contained, worst first, and alive in a real browser."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from moveit6d.datasets.pose_files import PoseRow
from moveit6d.datasets.video import VideoFrame
from moveit6d.errors import InputError
from moveit6d.evaluation.run_tracker import TrackSummary
from moveit6d.rendering.backends import make_renderer
from moveit6d.visualization import report
from moveit6d.visualization.curves import LEFT, RIGHT
from moveit6d.visualization.report import Run, index_page, report_page, write_report
from tests.support.browser import open_page


@dataclass(frozen=True)
class Errors:
    add: float
    translation: float
    rotation: float


class Film:
    """Eight frames of the brick; the sixth is damaged."""

    fps: float | None = None
    length: int | None = 8

    def __init__(self, scene: Any) -> None:
        self.images = [scene.image(frame) for frame in range(8)]

    def __iter__(self) -> Any:
        for index, image in enumerate(self.images):
            yield VideoFrame(index, f"{index}.png", None if index == 5 else image)


@pytest.fixture(scope="module")
def run(scene: Any) -> Run:
    rows = {
        frame: PoseRow(frame, f"{frame}.png", scene.pose(frame), 3, "stop_action", 0.9, 12.5)
        for frame in range(1, 8)
    }
    rows[0] = PoseRow(0, pose=scene.pose(0))
    rows[3] = replace(rows[3], confidence=0.2, iterations=30, stopped_by="max_iterations")
    rows[5] = PoseRow(5, "5.png", stopped_by="failed")
    rows[6] = replace(rows[6], reset=True)
    return Run(
        title="brick <1>",
        verdict="7 frames",
        mesh=scene.mesh,
        camera=scene.camera,
        frames=Film(scene),
        rows=rows,
        facts={"weights": "none & nothing"},
        failures={5: "5.png is <damaged>"},
    )


@pytest.fixture(scope="module")
def scored(run: Run, scene: Any) -> Run:
    errors = {
        frame: Errors(0.001 * frame, 0.002, 1.0)
        if run.rows[frame].pose is not None
        else Errors(math.inf, math.inf, 180.0)
        for frame in range(1, 8)
    }
    errors[2] = Errors(0.05, 0.04, 20.0)
    return replace(run, errors=errors, truth={frame: scene.pose(frame) for frame in range(8)})


def order(page: str) -> list[int]:
    return [int(number) for number in re.findall(r'data-frame="(\d+)"', page)]


def worst_pictures(page: str) -> list[int]:
    gallery = page[page.index("Worst frames first") : page.index("Every frame")]
    return [int(number) for number in re.findall(r'alt="frame (\d+)"', gallery)]


def test_without_truth_confidence_says_what_is_bad(run: Run) -> None:
    page = report_page(run, make_renderer())
    assert order(page)[:2] == [5, 3] and order(page)[-1] == 0 and len(order(page)) == 8
    assert worst_pictures(page)[:2] == [5, 3]
    assert "ADD" not in page and "max_iterations" in page and "30 iterations" in page
    assert sorted(re.findall(r'<tr class="bad" id="f(\d)"', page)) == ["3", "5"]


def test_a_frame_without_a_pose_says_why_and_no_more(run: Run) -> None:
    assert report._says(replace(run, failures={5: "It is lost."}), 5) == "It is lost"
    assert report._says(replace(run, failures={}), 5) == "no pose"


def test_a_state_says_more_than_the_confidence(run: Run) -> None:
    rows = {
        frame: replace(row, state="uncertain" if frame == 2 else "tracking")
        for frame, row in run.rows.items()
    }
    told = replace(run, rows=rows)
    missing = [frame for frame, row in run.rows.items() if row.pose is None]
    assert [frame for frame in rows if told.bad(frame)] == sorted([2, *missing])


def test_with_truth_errors_do(scored: Run) -> None:
    page = report_page(scored, make_renderer())
    assert order(page) == [5, 2, 7, 6, 4, 3, 1, 0]
    assert worst_pictures(page)[:2] == [5, 2]
    row = page[page.index('id="f2"') :].split("</tr>")[0]
    cells = re.findall(r"<td[^>]*>(.*?)</td>", row)
    share = f"{100 * 0.05 / scored.mesh.diameter:.1f}"
    assert cells == ["2", "50.0", share, "40.0", "20.00", "0.90", "3", "stop_action", "12.5", ""]
    assert "set to the true pose" in page


def test_what_files_say_is_text_and_nothing_comes_from_outside(run: Run) -> None:
    page = report_page(run, make_renderer())
    assert "brick &lt;1&gt;" in page and "5.png is &lt;damaged&gt;" in page
    assert "none &amp; nothing" in page and "<damaged>" not in page
    sources = re.findall(r'(?:src|href)="([^"]*)"', page)
    assert sources and all(word.startswith(("data:image/jpeg", "#")) for word in sources)
    assert "@import" not in page and "url(http" not in page


def test_the_page_is_alive_in_a_browser(scored: Run, tmp_path: Path) -> None:
    path = tmp_path / "deep" / "report.html"
    write_report(path, scored, make_renderer())
    probe = """<script>
      document.body.dataset.pictures =
        [...document.images].filter(image => image.naturalWidth > 0).length;
      const box = document.querySelector('.curves').getBoundingClientRect();
      document.querySelector('.curves').dispatchEvent(
        new MouseEvent('mousemove', {clientX: box.left + box.width * 0.984}));
      document.querySelector('button.order').click();
      document.body.dataset.tooWide =
        document.documentElement.scrollWidth > document.documentElement.clientWidth;
    </script>"""
    (tmp_path / "probed.html").write_text(path.read_text().replace("</body>", probe + "</body>"))
    seen = open_page(tmp_path / "probed.html", tmp_path / "home")
    body = re.search(r"<body([^>]*)>", seen)
    assert body is not None
    assert 'data-rows="8"' in body[1] and 'data-pictures="16"' in body[1]
    assert 'data-too-wide="false"' in body[1]
    assert re.search(r'class="says">frame 7: ADD 7\.0 mm', seen), "the curve's right end is frame 7"
    assert order(seen) == list(range(8)), "the button puts frames in order"


def test_no_frame_no_page(run: Run, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="at least one frame"):
        write_report(tmp_path / "report.html", replace(run, rows={}), make_renderer())
    assert list(tmp_path.iterdir()) == []


def test_a_long_run_stays_a_small_page(run: Run, scene: Any) -> None:
    class Endless:
        length: int | None = None
        fps: float | None = None

        def __iter__(self) -> Any:
            for index in range(3000):
                yield VideoFrame(index, "", np.zeros((120, 160, 3), np.uint8))

    row = run.rows[1]
    long = replace(
        run, frames=Endless(), rows={k: replace(row, frame=k) for k in range(3000)}, failures={}
    )
    page = report_page(long, make_renderer())
    assert len(order(page)) == 3000 and page.count("data:image/jpeg") == 24
    assert len(page) < 3_000_000


def test_the_index_leads_to_the_pages() -> None:
    table = {"heading": "All", "head": ["sequence", "ADD"], "rows": [[("a b", "a%20b.html"), "5"]]}
    page = index_page("bench", "1 sequence", "| a | b |", table)
    assert '<a href="a%20b.html">a b</a>' in page and "| a | b |" in page


@pytest.fixture(scope="module")
def told(run: Run, scene: Any) -> Run:
    """Tracked, uncertain, lost without a pose, tracked, and lost again."""
    states = ["tracking", "tracking", "uncertain", "lost", "lost", "lost", "tracking", "lost"]
    sure = {"tracking": 0.8, "uncertain": 0.5, "lost": None}
    poses = [None if state == "lost" else scene.pose(k) for k, state in enumerate(states)]
    rows = {
        k: PoseRow(
            k, "", poses[k], 3, "stop_action", 0.9, 5.0, state=state, probability=sure[state]
        )
        for k, state in enumerate(states)
    }
    return replace(run, rows=rows, failures={})


def test_the_states_are_in_the_table_and_listed(told: Run) -> None:
    page = report_page(told, make_renderer())
    events = page[page.index("<h2>States") : page.index("<h2>Every frame")]
    cells = re.findall(r"<td[^>]*>(?:<a[^>]*>)?(.*?)(?:</a>)?</td>", events)
    assert cells == [
        "tracking", "0", "1", "2", "uncertain", "2", "2", "1", "lost", "3", "5", "3",
        "tracking", "6", "6", "1", "lost", "7", "7", "1",
    ]  # fmt: skip
    record = TrackSummary()
    for row in told.rows.values():
        record.add_row(row)
    assert cells[::4] == [event["state"] for event in record.events]
    row = page[page.index('id="f2"') :].split("</tr>")[0]
    assert re.findall(r"<td[^>]*>(.*?)</td>", row)[1:4] == ["0.90", "0.50", "uncertain"]
    assert "uncertain, confidence 0.90" in page


def test_bands_show_where_the_object_is_not_tracked(told: Run) -> None:
    page = report_page(told, make_renderer())
    found = re.findall(r'class="band (\w+)" style="left:([\d.]+)%;width:([\d.]+)%"', page)
    assert [state for state, *_ in found] == ["uncertain", "lost", "lost"] * 2, "and in a strip"
    left, width = float(found[1][1]), float(found[1][2])
    frame = 100 * (RIGHT - LEFT) / 8
    assert left == pytest.approx(100 * LEFT + 3 * frame, abs=0.01)
    assert width == pytest.approx(3 * frame, abs=0.01)


def test_of_each_loss_one_picture_is_shown(told: Run) -> None:
    assert worst_pictures(report_page(told, make_renderer())) == [3, 7, 2, 0, 1, 6]
    kept = replace(
        told, rows={k: replace(row, pose=told.rows[0].pose) for k, row in told.rows.items()}
    )
    # A lost object that has poses is no better than one without.
    assert {3, 4, 5}.intersection(worst_pictures(report_page(kept, make_renderer()))) == {3}
    often = {
        k: replace(told.rows[0 if k % 4 else 3], frame=k, probability=0.5 if k % 4 else None)
        for k in range(40)
    }
    shown = worst_pictures(report_page(replace(told, rows=often), make_renderer()))
    assert len(shown) == 12 and sum(k % 4 == 0 for k in shown) == 4
