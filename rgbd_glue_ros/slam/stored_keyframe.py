"""A keyframe as a map stores it: small, and made whole again where it is compared."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

from rgbd_glue_ros.refinement.model import Model, model_of
from rgbd_glue_ros.registration.frame_features import FrameFeatures
from rgbd_glue_ros.slam.map_keyframe import MapKeyframe
from rgbd_glue_ros.slam.packed_view import PackedView, packed
from rgbd_glue_ros.types import Float64, View

# Keyframes in a row are compared with the same few earlier ones.
_MOST_WHOLE = 8


@dataclass(frozen=True, eq=False)
class StoredKeyframe:
    """A keyframe whose images are compressed.

    Attributes:
        row: in the pose graph.
        stamp_ns: of the frame.
        T_odom_camera: float64 [4, 4], as the odometry published it.
        view: of the frame.
        features: of the frame, without the images of its view.
        model: gives its planes and pixels from its view.
    """

    row: int
    stamp_ns: int
    T_odom_camera: Float64
    view: PackedView
    features: FrameFeatures
    model: Callable[[View], Model]

    @staticmethod
    def with_model(keyframe: MapKeyframe) -> StoredKeyframe:
        """A keyframe of the odometry, whose model is more than what its view shows."""
        model = keyframe.model
        return _stored(keyframe, packed(keyframe.features.view), lambda _: model)

    @staticmethod
    def of_view(keyframe: MapKeyframe, view: PackedView, grid_step: int) -> StoredKeyframe:
        """A keyframe that was ``MapKeyframe.seen``: its model is made from its view again.

        Args:
            keyframe: as it is.
            view: its view.
            grid_step: of the model.
        """
        return _stored(keyframe, view, partial(model_of, grid_step=grid_step))

    def whole(self) -> MapKeyframe:
        """The keyframe as it was."""
        view = self.view.unpacked()
        features = replace(self.features, view=view)
        return MapKeyframe(self.row, self.stamp_ns, self.T_odom_camera, features, self.model(view))


def _stored(
    keyframe: MapKeyframe, view: PackedView, model: Callable[[View], Model]
) -> StoredKeyframe:
    features = replace(keyframe.features, view=view.rest)
    return StoredKeyframe(
        keyframe.row, keyframe.stamp_ns, keyframe.T_odom_camera, view, features, model
    )


class WholeKeyframes:
    """The keyframes that were used last, as they are; others are made whole where needed."""

    def __init__(self) -> None:
        self._whole: OrderedDict[StoredKeyframe, MapKeyframe] = OrderedDict()

    def of(self, stored: StoredKeyframe) -> MapKeyframe:
        """The whole keyframe of a stored one."""
        keyframe = self._whole.get(stored)
        self.remember(stored, stored.whole() if keyframe is None else keyframe)
        return self._whole[stored]

    def remember(self, stored: StoredKeyframe, keyframe: MapKeyframe) -> None:
        """Keeps a whole keyframe for a while."""
        self._whole[stored] = keyframe
        self._whole.move_to_end(stored)
        if len(self._whole) > _MOST_WHOLE:
            self._whole.popitem(last=False)
