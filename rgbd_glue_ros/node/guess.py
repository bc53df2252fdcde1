"""The robot's pose from another odometry on TF: an optional hint, which never costs a pose."""

from __future__ import annotations

from dataclasses import dataclass

from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.geometry import se3
from rgbd_glue_ros.live.patient_lookup import PatientLookup
from rgbd_glue_ros.node.base_node import BaseNode
from rgbd_glue_ros.node.tf import Transforms
from rgbd_glue_ros.parameters import NodeConfig
from rgbd_glue_ros.types import Float64
from rgbd_glue_ros.types.checks import FARTHEST_M, check_guess


@dataclass(frozen=True, eq=False)
class Guess:
    """A pose from another odometry, in its own fixed frame.

    Attributes:
        T_guess_child: of the robot frame, float64 [4, 4].
        T_guess_camera: of the optical frame, float64 [4, 4].
    """

    T_guess_child: Float64
    T_guess_camera: Float64


class GuessInput:
    """Looks up guesses; says once why there are none, and on /diagnostics as long as it lasts."""

    def __init__(self, node: BaseNode, config: NodeConfig, transforms: Transforms) -> None:
        """Prepares the look-ups.

        Args:
            node: provides the log, and the monitor that the diagnostics are made of.
            config: the frames.
            transforms: where to look them up.
        """
        self._node = node
        self._target, self._source = config.guess_frame_id, config.frame_id
        self._wait_s = config.wait_for_transform
        self._poses = PatientLookup(
            lambda stamp_ns, wait_s: transforms.lookup(
                self._target, self._source, stamp_ns, wait_s
            ),
            config.wait_for_transform,
        )
        self._is_told = False

    def at(self, stamp_ns: int, T_camera_child: Float64) -> Guess | None:
        """The guess at the stamp of a frame; None if there is none, or it is late or unusable.

        Args:
            stamp_ns: of the frame, nanoseconds.
            T_camera_child: pose of the robot frame in the optical frame, float64 [4, 4].
        """
        try:
            T_guess_child = self._poses.at(stamp_ns)
        except InputError as fault:
            self._report(f"the {self._name} is not used: {fault.cause}")
            return None
        if T_guess_child is None:
            if self._poses.is_missing:
                self._report(
                    f"no {self._name} within {self._wait_s} s: make sure that this odometry runs, "
                    "and broadcasts in time; until then no frame waits for it"
                )
            return None
        guess = Guess(T_guess_child, T_guess_child @ se3.inverse(T_camera_child))
        try:
            check_guess(guess.T_guess_camera)
        except InputError:
            x, y, z = T_guess_child[:3, 3]
            self._report(
                f"the {self._name} is not used, since it leads to ({x:.1f} {y:.1f} {z:.1f}) m: "
                f"coordinates must be below {FARTHEST_M:.0e} m"
            )
            return None
        self._clear()
        return guess

    @property
    def _name(self) -> str:
        return f"transform from {self._source} to {self._target} (guess_frame_id)"

    def _report(self, fault: str) -> None:
        self._node.monitor.guess_fault = f"TF: {fault}"
        if self._node.warn_once("TF", f"{fault}. Tracking goes on without this guess"):
            self._is_told = True

    def _clear(self) -> None:
        self._node.monitor.guess_fault = ""
        if self._is_told:
            self._is_told = False
            self._node.get_logger().info(f"TF: the {self._name} is used")


def guess_input(
    node: BaseNode, config: NodeConfig, transforms: Transforms | None
) -> GuessInput | None:
    """The guesses that the parameters ask for; None if they ask for none.

    Raises:
        InputError: what guesses need is not available.
    """
    if not config.guess_frame_id:
        return None
    if not (config.frame_id and transforms):
        raise InputError(
            "guess_frame_id",
            "needs frame_id and TF",
            "set frame_id, install tf2_msgs (scripts/tf2-msgs), or leave guess_frame_id empty",
        )
    return GuessInput(node, config, transforms)
