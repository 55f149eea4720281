"""How often and how strongly the observed crop of a training pair is disturbed.

Never computes anything. One frozen dataclass a transform; sizes are pixels of the 128 × 128 crop,
probabilities are those of a crop of the batch, ranges are drawn from uniformly.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

from ...typing import Range


@dataclass(frozen=True)
class OcclusionConfig:
    """Occluders in front of the object: other objects and cut-outs of photos.

    Args:
        probability: of any occluder.
        max_occluders: each number from 1 to this one is equally likely.
        scale: of an occluder, relative to its own size in its crop.
        random_rotation: whether occluders are rotated in the image plane.
        photo_probability: of an occluder to be cut from a photo instead of being an object.
    """

    probability: float = 0.55
    max_occluders: int = 3
    scale: Range = (0.2, 1.1)
    random_rotation: bool = True
    photo_probability: float = 0.45


@dataclass(frozen=True)
class VisibleWindowConfig:
    """Only a rectangle shows the object and its occluders; outside of it the background does.

    Args:
        probability: of such a rectangle.
        size: its height and its width, drawn apart.
    """

    probability: float = 0.0
    size: Range = (72.0, 96.0)


@dataclass(frozen=True)
class CalibrationBoardConfig:
    """A board of dark and light squares in the background.

    Args:
        probability: of a board.
    """

    probability: float = 0.0


@dataclass(frozen=True)
class ClutterConfig:
    """Other objects of the batch in the background.

    Args:
        probability: of any.
        max_objects: each number from 1 to this one is equally likely.
        same_object_probability: of the first of them to be the object itself once more, which has
            the same colours.
    """

    probability: float = 0.4
    max_objects: int = 1
    same_object_probability: float = 0.3


@dataclass(frozen=True)
class GaussianBlurConfig:
    """Gaussian blur, as of what is out of focus.

    Args:
        probability: of the blur.
        sigma: its standard deviation.
    """

    probability: float = 0.0
    sigma: Range = (0.5, 3.5)


@dataclass(frozen=True)
class CastShadowConfig:
    """The soft, straight edge of a shadow across the crop.

    Args:
        probability: of a shadow.
        brightness: what the shadow leaves of the light.
    """

    probability: float = 0.3
    brightness: Range = (0.35, 0.8)


@dataclass(frozen=True)
class MotionBlurConfig:
    """Linear motion blur of a blurred crop.

    Args:
        probability: of motion, where the crop is blurred at all.
        length: of the blur.
        length_sigma: above 0 lengths are |N(0, σ)| crop widths instead.
    """

    probability: float = 0.4
    length: Range = (0.0, 16.0)
    length_sigma: float = 0.0


@dataclass(frozen=True)
class BlurConfig:
    """Defocus, and motion blur in a part of the blurred crops.

    Args:
        probability: of any blur.
        sigma: standard deviation of the defocus.
        motion: motion blur on top of it.
    """

    probability: float = 0.4
    sigma: Range = (0.2, 1.4)
    motion: MotionBlurConfig = field(default_factory=MotionBlurConfig)


@dataclass(frozen=True)
class ObjectMotionConfig:
    """Linear motion blur of the object alone, which moves in front of what stands still.

    Args:
        probability: of such a motion.
        length: of the blur.
    """

    probability: float = 0.0
    length: Range = (0.0, 16.0)


@dataclass(frozen=True)
class RadialBlurConfig:
    """Radial (zoom) blur about the middle of the crop.

    Args:
        probability: of the blur.
        zoom_sigma: standard deviation of the zoom during the exposure.
    """

    probability: float = 0.0
    zoom_sigma: float = 0.05


@dataclass(frozen=True)
class LensErrorConfig:
    """A lens that is not quite the calibrated one.

    Args:
        probability: of an error.
        displacement: of the pixel that is displaced most.
    """

    probability: float = 0.0
    displacement: Range = (0.3, 1.5)


@dataclass(frozen=True)
class SharpeningConfig:
    """Unsharp masking, as many cameras do it.

    Args:
        probability: of sharpening.
        amount: how much of the lost detail is added.
    """

    probability: float = 0.15
    amount: Range = (0.3, 1.5)


@dataclass(frozen=True)
class DownsamplingConfig:
    """A lower resolution.

    Args:
        probability: of a lower resolution, of a quarter of the batch at once.
        scale: of the crop's own; at 0.3 an object is 27 pixels wide.
    """

    probability: float = 0.4
    scale: Range = (0.3, 0.95)


@dataclass(frozen=True)
class JpegConfig:
    """JPEG compression.

    Args:
        probability: of compression, of a quarter of the batch at once.
        quality: from 1 to 100.
    """

    probability: float = 0.35
    quality: Range = (35.0, 92.0)


@dataclass(frozen=True)
class ColourJitterConfig:
    """Exposure, contrast, saturation and white balance.

    Args:
        brightness: factor of all channels.
        contrast: factor of the difference from the mean.
        saturation: factor of the difference from grey.
        channel_gain: largest relative change of a single channel.
    """

    brightness: Range = (0.7, 1.3)
    contrast: Range = (0.75, 1.3)
    saturation: Range = (0.5, 1.35)
    channel_gain: float = 0.1


@dataclass(frozen=True)
class NoiseConfig:
    """Gaussian sensor noise.

    Args:
        sigma: standard deviation, of full white.
    """

    sigma: Range = (0.0, 0.025)


@dataclass(frozen=True)
class ImageBorderConfig:
    """Crops that reach beyond the image: a black side.

    Args:
        probability: of a black side.
    """

    probability: float = 0.1


@dataclass(frozen=True)
class AugmentConfig:
    """All that disturbs the observed crop.

    The shipped model was trained with those of configs/pairs/linear_light.yaml; the paper's
    numbers, each with its place in the paper, stand in configs/pairs/paper.yaml.

    Args:
        blur_and_colour_of: the whole image, as a camera does it, or, as in the paper, the object
            and each occluder (layers) before they are put in front of the photo.
        gamma: colour = light ** (1 / gamma). Edges and blurs mix light; at 1 they mix colours.
        occlusion: occluders in front.
        visible_window: a rectangle outside of which the object is hidden.
        calibration_board: a board in the background.
        clutter: other objects in the background.
        background_blur: backgrounds that are out of focus.
        cast_shadow: the edge of a shadow.
        blur: defocus and motion blur.
        object_motion: motion blur of the object alone.
        radial_blur: zoom blur.
        lens_error: lens and intrinsics that differ from the calibrated ones.
        downsampling: a lower resolution.
        jpeg: compression.
        sharpening: unsharp masking.
        colour: exposure, contrast, saturation, white balance.
        noise: of the sensor.
        image_border: sides beyond the image.
    """

    blur_and_colour_of: Literal["image", "layers"] = "image"
    gamma: Range = (1.0, 1.0)
    occlusion: OcclusionConfig = field(default_factory=OcclusionConfig)
    visible_window: VisibleWindowConfig = field(default_factory=VisibleWindowConfig)
    calibration_board: CalibrationBoardConfig = field(default_factory=CalibrationBoardConfig)
    clutter: ClutterConfig = field(default_factory=ClutterConfig)
    background_blur: GaussianBlurConfig = field(default_factory=GaussianBlurConfig)
    cast_shadow: CastShadowConfig = field(default_factory=CastShadowConfig)
    blur: BlurConfig = field(default_factory=BlurConfig)
    object_motion: ObjectMotionConfig = field(default_factory=ObjectMotionConfig)
    radial_blur: RadialBlurConfig = field(default_factory=RadialBlurConfig)
    lens_error: LensErrorConfig = field(default_factory=LensErrorConfig)
    downsampling: DownsamplingConfig = field(default_factory=DownsamplingConfig)
    jpeg: JpegConfig = field(default_factory=JpegConfig)
    sharpening: SharpeningConfig = field(default_factory=SharpeningConfig)
    colour: ColourJitterConfig = field(default_factory=ColourJitterConfig)
    noise: NoiseConfig = field(default_factory=NoiseConfig)
    image_border: ImageBorderConfig = field(default_factory=ImageBorderConfig)
