"""Whether planes and pixels support a pose enough to accept it."""

from __future__ import annotations

from dataclasses import dataclass, replace

from rgbd_glue_ros.parameters import OdometryConfig
from rgbd_glue_ros.refinement.gauss_newton import Refinement

FEW_MATCHES = 6
"""So many visual matches do not agree by chance with a pose that planes and pixels support."""


@dataclass(frozen=True)
class Evidence:
    """What speaks for a pose.

    Attributes:
        pose: with what its frame shows of it.
        agreeing_matches: number of visual matches that agree with it.
        is_within_reach: whether the camera can have got there.
    """

    pose: Refinement
    agreeing_matches: int
    is_within_reach: bool


@dataclass(frozen=True)
class Acceptance:
    """The evidence that a pose needs to be accepted.

    Attributes:
        min_planes: planes that must be seen for their agreement to count.
        min_pixels: textured pixels that must be seen for their correlation to count.
        plane_agreement: least fraction of the planes that agrees; half of it is a contradiction.
        brightness_correlation: least correlation of the brightness of model and image; half of it
            is a contradiction.
        min_inliers: visual inliers of a registration that no prediction supports.
        includes_jumps: whether a pose that the camera can hardly reach is accepted if it is
            conclusive.
    """

    min_planes: int
    min_pixels: int
    plane_agreement: float
    brightness_correlation: float
    min_inliers: int
    includes_jumps: bool = True

    @staticmethod
    def of(config: OdometryConfig) -> Acceptance:
        """The acceptance of a pose that continues the motion before."""
        return Acceptance(
            config.min_planes,
            config.min_pixels,
            config.plane_agreement,
            config.brightness_correlation,
            config.relocalisation_inliers,
        )

    @property
    def clear_agreement(self) -> float:
        """The fraction of the planes that has to agree if nothing else tells poses apart."""
        return _half_way_to_1(self.plane_agreement)

    def stricter(self) -> Acceptance:
        """One that takes more, for a pose that follows frames without one.

        Of the poses that a camera may have reached, some agree with a few planes or pixels.
        """
        return replace(
            self,
            min_planes=4 * self.min_planes,
            min_pixels=4 * self.min_pixels,
            brightness_correlation=_half_way_to_1(self.brightness_correlation),
        )

    def sceptical(self) -> ScepticalAcceptance:
        """One that takes all kinds of evidence, for a pose that no motion leads to."""
        strict = self.stricter()
        return ScepticalAcceptance(
            strict.min_planes,
            strict.min_pixels,
            strict.plane_agreement,
            strict.brightness_correlation,
            strict.min_inliers,
            strict.includes_jumps,
            usual=self,
        )

    def without_jumps(self) -> Acceptance:
        """One that accepts no pose that the camera can hardly reach."""
        return replace(self, includes_jumps=False)

    def accepts(self, evidence: Evidence) -> bool:
        """Whether to accept a pose: a plausible one within reach, or one that allows a jump."""
        pose = evidence.pose
        return self.is_plausible(pose) and (evidence.is_within_reach or self.allows_jump(pose))

    def is_plausible(self, pose: Refinement) -> bool:
        """Whether planes or pixels support a pose, and the visible planes do not contradict it."""
        planes, agreement = pose.planes_visible, pose.visible_agreement
        if self._planes_contradict(planes, agreement):
            return False
        return self._planes_support(planes, agreement) or self.correlates(pose)

    def is_plausible_place(self, pose: Refinement) -> bool:
        """Whether a pose is plausible though no prediction leads to it.

        Pixels have to support it, and planes must not contradict it. Occluded planes count too: a
        person in front of the camera is not evidence for a place.
        """
        is_contradicted = self._planes_contradict(pose.planes_seen, pose.plane_agreement)
        return self.correlates(pose) and not is_contradicted

    def is_conclusive(self, pose: Refinement) -> bool:
        """Whether planes and pixels both support a pose, so that it need not be a likely one.

        Occluded planes count too.
        """
        is_supported = self._planes_support(pose.planes_seen, pose.plane_agreement)
        return is_supported and self.correlates(pose)

    def correlates(self, pose: Refinement) -> bool:
        """Whether the brightness of model and image correlates at a pose."""
        return (
            pose.pixels_seen >= self.min_pixels
            and pose.brightness_correlation >= self.brightness_correlation
        )

    def pixels_contradict(self, pose: Refinement) -> bool:
        """Whether brightness correlates so little that pixels are compared with wrong ones."""
        return (
            pose.pixels_seen >= self.min_pixels
            and pose.brightness_correlation < self.brightness_correlation / 2
        )

    def allows_jump(self, pose: Refinement) -> bool:
        """Whether to accept a pose that the camera can hardly reach."""
        return self.includes_jumps and self.is_conclusive(pose)

    def _planes_support(self, planes: int, agreement: float) -> bool:
        """Whether enough of so many planes agree."""
        return planes >= self.min_planes and agreement >= self.plane_agreement

    def _planes_contradict(self, planes: int, agreement: float) -> bool:
        """Whether so few of so many planes agree that the pose is wrong, whatever pixels say."""
        return planes >= self.min_planes and agreement < self.plane_agreement / 2


@dataclass(frozen=True, kw_only=True)
class ScepticalAcceptance(Acceptance):
    """The evidence that a pose needs if no motion leads to it.

    Attributes:
        usual: the acceptance of a pose that a motion leads to.
    """

    usual: Acceptance

    def accepts(self, evidence: Evidence) -> bool:
        """Whether all kinds of evidence support a pose, as far as the images hold them.

        Of a pose metres off, most visible planes agree if the others are occluded, and smooth
        brightness may correlate. Both at once, without occluded planes as an excuse, they do only
        by a rare chance, and then no visual match agrees.
        """
        pose, is_within_reach = evidence.pose, evidence.is_within_reach
        matches_agree = evidence.agreeing_matches >= FEW_MATCHES
        if self.is_conclusive(pose) or (matches_agree and self.usual.is_conclusive(pose)):
            return is_within_reach or self.includes_jumps
        has_texture = pose.pixels_seen >= self.min_pixels
        planes_suffice = (
            pose.planes_seen >= self.min_planes and pose.plane_agreement >= self.clear_agreement
        )
        return is_within_reach and not has_texture and planes_suffice


def _half_way_to_1(value: float) -> float:
    return (1 + value) / 2
