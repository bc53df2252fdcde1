"""When a frame becomes a keyframe, and what of it does."""

from __future__ import annotations

from rgbd_glue_ros.odometry.background import BackgroundThread
from rgbd_glue_ros.odometry.dynamic_objects import without_dynamic_objects
from rgbd_glue_ros.odometry.keyframe_candidate import KeyframeCandidate
from rgbd_glue_ros.odometry.keyframes import Keyframes
from rgbd_glue_ros.odometry.pose_covariance import is_known
from rgbd_glue_ros.parameters import Config, OdometryConfig
from rgbd_glue_ros.refinement.model import Model, model_of
from rgbd_glue_ros.registration.frame_features import FrameFeatures
from rgbd_glue_ros.registration.glue import Glue


def shows_enough(model: Model, config: OdometryConfig) -> bool:
    """Whether a frame with this model shows enough planes for a keyframe."""
    return len(model.planes.points) >= config.min_planes


def shown_if_due(
    candidate: KeyframeCandidate,
    keyframes: Keyframes,
    glue: Glue,
    background: BackgroundThread,
    config: Config,
) -> tuple[FrameFeatures, Model] | None:
    """What a frame due as a keyframe shows of the room; None if it is not due.

    Args:
        candidate: the frame.
        keyframes: the present ones.
        glue: extracts features.
        background: extracts them while the model is made.
        config: how far apart keyframes are, and what they must show.
    """
    distance = candidate.distance(config.odometry)
    is_near = distance < 1 and candidate.overlap >= config.odometry.keyframe_overlap
    # frames are tracked against the window of one component: the next one would be lost again if a
    # keyframe elsewhere alone showed this place
    is_tracked_on = is_near and keyframes.is_tracked_from(candidate.pose.reference)
    if is_tracked_on and is_known(candidate.pose.motion):
        return None
    features, model = _shown_of_the_room(candidate, keyframes, glue, background, config)
    if not shows_enough(model, config.odometry):
        return None
    if is_tracked_on:
        # the pose is not known, and texture that the keyframes do not show tells how it goes on
        # noise does not get to the coarsest level
        has_texture = len(model.pixels[-1].points) >= config.odometry.min_pixels
        return (features, model) if has_texture else None
    # a blurred image is a poor keyframe: a sharper one will probably follow
    pixels, of_reference = model.pixels[0], candidate.pose.reference.model.pixels[0]
    is_blurred = 2 * len(pixels.points) < len(of_reference.points)
    return None if is_blurred and distance < 2 else (features, model)


def _shown_of_the_room(
    candidate: KeyframeCandidate,
    keyframes: Keyframes,
    glue: Glue,
    background: BackgroundThread,
    config: Config,
) -> tuple[FrameFeatures, Model]:
    """A frame's features and model without dynamic objects."""
    features, grid_step = candidate.features, config.refine.grid_step
    T, component = candidate.pose.T_track_camera, candidate.pose.reference.component
    nearest = keyframes.nearest(T, component, config.odometry.references)
    view = without_dynamic_objects(features.view, T, [k.surfaces for k in nearest])
    if view is None:
        return features, model_of(features.view, grid_step)
    static_features = background.submit(glue.with_other_depth, features, view)
    model = model_of(view, grid_step)
    return static_features.result(), model
