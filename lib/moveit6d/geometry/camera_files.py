"""Reads cameras as others write them: ROS camera_info, OpenCV, RealSense, Kalibr; writes our JSON.

Never guesses: a key that it does not know, or two that contradict each other, is an error that
names it. What stands in a file under which name is `camera_keys`'s.
"""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

from ..errors import InputError
from ..io import read_text, write_json
from .camera import Camera, with_possible_picture
from .camera_keys import camera_of

LARGEST = 4_000_000  # bytes; calibrations with all their corners have some hundred thousand
SHORTEST = 0.04  # focal length in widths: a pinhole with 170 degrees, beyond any fisheye
SUFFIXES = (".json", ".yaml", ".yml", ".xml")
YAML_TAG = "tag:yaml.org,2002:"
DECIMAL = re.compile(r"[-+]?[0-9]+$")
FLOATING = re.compile(r"[-+]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][-+]?[0-9]+)?$")


def read_camera_file(path: Path) -> Camera:
    """The camera of a file, whatever of the known forms it has; see `Camera.load`.

    `InputError` names the file and what in it cannot be used.
    """
    text = _text(path)
    start = text.lstrip()[:1]
    if path.suffix.lower() == ".xml" or start == "<":
        content = _xml(text, path)
    elif path.suffix.lower() == ".json" or start == "{":
        content = _json(text, path)
    else:
        content = _yaml(text, path)
    if not isinstance(content, Mapping):
        kind = "JSON object in braces, " if path.suffix.lower() == ".json" else ""
        raise InputError(
            f"{path} holds no camera: {kind}named values such as fx, fy, cx, cy, width and "
            "height, or camera_matrix, image_width and image_height, are needed."
        )
    try:
        camera = with_possible_picture(camera_of(content))
    except InputError as error:
        raise InputError(f"{path}: {error}") from None
    if max(camera.fx, camera.fy) < SHORTEST * max(camera.width, camera.height):
        raise InputError(
            f"{path}: a focal length of {camera.fx:g} pixels cannot be right for a picture of "
            f"{camera.width}×{camera.height}; shares of the picture's size must be multiplied by "
            "its width and height, millimetres converted to pixels."
        )
    return camera


def write_camera_file(path: Path, camera: Camera) -> None:
    """Write our JSON, which `read_camera_file` reads back exactly."""
    write_json(path, camera_content(camera))


def camera_content(camera: Camera) -> dict[str, Any]:
    """What our JSON holds of a camera."""
    content: dict[str, Any] = {
        key: getattr(camera, key) for key in ("fx", "fy", "cx", "cy", "width", "height")
    }
    if camera.distortion is not None:
        content["distortion"] = list(camera.distortion)
    if camera.distortion_model != "opencv":
        content["distortion_model"] = camera.distortion_model
    if camera.skew:
        content["skew"] = camera.skew
    return content


def _text(path: Path) -> str:
    if path.is_file() and (size := path.stat().st_size) > LARGEST:
        raise InputError(f"{path} is too large for a camera file ({size} bytes).")
    return read_text(path)


def _json(text: str, path: Path) -> Any:
    try:
        return json.loads(text)
    except (ValueError, RecursionError) as error:
        raise InputError(f"{path} is not a JSON file: {_short(error)}.") from None


def _yaml(text: str, path: Path) -> Any:
    """The first document: ROS' echo ends each message with a line of dashes."""
    import yaml

    # OpenCV writes %YAML:1.0 where YAML wants a blank, and its matrices with a tag of their own.
    lines = [line for line in text.splitlines() if not line.startswith("%YAML")]
    try:
        documents = yaml.load_all("\n".join(lines), _loader())
        return next((content for content in documents if content is not None), None)
    except (yaml.YAMLError, ValueError, OverflowError, RecursionError) as error:
        raise InputError(f"{path} is not a YAML file: {_short(error)}.") from None


def _loader() -> Any:
    """PyYAML's safe loader with OpenCV's matrices and numbers as YAML 1.2 has them.

    Without aliases, which can grow at will.
    """
    import yaml

    class Loader(yaml.SafeLoader):  # type: ignore[misc]
        def compose_node(self, parent: Any, index: Any) -> Any:
            if self.check_event(yaml.events.AliasEvent):
                raise yaml.YAMLError("a camera file needs no aliases")
            return super().compose_node(parent, index)

    def matrix(loader: Any, _: str, node: Any) -> Any:
        return loader.construct_mapping(node, deep=True)

    for prefix in (YAML_TAG, "!"):  # arrays of one dimension have a tag of their own
        Loader.add_multi_constructor(prefix + "opencv-", matrix)
    # In YAML 1.1, which PyYAML reads, 1e-4 and -.2 are words and 0640 is 416.
    whole = YAML_TAG + "int"
    Loader.yaml_implicit_resolvers = {
        first: [(tag, form) for tag, form in forms if tag != whole]
        for first, forms in yaml.SafeLoader.yaml_implicit_resolvers.items()
    }
    Loader.add_implicit_resolver(whole, DECIMAL, list("-+0123456789"))
    Loader.add_implicit_resolver(YAML_TAG + "float", FLOATING, list("-+.0123456789"))
    Loader.add_constructor(whole, lambda loader, node: int(loader.construct_scalar(node)))
    return Loader


def _xml(text: str, path: Path) -> Any:
    """OpenCV's XML as the mapping that its YAML would be."""
    if "<!DOCTYPE" in text or "<!ENTITY" in text:
        raise InputError(f"{path}: a camera file needs no DOCTYPE.")
    try:
        root = ElementTree.fromstring(text)
    except (ElementTree.ParseError, ValueError, RecursionError) as error:
        raise InputError(f"{path} is not an XML file: {_short(error)}.") from None
    if root.tag != "opencv_storage":
        raise InputError(
            f"{path}: an XML file of OpenCV begins with opencv_storage, found {root.tag:.40}."
        )
    return {node.tag: _value(node) for node in root}


def _value(node: ElementTree.Element) -> Any:
    if len(node):
        return {child.tag: _value(child) for child in node}
    words = (node.text or "").split()
    numbers = [_number(word) for word in words]
    if not words or any(isinstance(number, str) for number in numbers):
        return (node.text or "").strip().strip('"')
    return numbers if len(numbers) > 1 or node.tag == "data" else numbers[0]


def _number(word: str) -> float | str:
    try:
        return float(word)
    except ValueError:
        return word


def _short(error: BaseException) -> str:
    """One line of a parser's message."""
    return " ".join(str(error).split())[:160].rstrip(".")
