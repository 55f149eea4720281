"""What the values of a camera file are called by those who write them, and what they mean.

Never opens a file. Names are compared without case, blanks, dashes and underscores.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from difflib import get_close_matches
from typing import Any

import numpy as np

from ..checks import number
from ..errors import InputError
from .camera import Camera
from .lens import COUNTS, DistortionModel

# Each value and the names it goes by: ours first, then ROS', OpenCV's, RealSense's, Kalibr's,
# M3T's, nerfstudio's and Laval's.
NAMES: dict[str, tuple[str, ...]] = {
    "fx": ("fx", "f_x", "focal_x", "focal_length_x", "fl_x", "f_u", "alpha_x"),
    "fy": ("fy", "f_y", "focal_y", "focal_length_y", "fl_y", "f_v", "alpha_y"),
    "cx": ("cx", "c_x", "ppx", "pp_x", "principal_point_x", "u0", "center_x", "centre_x"),
    "cy": ("cy", "c_y", "ppy", "pp_y", "principal_point_y", "v0", "center_y", "centre_y"),
    "skew": ("skew", "axis_skew"),
    "width": ("width", "image_width", "img_width", "w", "calib_image_width"),
    "height": ("height", "image_height", "img_height", "h", "calib_image_height"),
    "size": (
        "resolution", "image_size", "img_size", "imsize", "image_resolution", "camera_resolution",
    ),
    "matrix": (
        "camera_matrix", "K", "intrinsic_matrix", "intrinsics", "intrinsic", "cam_K", "mtx",
        "camera_intrinsics", "K_matrix", "cam_matrix",
    ),
    "distortion": (
        "distortion", "distortion_coefficients", "distortion_coeffs", "dist_coeffs", "D", "coeffs",
        "dist", "dist_coefs", "distortion_parameters", "distortion_params", "distortion_coefs",
    ),
    "model": ("distortion_model", "model", "distortion_type"),
    "camera_model": ("camera_model",),
    "fisheye": ("fisheye", "fisheye_model", "is_fisheye"),
}  # fmt: skip
OPENCV = ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6", "s1", "s2", "s3", "s4", "tau_x", "tau_y")
# What such files hold besides, and what does not change where a point lands in the raw image.
BESIDES = (
    "header", "camera_name", "name", "camera", "serial_number", "serial", "frame_id", "stamp",
    "rectification_matrix", "projection_matrix", "R", "P", "comment", "comments", "description",
    "depth_scale", "depth_units", "cam_overlaps", "rostopic", "timeshift_cam_imu", "T_cam_imu",
    "T_cn_cnm1", "T_imu_cam", "calibration_time", "calibration_date", "date", "nr_of_frames",
    "nframes", "frames_count", "camera_matrix_std_dev", "dist_coeffs_std_dev",
    "distortion_coefficients_std_dev", "cam_R_w2c", "cam_t_w2c",
    "frame_count", "board_width", "board_height", "square_size", "marker_size", "aspect_ratio",
    "fix_aspect_ratio", "flags", "calibration_flags", "avg_reprojection_error", "rms", "rms_error",
    "reprojection_error", "per_view_reprojection_errors", "extrinsic_parameters", "image_points",
    "grid_points", "view_reprojection_error", "error", "images", "fov_degrees", "version",
)  # fmt: skip
NONE = ("", "none", "no", "no_distortion", "pinhole", "perspective", "ideal")
MODELS: dict[str, DistortionModel] = {
    "plumb_bob": "opencv", "rational_polynomial": "opencv", "radtan": "opencv", "opencv": "opencv",
    "brown_conrady": "opencv", "full_opencv": "opencv", "radial_tangential": "opencv",
    "thin_prism": "opencv", "polynomial": "opencv", "rational": "opencv",
    "fisheye": "fisheye", "equidistant": "fisheye", "equi": "fisheye", "kannala_brandt": "fisheye",
    "kannala_brandt4": "fisheye", "opencv_fisheye": "fisheye", "kb4": "fisheye",
}  # fmt: skip
# Librealsense's variants of Brown's model are not OpenCV's unless all coefficients are zero.
VARIANTS = ("inverse_brown_conrady", "modified_brown_conrady")


def camera_of(content: Mapping[str, Any]) -> Camera:
    """The camera of a file's named values; `InputError` names the value that cannot be used."""
    content = _unwrapped(content)
    if not any(_plain(name) in _MEANINGS for name in content):
        _complete({})  # another file's: nothing in it is a camera's
    found = _sorted_out(content)
    _complete(found)
    width, height = _size(found)
    k = _matrix(found)
    if "size" in found:
        _check_width_first(width, height, k)
    model = _model(found)
    distortion, fisheye = _distortion(found, model)
    return Camera(
        k[0][0], k[1][1], k[0][2], k[1][2], width, height,
        tuple(distortion) if distortion else None, "fisheye" if fisheye else "opencv", k[0][1],
    )  # fmt: skip


def _plain(name: str) -> str:
    return re.sub(r"[\s_\-.]", "", str(name)).lower()


_MEANINGS = {_plain(name): value for value, names in NAMES.items() for name in names}
_MEANINGS |= {_plain(name): name for name in OPENCV}
_SPELLINGS = {_plain(name): name for names in NAMES.values() for name in names}
_SPELLINGS |= {_plain(name): name for name in OPENCV}
_BESIDES = {_plain(name) for name in BESIDES}
_WINDOW = {"binningx", "binningy", "roi"}


def _unwrapped(content: Mapping[str, Any]) -> Mapping[str, Any]:
    """The camera itself where a file holds it under a name: Kalibr's cam0, a lone camera_info."""
    inner = {
        name: value
        for name, value in content.items()
        if isinstance(value, Mapping) and _plain(name) not in _MEANINGS.keys() | _WINDOW
    }
    cameras = [name for name, value in inner.items() if any(_plain(k) in _MEANINGS for k in value)]
    own = any(_plain(name) in _MEANINGS for name in content)
    if own or not cameras:
        return content
    chosen: Mapping[str, Any] = inner[cameras[0]]
    sized = any(_MEANINGS.get(_plain(name)) in ("width", "height", "size") for name in chosen)
    if not sized and all("cam_K" in inner[name] for name in cameras):
        raise InputError(
            f"the file is BOP's scene_camera.json ({_first(cameras)}), which lacks the images' "
            "size; give the data set's camera.json, or a file with one of its entries and width "
            "and height."
        )
    if len(cameras) > 1:
        raise InputError(
            f"the file holds {len(cameras)} cameras ({_first(cameras)}); leave the one that took "
            "the images in a file of its own."
        )
    return chosen


def _first(names: Sequence[Any], most: int = 5) -> str:
    """The first few names, each cut where it is long."""
    shown = [f"{name!s:.40}" for name in names[:most]]
    return ", ".join(shown + ["…"] * (len(names) > most))


def _sorted_out(content: Mapping[str, Any]) -> dict[str, Any]:
    """The values by our names; `InputError` for an unknown key, and for one thing said twice."""
    found: dict[str, Any] = {}
    for name, value in content.items():
        plain = _plain(name)
        if plain in _WINDOW:
            _whole_image(str(name), value)
            continue
        if plain in _BESIDES:
            continue
        meaning = _MEANINGS.get(plain)
        if meaning is None:
            raise InputError(_unknown(str(name)))
        if value is None:
            continue
        if meaning == "matrix" and isinstance(value, Mapping) and "data" not in value:
            found |= _sorted_out(value)  # M3T's intrinsics: {f_u: …}
            continue
        if meaning in found and found[meaning] != value:
            raise InputError(f"{name} says again, and differently, what another key says.")
        found[meaning] = value
    return found


def _unknown(name: str) -> str:
    near = get_close_matches(_plain(name), list(_SPELLINGS), 1, 0.6)
    if near:
        return f"unknown key {name!r}; did you mean {_SPELLINGS[near[0]]!r}?"
    return (
        f"unknown key {name!r}; a camera has fx, fy, cx, cy (or camera_matrix), width, height and, "
        "if its lens distorts, distortion and distortion_model."
    )


def _whole_image(name: str, value: Any) -> None:
    """ROS' binning and region: the intrinsics must be those of the images as they come."""
    values = value if isinstance(value, Mapping) else {name: value}
    offsets = [values.get(key, 0) for key in ("x_offset", "y_offset")]
    binned = not isinstance(value, Mapping) and value not in (0, 1, None)
    if binned or any(offset not in (0, None) for offset in offsets):
        raise InputError(
            f"{name} is {value}: the images are not what the intrinsics are of; give those of the "
            "images as they come (Camera.crop and Camera.resize convert them)."
        )


def _complete(found: Mapping[str, Any]) -> None:
    """`InputError` naming all that is missing at once."""
    size = () if "size" in found else ("width", "height")
    focal = () if "matrix" in found else ("fx", "fy", "cx", "cy")
    missing = [name for name in (*focal, *size) if name not in found]
    if missing:
        raise InputError(
            f"{', '.join(missing)} missing; a camera needs fx, fy, cx, cy (pixels) or "
            "camera_matrix, and width and height."
        )


def _size(found: Mapping[str, Any]) -> tuple[Any, Any]:
    """Width and height."""
    pair = _numbers(found["size"], "the image size") if "size" in found else [None, None]
    if len(pair) != 2:
        raise InputError("the image size must be two numbers, width and height.")
    sizes = []
    for name, listed in zip(("width", "height"), pair, strict=True):
        size = _one(found.get(name, listed), name)
        if listed is not None and size != listed:
            raise InputError(f"{name} is {size:g} in one place and {listed:g} in another.")
        sizes.append(size)
    return sizes[0], sizes[1]


def _check_width_first(width: float, height: float, k: list[list[float]]) -> None:
    """`InputError` for a pair of sizes that the principal point shows to be height and width."""
    cx, cy = k[0][2], k[1][2]
    turned = abs(cx - (height - 1) / 2) + abs(cy - (width - 1) / 2)  # from the other middle
    if turned < abs(width - height) / 4:
        raise InputError(
            f"the image size {width:g}, {height:g} is read as width and height, but the principal "
            f"point {cx:g}, {cy:g} is the middle of {height:g}×{width:g}; if the height comes "
            f'first, as in MegaPose\'s files, give "width": {height:g}, "height": {width:g} '
            "instead."
        )


def _matrix(found: Mapping[str, Any]) -> list[list[float]]:
    """K from a matrix, from four numbers as Kalibr has them, or from fx, fy, cx and cy."""
    own = {name: _one(found[name], name) for name in ("fx", "fy", "cx", "cy") if name in found}
    skew = _one(found.get("skew", 0.0), "skew")
    if "matrix" not in found:
        return [[own["fx"], skew, own["cx"]], [0.0, own["fy"], own["cy"]], [0.0, 0.0, 1.0]]
    value = found["matrix"]
    k = _three_by_three(_numbers(value, "the intrinsic matrix"))
    listed = {"fx": k[0][0], "fy": k[1][1], "cx": k[0][2], "cy": k[1][2], "skew": k[0][1]}
    for name, stated in {**own, **({"skew": skew} if "skew" in found else {})}.items():
        if not math.isclose(stated, listed[name], rel_tol=1e-6, abs_tol=1e-6):
            raise InputError(f"{name} is {stated:g}, but {listed[name]:g} in the matrix.")
    return k


def _three_by_three(numbers: list[float]) -> list[list[float]]:
    if len(numbers) == 4:
        fx, fy, cx, cy = numbers
        return [[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]]
    if len(numbers) != 9:
        raise InputError(
            f"the intrinsic matrix must have 9 numbers (or fx, fy, cx, cy), found {len(numbers)}."
        )
    k = [numbers[0:3], numbers[3:6], numbers[6:9]]
    if k[2] != [0.0, 0.0, 1.0] and [row[2] for row in k] == [0.0, 0.0, 1.0]:
        k = [list(column) for column in zip(*k, strict=True)]  # Open3D lists columns
    if k[1][0] or k[2] != [0.0, 0.0, 1.0]:
        raise InputError(
            f"the intrinsic matrix has the rows (fx, skew, cx), (0, fy, cy), (0, 0, 1), found {k}."
        )
    return k


def _model(found: Mapping[str, Any]) -> str | None:
    """The distortion model's name in our spelling; None where the file names none."""
    camera = found.get("camera_model")
    if camera is not None and _underscored(camera) not in (*NONE, *MODELS):
        raise InputError(
            f"camera_model {camera!r} is not known; pinhole cameras with a radtan or equidistant "
            "lens are."
        )
    named = found.get("model", camera)
    flag = found.get("fisheye")
    if flag is not None and flag not in (0, 1):
        raise InputError(f"fisheye must be true or false, found {flag!r}.")
    if named is None:
        return None if flag is None else ("fisheye" if flag else "opencv")
    name = _underscored(named)
    if name in NONE and flag:
        return "fisheye"
    if flag is not None and name in MODELS and (MODELS[name] == "fisheye") != bool(flag):
        raise InputError(f"the file says fisheye {flag!r} and distortion model {named!r}.")
    return name


def _underscored(name: Any) -> str:
    """`Brown Conrady` and `distortion.brown_conrady` as brown_conrady."""
    last = str(name).strip().rpartition(".")[2].lower()
    return re.sub(r"[\s\-]+", "_", last)


def _distortion(found: Mapping[str, Any], model: str | None) -> tuple[list[float] | None, bool]:
    """The coefficients in OpenCV's order, None if there are none; and whether it is a fisheye."""
    single = {name: _one(found[name], name) for name in OPENCV if name in found}
    listed = _numbers(found["distortion"], "distortion") if "distortion" in found else []
    if single and listed:
        raise InputError(f"{next(iter(single))} and distortion say the same thing; keep one.")
    none = model is not None and (model in NONE or model in VARIANTS)
    if none and not any(listed) and not any(single.values()):
        return None, False
    if model is not None and not (model in MODELS or (model in NONE and (listed or single))):
        detail = "" if model not in VARIANTS else " (librealsense's own, unless it is all zeros)"
        raise InputError(
            f"distortion model {model!r}{detail} is not known; plumb_bob, rational_polynomial, "
            "radtan, brown_conrady and equidistant, fisheye, kannala_brandt are. "
            "`moveit6d calibrate` makes such a camera file."
        )
    fisheye = model is not None and MODELS.get(model) == "fisheye"
    if single:
        listed = _in_order(single, model, fisheye)
    if fisheye and len(listed) > 4 and not any(listed[4:]):
        listed = listed[:4]  # RealSense's lists always have five
    if fisheye and len(listed) != 4:
        raise InputError(f"the {model} lens has 4 coefficients, k1 to k4; found {len(listed)}.")
    if listed and not fisheye and len(listed) not in COUNTS["opencv"]:
        raise InputError(
            "distortion must be OpenCV's 4, 5, 8, 12 or 14 coefficients (k1, k2, p1, p2[, k3[, k4, "
            f"k5, k6, …]]), found {len(listed)}; fill up with zeros what the lens lacks."
        )
    return listed or None, fisheye


def _in_order(single: Mapping[str, float], model: str | None, fisheye: bool) -> list[float]:
    """A list from k1, k2, … given one by one; missing ones are zero."""
    if fisheye:
        foreign = [name for name in single if name not in ("k1", "k2", "k3", "k4")]
        if any(single[name] for name in foreign):
            raise InputError(f"the {model} lens has k1, k2, k3, k4 and no {foreign[0]}.")
        return [single.get(name, 0.0) for name in ("k1", "k2", "k3", "k4")]
    if model is None and "k4" in single and "p1" not in single:
        raise InputError(
            "k1 to k4 without p1 and p2 may be a fisheye or not: add distortion_model, equidistant "
            "or rational_polynomial."
        )
    last = max(OPENCV.index(name) for name in single)
    count = next(count for count in COUNTS["opencv"] if count > last)
    return [single.get(name, 0.0) for name in OPENCV[:count]]


def _numbers(value: Any, what: str) -> list[float]:
    """A flat list of numbers from nested lists, or from OpenCV's and ROS' {rows, cols, data}."""
    if isinstance(value, Mapping):
        if "data" not in value:
            raise InputError(f"{what} has no data, only {', '.join(map(str, value))}.")
        numbers = _numbers(value["data"], what)
        sides = [value[name] for name in ("rows", "cols") if value.get(name) is not None]
        sides = _numbers(sides if len(sides) == 2 else value.get("sizes", []), "the matrix's size")
        if sides and math.prod(sides) != len(numbers):
            raise InputError(
                f"{what} has {len(numbers)} numbers, its size says "
                f"{' × '.join(f'{side:g}' for side in sides)}."
            )
        return numbers
    if isinstance(value, Sequence) and not isinstance(value, str | bytes):
        if len(value) > 64:
            raise InputError(f"{what} has {len(value)} entries.")
        return [
            number
            for entry in value
            for number in (
                _numbers(entry, what)
                if isinstance(entry, Sequence) and not isinstance(entry, str)
                else [_one(entry, what)]
            )
        ]
    if isinstance(value, np.ndarray):
        return [float(number) for number in value.reshape(-1)]
    return [_one(value, what)]


def _one(value: Any, name: str) -> float:
    if isinstance(value, Sequence) and not isinstance(value, str | bytes) and len(value) == 1:
        value = value[0]
    return number(value, name)
