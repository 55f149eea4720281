"""Candidates of one object in one image: places that look like it, and the views there.

Never refines a pose and never decides whether an object is there.
"""

from __future__ import annotations

from collections.abc import Generator, Sequence

from ...config import DetectorConfig
from ...geometry.camera import Camera
from ...geometry.mesh import Mesh
from .places import HALVES, Place, PlaceFinder
from .pyramid import Pyramid, ladder
from .region import SearchRegion
from .templates import TemplateBank
from .views import Allowed, Candidates, ViewMatcher, best_candidates

Steps = Generator[None, None, Candidates]


class Proposals:
    """What may be the object, by templates; in short steps, as `PoseDetector.steps`.

    `camera` took the image; `region` and `pyramid` are those of the image without its lens.
    """

    def __init__(
        self,
        mesh: Mesh,
        camera: Camera,
        bank: TemplateBank,
        pyramid: Pyramid,
        region: SearchRegion,
        config: DetectorConfig,
    ) -> None:
        self.mesh, self.camera, self.bank, self.pyramid = mesh, camera.full_pinhole, bank, pyramid
        self.region, self.config = region, config
        # Widths are shares of the image as it was taken, which may be smaller.
        taken = min(camera.width, camera.height)
        self._share = taken / min(self.camera.width, self.camera.height)
        self._finder = PlaceFinder(bank.coarse, config.match, config.templates.colour)
        self._known: list[Place] = []
        self._matcher: ViewMatcher | None = None

    def first(self, count: int) -> Steps:
        """The best `count` at the places where the object stands out most."""
        yield from self._add_levels()
        self._known = self._finder.places(self.config.match.places)
        yield
        return (yield from self._candidates(self._known, count))

    def half_occluded(self, count: int) -> Steps:
        """The best `count` at other places, where a half of the object stands out; after `first`.

        The other half may be hidden.
        """
        first = self._finder
        halves = PlaceFinder(first.templates, first.config, first.colour, HALVES)
        for level in first.usual:
            halves.add(level, background_only=True)
        for level in first.levels:
            halves.add(level)
            yield
        places = halves.places(self.config.match.more_places, self._known)
        return (yield from self._candidates(places, count))

    def _add_levels(self) -> Generator[None, None, None]:
        finder, config, narrowing = self._finder, self.config.match, self.config.region
        shares = config.widths[0] * self._share, config.widths[1] * self._share
        low, high = self.region.widths(self.mesh, self.camera, shares, narrowing)
        window = self.region.window(self.mesh, self.camera, high, narrowing)
        if window is not None:
            finest = self.config.templates.coarse_width / narrowing.background_scale
            background = max(0.5 * (low + high), finest)
            finder.add(self.pyramid.level(background), background_only=True)
            yield
        for width in ladder(low, high, config.step):
            finder.add(self.pyramid.level(width, window))
            yield

    def _candidates(self, places: Sequence[Place], count: int) -> Steps:
        """The best `count` of the views at places."""
        if self._matcher is None:
            self._matcher = ViewMatcher(self.bank.fine, self.pyramid, self.config.match)
        allowed, views = self._allowed(), []
        for place in places:
            yield
            views.append(self._matcher.views(place, allowed))
        return best_candidates(views, count)

    def _allowed(self) -> Allowed | None:
        """Which candidates agree with what is known; None: all."""
        if self.region.empty:
            return None
        config, boxes = self.config, self.bank.fine.boxes
        return lambda pixels, widths, views: self.region.allows(
            self.mesh, self.camera, pixels, widths, boxes[views], config.region,
            config.same_instance,
        )  # fmt: skip
