"""A track that was interrupted is gone on with."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import av
import pytest
import torch

from moveit6d.cli.common import given, weights_facts
from moveit6d.cli.journal import Journal
from moveit6d.cli.main import main, make_parser
from moveit6d.cli.resuming import earlier_rows, earlier_tracks, tell, track_facts
from moveit6d.cli.track_summary import track_record
from moveit6d.config import TrackerConfig
from moveit6d.datasets.pose_files import PoseRow, read_poses, write_poses
from moveit6d.datasets.video import VideoFrame
from moveit6d.errors import InputError
from moveit6d.estimation import PoseTracker
from moveit6d.evaluation.run_tracker import run_tracker
from moveit6d.geometry.mesh import Mesh
from moveit6d.geometry.pose import Pose
from moveit6d.io import read_json, write_json
from moveit6d.policies import OraclePolicy
from moveit6d.rendering.backends import make_renderer
from tests.support.clip import Clip

Make = Callable[..., Any]


def rows_before(folder: Path, args: argparse.Namespace, config: TrackerConfig) -> list[PoseRow]:
    return earlier_rows(folder, args, track_facts(args, config))


def frames_in(path: Path) -> int:
    with av.open(str(path)) as container:
        return sum(1 for _ in container.decode(video=0))


def test_a_track_is_gone_on_with(
    clip: Clip, interrupt_update: Callable[[int], None], monkeypatch: pytest.MonkeyPatch
) -> None:
    with monkeypatch.context():
        interrupt_update(3)
        assert clip.track() == 130
    monkeypatch.undo()
    before = (clip.output / "poses.csv").read_text()
    assert clip.track("--resume", "--exact_start") == 2, "begun without --exact_start"
    assert clip.track("--resume", "--contour.lines", "50") == 2, "begun with other settings"
    assert clip.track("--resume") == 0
    assert (clip.output / "poses.csv").read_text().startswith(before)
    rows = read_poses(clip.output / "poses.csv")
    assert [row.frame for row in rows] == [0, 1, 2, 3, 4]
    assert frames_in(clip.output / "overlay_000002.mp4") == 3
    assert clip.summary()["frames"] == 5 and clip.summary()["interrupted"] is False
    assert clip.track("--resume") == 0, "nothing is left to do"
    assert len(read_poses(clip.output / "poses.csv")) == 5


def test_a_mesh_may_be_far_from_its_origin(
    clip: Clip,
    scene: Any,
    use_oracle: Callable[..., None],
    interrupt_update: Callable[[int], None],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    lines = [f"v {x} {y} {z} {r} {g} {b}" for (x, y, z), (r, g, b) in zip(
        scene.mesh.vertices + [200.0, 0.0, 0.0], scene.mesh.vertex_colors / 255, strict=True
    )]  # fmt: skip
    lines += [f"f {a} {b} {c}" for a, b, c in scene.mesh.faces + 1]
    (clip.folder / "far.obj").write_text("\n".join(lines))
    far = Mesh.load(clip.folder / "far.obj", "m")
    pose = far.outer(scene.mesh.inner(clip.true))
    pose.save(clip.folder / "far.json")
    options = {"mesh": str(clip.folder / "far.obj"), "start": str(clip.folder / "far.json")}
    with monkeypatch.context():
        use_oracle(far, pose)
        interrupt_update(3)
        assert clip.track("--no_overlay", **options) == 130
    monkeypatch.undo()
    use_oracle(far, pose)
    assert clip.track("--no_overlay", "--resume", **options) == 0
    rows = read_poses(clip.output / "poses.csv", center=far.center)
    assert [row.state for row in rows] == ["tracking"] * 5


def damage(clip: Clip, *numbers: int) -> None:
    for number in numbers:
        (clip.folder / "frames" / f"{number:06d}.png").write_bytes(b"no picture")


def test_a_track_is_gone_on_with_over_frames_that_cannot_be_read(
    clip: Clip, interrupt_update: Callable[[int], None], monkeypatch: pytest.MonkeyPatch
) -> None:
    damage(clip, 1, 2, 3)
    options = ("--no_overlay", "--no_recovery")  # a search would take seconds
    assert clip.track(*options) == 0
    whole = read_poses(clip.output / "poses.csv")
    assert [row.state for row in whole[1:4]] == ["uncertain"] * 3
    interrupt_update(4)
    assert clip.track(*options) == 130
    monkeypatch.undo()
    assert clip.track(*options, "--resume") == 0
    gone_on = read_poses(clip.output / "poses.csv")
    assert [(row.frame, row.state, row.stopped_by) for row in gone_on] == [
        (row.frame, row.state, row.stopped_by) for row in whole
    ]


@pytest.mark.parametrize("pattern", ["++---", "++-+--", "-----+-", "++----+", "++sss-s"])
def test_a_tracker_that_is_told_the_rows_knows_what_the_other_knew(
    scene: Any, pattern: str
) -> None:
    def tracker() -> PoseTracker[Any]:
        oracle = OraclePolicy(Pose.stack([scene.mesh.inner(scene.pose(0))]))
        start = scene.pose(0)
        return PoseTracker(scene.mesh, scene.camera, start, policy=oracle, renderer=make_renderer())

    image, one, other = scene.image(0), tracker(), tracker()
    images = {"+": image, "-": None, "s": image[::2, ::2]}  # s: of another size
    frames = [VideoFrame(k, "", images[s]) for k, s in enumerate(pattern)]
    for step in run_tracker(one, frames):
        tell(other, step.row)
    (before,), (after,) = one.tracks, other.tracks
    assert one.supervisors[0].machine == other.supervisors[0].machine
    for name in ("above_low", "above_high", "slow", "frames_low", "frames_unconfident"):
        assert getattr(before, name) == getattr(after, name), name
    assert (before.velocity is None) == (after.velocity is None)
    if before.velocity is not None and after.velocity is not None:
        torch.testing.assert_close(before.velocity, after.velocity, atol=1e-6, rtol=0)


def test_an_object_that_was_found_before_is_compared_with_its_half_turns(scene: Any) -> None:
    tracker: Any = PoseTracker(scene.mesh, scene.camera)
    (one,) = tracker.supervisors
    for row in (PoseRow(0, state="lost", milliseconds=1.0), PoseRow(1, state="lost")):
        tell(tracker, row)
    assert one.check is None
    found = PoseRow(2, pose=scene.pose(0), confidence=0.9, milliseconds=1.0, state="uncertain")
    tell(tracker, found)
    assert one.check is not None and one.look._unasked > 0
    first = one.check
    tell(tracker, replace(found, frame=3, state="tracking"))
    assert one.check is first, "it is found once"


def test_what_is_live_cannot_be_gone_on_with(
    clip: Clip, monkeypatch: pytest.MonkeyPatch, capsys: Any
) -> None:
    from moveit6d.datasets import video

    class Live(video.ImageFolder):
        live = True

    monkeypatch.setattr(video, "open_frames", lambda source: Live(clip.folder / "frames"))
    assert clip.track("--resume", video="0") == 2
    said = capsys.readouterr().err
    assert "--resume: 0 is live" in said and "leave out --resume and give another --output" in said
    assert not clip.output.exists()


def arguments(output: Path, *more: str) -> argparse.Namespace:
    mesh, camera = output / "a.ply", output / "c.json"
    for path in (mesh, camera):
        if not path.exists():
            path.write_text("as it was")
    words = ["--mesh", str(mesh), "--mesh_unit", "m", "--video", "v", "--camera", str(camera)]
    return make_parser().parse_args(["track", *words, "--output", str(output), "--resume", *more])


def begun(output: Path, *more: str) -> None:
    """A folder with the first row of a track, and what it was begun with."""
    args = arguments(output, *more)
    write_poses(output / "poses.csv", [PoseRow(0, state="tracking")])
    facts = {**weights_facts(args.weights), "arguments": given(args)}
    write_json(output / "summary.json", facts)


@pytest.mark.parametrize(
    "option",
    ["--texture_from_start", "--allow_untextured", "--float32", "--renderer pyrender"],
)
def test_what_decides_a_track_must_be_the_same(tmp_path: Path, option: str) -> None:
    begun(tmp_path)
    assert len(rows_before(tmp_path, arguments(tmp_path), TrackerConfig())) == 1
    with pytest.raises(InputError, match=f"another {option.split()[0]};"):
        rows_before(tmp_path, arguments(tmp_path, *option.split()), TrackerConfig())


@pytest.mark.parametrize("name", ["mesh", "camera", "start"])
def test_a_file_must_be_the_same_by_what_is_in_it(tmp_path: Path, name: str) -> None:
    start = tmp_path / "s.json"
    start.write_text("as it was")
    killed(tmp_path, "--start", str(start))
    args = arguments(tmp_path, "--start", str(start))
    assert len(rows_before(tmp_path, args, TrackerConfig())) == 1
    moved = {"mesh": args.mesh[0], "camera": args.camera, "start": start}[name]
    moved.rename(tmp_path / f"moved{moved.suffix}")
    elsewhere = tmp_path / f"moved{moved.suffix}"
    setattr(args, name, elsewhere if name == "camera" else [elsewhere])
    assert len(rows_before(tmp_path, args, TrackerConfig())) == 1, "the same at another place"
    elsewhere.write_text("edited in between")
    with pytest.raises(InputError, match=f"holds a track with another --{name};"):
        rows_before(tmp_path, args, TrackerConfig())


def test_a_record_of_before_knows_files_by_their_places(tmp_path: Path) -> None:
    begun(tmp_path)  # its summary holds no digests
    args = arguments(tmp_path)
    args.camera.write_text("edited in between")
    assert len(rows_before(tmp_path, args, TrackerConfig())) == 1
    args.camera = tmp_path / "a.ply"
    with pytest.raises(InputError, match="another --camera;"):
        rows_before(tmp_path, args, TrackerConfig())


def test_a_summary_says_what_is_in_the_files(clip: Clip, capsys: Any) -> None:
    assert clip.track("--no_overlay") == 0
    camera = clip.folder / "camera.json"
    camera.write_text(camera.read_text() + " ")
    assert clip.track("--no_overlay", "--resume") == 2
    assert "holds a track with another --camera;" in capsys.readouterr().err


def killed(output: Path, *more: str, rows: bool = True) -> None:
    """A folder as a track leaves it that is killed, after or before its first row."""
    write_poses(output / "poses.csv", [PoseRow(0, state="tracking")])
    facts = track_facts(arguments(output, *more), TrackerConfig())
    with Journal(output / "poses.csv", facts, resume=False) as journal:
        journal.add({"first": 0})
        kept = journal.path.read_bytes()
    lines = kept.splitlines(keepends=True)
    journal.path.write_bytes(kept if rows else lines[0])


def test_a_killed_track_goes_on_with_its_own_facts_alone(tmp_path: Path) -> None:
    killed(tmp_path, "--float32")
    args = arguments(tmp_path, "--float32")
    assert len(rows_before(tmp_path, args, TrackerConfig())) == 1
    with pytest.raises(InputError, match="another --float32;"):
        rows_before(tmp_path, arguments(tmp_path), TrackerConfig())
    other = replace(TrackerConfig(), low_confidence=0.123)
    with pytest.raises(InputError, match="another --low_confidence;"):
        rows_before(tmp_path, args, other)


def test_rows_of_which_nobody_knows_the_facts_are_refused(tmp_path: Path) -> None:
    killed(tmp_path, rows=False)  # before its first row: that in the table is another track's
    refused = pytest.raises(InputError, match=r"poses\.csv: nothing says which arguments and sett")
    with refused:
        rows_before(tmp_path, arguments(tmp_path), TrackerConfig())
    (tmp_path / "poses.csv.unfinished").unlink()
    config = TrackerConfig().as_dict()
    for foreign in ({}, {"arguments": 3, "config": []}, {"arguments": {}, "config": config}):
        write_json(tmp_path / "summary.json", foreign)
        with refused:
            rows_before(tmp_path, arguments(tmp_path), TrackerConfig())
    (tmp_path / "summary.json").unlink()
    with refused:
        rows_before(tmp_path, arguments(tmp_path), TrackerConfig())
    write_poses(tmp_path / "poses.csv", [])
    assert rows_before(tmp_path, arguments(tmp_path), TrackerConfig()) == [], "there is nothing"


def test_a_report_shows_the_whole_track_and_a_log_stays(
    clip: Clip, interrupt_update: Callable[[int], None], monkeypatch: pytest.MonkeyPatch
) -> None:
    page = clip.folder / "report.html"
    with monkeypatch.context():
        interrupt_update(3)
        assert clip.track("--no_overlay", "--report", str(page)) == 130
    monkeypatch.undo()
    for _ in ("the rest", "nothing is left to do"):
        assert clip.track("--no_overlay", "--report", str(page), "--resume") == 0
        assert "5 frames, 0 without a pose" in page.read_text()
        assert page.read_text().count(' data-rank="') == 5


def test_why_earlier_frames_have_no_pose(tmp_path: Path) -> None:
    begun(tmp_path)
    rows = [
        PoseRow(0, milliseconds=9.0, state="lost"),
        PoseRow(1, state="lost"),
        PoseRow(2, milliseconds=9.0, state="uncertain"),
        PoseRow(3, state="lost"),
        PoseRow(4, milliseconds=9.0, state="lost"),
    ]
    write_poses(tmp_path / "poses.csv", rows)
    args = arguments(tmp_path)
    facts = track_facts(args, TrackerConfig())

    def told() -> list[object]:
        (earlier,) = earlier_tracks(args, facts, [""], [(0.0, 0.0, 0.0)])
        record = track_record(earlier)
        assert record.failed == record.frames == 5 and list(earlier.failures) == [0, 1, 2, 3, 4]
        assert [one["frame"] for one in record.failures] == [0, 1, 2, 3, 4]
        return [one["error"] for one in record.failures]

    lost, unread, absent = "the object is lost.", "the frame cannot be used.", "there is no pose."
    assert told() == [lost, unread, absent, unread, lost], "as nearly as the rows tell"
    said = {"failures": [{"frame": 3, "error": "3.png is damaged."}]}
    write_json(tmp_path / "summary.json", {**read_json(tmp_path / "summary.json"), **said})
    assert told() == [lost, unread, absent, "3.png is damaged.", lost], "as the summary says"
    with Journal(tmp_path / "poses.csv", facts, resume=False) as journal:
        journal.add({"failures": [{"frame": 4, "error": "it is behind the camera."}]})
    assert told()[3:] == ["3.png is damaged.", "it is behind the camera."], "and the journal"
    write_json(tmp_path / "summary.json", {"failures": [4]})
    with pytest.raises(InputError, match="cannot be read"):
        told()


@pytest.fixture
def killed_track(clip: Clip, monkeypatch: pytest.MonkeyPatch) -> Callable[..., None]:
    """Does what a command would do until it is killed: there is a journal and no summary."""

    def until(run: Callable[[], int]) -> None:
        with monkeypatch.context() as patch:
            patch.setattr("moveit6d.cli.journal.Journal.finish", lambda self: None)
            assert run() == 130
        (clip.output / "summary.json").unlink()

    return until


@pytest.mark.parametrize("how", ["interrupted", "killed"])
def test_a_report_says_what_failed_before(
    clip: Clip, interrupt_update: Callable[[int], None], monkeypatch: pytest.MonkeyPatch,
    killed_track: Callable[..., None], how: str,
) -> None:  # fmt: skip
    damage(clip, 1)
    page = clip.folder / "report.html"
    with monkeypatch.context():
        interrupt_update(4)
        if how == "killed":
            killed_track(lambda: clip.track("--no_overlay"))
        else:
            assert clip.track("--no_overlay") == 130
    monkeypatch.undo()
    for _ in ("the rest", "nothing is left to do"):
        assert clip.track("--no_overlay", "--report", str(page), "--resume") == 0
        assert "5 frames, 1 without a pose" in page.read_text()
        assert "000001.png is not a readable image" in page.read_text()


@pytest.mark.parametrize("how", ["interrupted", "killed"])
@pytest.mark.parametrize("there", [True, False])
def test_the_first_frame_is_searched_once(
    clip: Clip, interrupt_update: Callable[[int], None], monkeypatch: pytest.MonkeyPatch,
    killed_track: Callable[..., None], how: str, there: bool,
) -> None:  # fmt: skip
    searched: list[int] = []
    starts: list[Any] = []

    def found(*_: Any) -> Pose | None:
        searched.append(1)
        return clip.true if there else None

    init = PoseTracker.__init__

    def recorded(self: Any, meshes: Any, camera: Any, start: Any, **more: Any) -> None:
        starts.append(start)
        init(self, meshes, camera, [clip.true], **more)

    folder = str(clip.folder)
    command = [
        "track", "--mesh", f"{folder}/mesh.ply", "--mesh_unit", "m", "--video", f"{folder}/frames",
        "--camera", f"{folder}/camera.json", "--output", str(clip.output), "--no_overlay",
        "--box", "50", "40", "40", "40",
    ]  # fmt: skip
    monkeypatch.setattr("moveit6d.estimation.PoseDetector", lambda *_, **__: None)
    monkeypatch.setattr("moveit6d.cli.starting.first_pose", found)
    monkeypatch.setattr(PoseTracker, "__init__", recorded)
    update = PoseTracker.update
    interrupt_update(3)
    if how == "killed":
        killed_track(lambda: main(command))
    else:
        assert main(command) == 130
    monkeypatch.setattr(PoseTracker, "update", update)
    for _ in ("the rest", "nothing is left to do"):
        assert main([*command, "--resume"]) == 0
    assert len(searched) == 1 and len(starts) == 3
    for (start,) in starts:
        assert (start is not None) == there
        assert start is None or torch.equal(start.matrix, clip.true.matrix)


@pytest.mark.filterwarnings("ignore")
def test_a_file_for_rerun_is_not_replaced_by_one_of_later_frames(
    clip: Clip, interrupt_update: Callable[[int], None], monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("rerun")
    log, later = clip.folder / "run.rrd", clip.folder / "run_000002.rrd"
    with monkeypatch.context():
        interrupt_update(3)
        assert clip.track("--no_overlay", "--rerun", str(log)) == 130
    monkeypatch.undo()
    before = log.read_bytes()
    assert clip.track("--no_overlay", "--rerun", str(log), "--resume") == 0
    assert log.read_bytes() == before and later.stat().st_size > 10_000
    assert clip.track("--no_overlay", "--rerun", str(log), "--resume") == 0
    assert [path.name for path in sorted(clip.folder.glob("*.rrd"))] == [log.name, later.name]


def test_weights_are_the_same_by_what_is_in_them(tmp_path: Path) -> None:
    one, two = tmp_path / "one.safetensors", tmp_path / "two.safetensors"
    one.write_bytes(b"weights")
    two.write_bytes(b"weights")
    begun(tmp_path, "--weights", str(one))
    args = arguments(tmp_path, "--weights", str(two))
    assert len(rows_before(tmp_path, args, TrackerConfig())) == 1, "the same under another name"
    one.write_bytes(b"others")
    args = arguments(tmp_path, "--weights", str(one))
    with pytest.raises(InputError, match="another --weights"):
        rows_before(tmp_path, args, TrackerConfig())


def test_a_state_that_nobody_knows_is_one_sentence(tmp_path: Path) -> None:
    begun(tmp_path)
    rows = [PoseRow(0, state="tracking"), PoseRow(1), PoseRow(2, state="gone")]
    write_poses(tmp_path / "poses.csv", rows)
    with pytest.raises(InputError, match=r"poses\.csv, row of frame 2: state must be .* 'gone'"):
        rows_before(tmp_path, arguments(tmp_path), TrackerConfig())
    write_poses(tmp_path / "poses.csv", [replace(row, state="lost") for row in rows])
    assert len(rows_before(tmp_path, arguments(tmp_path), TrackerConfig())) == 3
