"""What a folder of sequences is, in words that a report may print.

Never calls a surrogate by the real set's name alone: only a folder that has what the published set
has is called published.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from pathlib import Path

from ...datasets import catalog, laval, ycbv
from ...datasets.sequences import Sequence as Video
from ...errors import InputError

# Keyframes of the published test set by scene: yuxng/YCB_Video_toolbox, keyframe.txt.
YCBV_KEYFRAMES = {
    48: 394, 49: 227, 50: 190, 51: 181, 52: 167, 53: 179,
    54: 318, 55: 242, 56: 189, 57: 288, 58: 214, 59: 360,
}  # fmt: skip
SETS = {"ycbv": "YCB-Video", "laval": "Laval"}


def describe(folder: Path, kind: str) -> str:
    """The words for a folder of that kind, without its place on this machine."""
    name = folder.resolve().name
    said = catalog.surrogate(folder)
    if said:
        return f"{said if 'surrogate' in said else f'surrogate ({said})'}, folder {name}"
    real = SETS.get(kind)
    if real is None:
        return f"surrogate (sequence folders of one's own), folder {name}"
    if is_published(folder, kind):
        return f"{real} as published, folder {name}"
    return f"surrogate (in {real}'s format, not recognised as the published set), folder {name}"


def is_published(folder: Path, kind: str) -> bool:
    """Whether a folder has what the published set has, and nothing says that it was made."""
    if catalog.surrogate(folder):
        return False
    if kind == "ycbv":
        counts = {scene: len(images) for scene, images in ycbv.read_keyframes(folder).items()}
        models = [(folder / "models" / name / "points.xyz").is_file() for name in ycbv.OBJECTS]
        return counts == YCBV_KEYFRAMES and all(models)
    if kind == "laval":
        there = [(folder / f"{item}_occlusion_0" / "poses.npy").is_file() for item in laval.OBJECTS]
        return all(there)
    return False


def choose(videos: Sequence[Video], only: Collection[str] | None) -> list[Video]:
    """The sequences of those names (or of objects of those names); all without names."""
    if not only:
        return list(videos)
    unknown = set(only) - {v.name for v in videos} - {v.object for v in videos}
    if unknown:
        names = ", ".join(video.name for video in videos[:20])
        raise InputError(f"There is no sequence {', '.join(sorted(unknown))}; there are {names}.")
    return [video for video in videos if video.name in only or video.object in only]
