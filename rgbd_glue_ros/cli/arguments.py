"""Arguments that several commands share, and their meaning."""

from __future__ import annotations

import argparse
import shlex
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from rgbd_glue_ros.cli import given_parameters
from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.files.user_paths import expanded

if TYPE_CHECKING:
    from rgbd_glue_ros.experiments.batch.opening import Opening
    from rgbd_glue_ros.experiments.demo.played import PlayedRecording
    from rgbd_glue_ros.experiments.replay.run_record import Provenance
    from rgbd_glue_ros.parameters import InputConfig, Parameter
    from rgbd_glue_ros.recordings import Recording

RECORDING = "a bag (rosbag2 folder, .mcap, .db3, .bag), a .sens file or a folder of a data set"


def path(text: str) -> Path:
    """A path; ``~`` is the home folder, which shells leave as it is in ``-o=~/out``."""
    if not text:
        # from a variable that is not set; as a path it would be the working folder
        raise argparse.ArgumentTypeError("is empty, give a path")
    try:
        return expanded(text, "")
    except InputError as error:
        raise argparse.ArgumentTypeError(error.cause) from error


# There are never more frames, gaps or processes
_DIGITS = 9


def positive(text: str) -> int:
    """A positive whole number with at most nine digits."""
    if not text.isdecimal() or len(text) > _DIGITS or int(text) < 1:
        raise argparse.ArgumentTypeError(f"{text!r} is not a whole number from 1 to 999999999")
    return int(text)


def positive_number(text: str) -> float:
    """A finite positive number."""
    number = _number(text)
    if not 0 < number < float("inf"):
        raise argparse.ArgumentTypeError(f"{text!r} is not a number greater than zero")
    return number


def number_from_zero(text: str) -> float:
    """A finite number that is not negative."""
    number = _number(text)
    if not 0 <= number < float("inf"):
        raise argparse.ArgumentTypeError(f"{text!r} is not a number from zero on")
    return number


def _number(text: str) -> float:
    """A number; NaN if the text is none."""
    try:
        return float(text)
    except ValueError:
        return float("nan")


def add_output(parser: argparse.ArgumentParser, default: Path | None, said: str = "") -> None:
    """``-o``; if the default depends on other arguments (None), ``said`` describes it."""
    parser.add_argument(
        "-o",
        "--output",
        metavar="DIR",
        type=path,
        default=default,
        help=f"folder for the results (default: {said or default})",
    )


def add_ground_truth(parser: argparse.ArgumentParser) -> None:
    """``--ground-truth``."""
    parser.add_argument(
        "--ground-truth",
        metavar="FILE",
        type=path,
        help="ground-truth trajectory instead of the recording's: lines of a stamp and a pose, as "
        "in TUM or EuRoC",
    )


def add_limit(parser: argparse.ArgumentParser) -> None:
    """``--limit``."""
    parser.add_argument("--limit", metavar="N", type=positive, help="stop after N frames")


def add_recording(parser: argparse.ArgumentParser) -> None:
    """One SRC, and how it is read."""
    parser.add_argument("recording", metavar="SRC", type=path, help=RECORDING)
    add_topics(parser)


def add_recordings(parser: argparse.ArgumentParser, least: Literal["+", "*"] = "+") -> None:
    """Any number of SRC, and how they are read."""
    parser.add_argument(
        "recordings",
        metavar="SRC",
        type=path,
        nargs=least,
        help=f"{RECORDING}, or a folder of many",
    )
    parser.add_argument(
        "--only",
        metavar="SPLIT",
        help="of many recordings, only those of an official split (3dmatch-test, 7-scenes-test, "
        "scannet-v2-test), or those named in a file, one per line",
    )
    add_topics(parser)


def add_topics(parser: argparse.ArgumentParser) -> None:
    """How recordings are read."""
    for kind, what in (
        ("color", "colour images"),
        ("depth", "depth images"),
        ("info", "camera infos"),
        ("depth-info", "camera infos of unregistered depth"),
        ("truth", "true poses"),
        ("imu", "IMU"),
    ):
        parser.add_argument(
            f"--{kind}-topic",
            metavar="TOPIC",
            help=f"topic of a bag's {what}, instead of the one found by type and name",
        )
    parser.add_argument(
        "--calibration",
        metavar="FILE",
        type=path,
        help="camera of the colour images, instead of the recording's: a file of ROS, OpenCV, "
        "ORB-SLAM, Kalibr or Open3D, or a 3x3 matrix",
    )
    parser.add_argument(
        "--depth-calibration",
        metavar="FILE",
        type=path,
        help="camera of the depth images, if they are not registered to colour: the same kinds of "
        "files; its pose is given by --set depth_camera_pose='x y z roll pitch yaw'",
    )
    parser.add_argument(
        "--depth-scale",
        metavar="M",
        type=positive_number,
        help="metres per unit of the depth images, for example 0.001 for millimetres, or units "
        "per metre, for example TUM's 5000; the same as --set depth_scale=M",
    )


def add_set(parser: argparse.ArgumentParser) -> None:
    """``--set``."""
    parser.add_argument(
        "--set",
        metavar="NAME=VALUE",
        action="append",
        default=[],
        help="set a parameter, as in --set glue.k=3; may be repeated",
    ).completer = assignments  # type: ignore[attr-defined]


def add_part(parser: argparse.ArgumentParser) -> None:
    """The part of a recording to play, its speed, and the kind of messages."""
    parser.add_argument(
        "--rate",
        type=positive_number,
        default=1.0,
        help="speed of the recording (default: %(default)s)",
    )
    parser.add_argument(
        "--start", metavar="S", type=number_from_zero, default=0.0, help="skip its first S s"
    )
    parser.add_argument("--duration", metavar="S", type=positive_number, help="stop after S s")
    images = parser.add_mutually_exclusive_group()
    images.add_argument(
        "--raw",
        dest="compressed",
        action="store_false",
        default=False,
        help="publish images as they are, without loss (default)",
    )
    images.add_argument(
        "--compressed", action="store_true", help="publish JPEG and compressedDepth"
    )


def add_camera(parser: argparse.ArgumentParser, what: str) -> None:
    """``--camera``; ``what`` describes what it sets."""
    parser.add_argument(
        "--camera",
        metavar="PRESET",
        help=f"{what}: a name in config/cameras, such as realsense_d400, or a similar file",
    ).completer = camera_presets  # type: ignore[attr-defined]


def add_workers(parser: argparse.ArgumentParser) -> None:
    """Where many recordings are processed."""
    where = parser.add_mutually_exclusive_group()
    where.add_argument(
        "--workers",
        metavar="N",
        type=positive,
        help="run in N processes on this machine (needs the extra scale)",
    )
    where.add_argument(
        "--scheduler",
        metavar="ADDRESS",
        help="run on a Dask cluster, such as tcp://host:8786; its workers must see the same files",
    )


def add_config(parser: argparse.ArgumentParser, preset: str = "live") -> None:
    """The parameters of the method."""
    parser.add_argument(
        "--preset",
        default=preset,
        metavar="PRESET",
        help="preset to start from: live, paper, or a YAML file of parameters, such as the "
        "params.yaml of an earlier run (default: %(default)s)",
    ).completer = _presets  # type: ignore[attr-defined]
    add_set(parser)


def sources(args: argparse.Namespace) -> list[Path]:
    """The recordings at and below every SRC that pass ``--only``.

    Raises:
        InputError: there are none.
    """
    from rgbd_glue_ros.recordings import recordings, split

    return recordings(args.recordings, split(args.only) if args.only else None)


def opener(args: argparse.Namespace, inputs: InputConfig | None = None) -> Opening:
    """Opens recordings according to the arguments, in this process or another.

    Args:
        args: of the command.
        inputs: how images are read; None for ``--set`` and the options.

    Raises:
        InputError: the calibration cannot be read, or a parameter is unknown or not allowed.
    """
    from rgbd_glue_ros.experiments.batch.opening import Opening
    from rgbd_glue_ros.recordings import Topics, read_calibration

    topics = Topics(
        args.color_topic,
        args.depth_topic,
        args.info_topic,
        args.truth_topic,
        args.depth_info_topic,
        args.imu_topic,
    )
    return Opening(
        topics,
        read_calibration(args.calibration) if args.calibration else None,
        read_calibration(args.depth_calibration) if args.depth_calibration else None,
        inputs or given_parameters.inputs_of(args),
    )


def opened(args: argparse.Namespace, source: Path) -> Recording:
    """A recording with the truth and the number of frames that the arguments ask for.

    Raises:
        InputError: the recording, its truth or its calibration cannot be read, or a parameter is
            unknown or not allowed.
    """
    from rgbd_glue_ros.recordings.first_frames import first_frames
    from rgbd_glue_ros.recordings.other_truth import with_ground_truth
    from rgbd_glue_ros.trajectories.tum import read_tum

    truth = read_tum(args.ground_truth) if args.ground_truth else None
    return first_frames(with_ground_truth(opener(args)(source), truth), args.limit)


def provenance(args: argparse.Namespace, warnings: Sequence[str] = ()) -> Provenance:
    """How the run of a command came about, with what was warned of as its recording was opened."""
    from rgbd_glue_ros.experiments.replay.run_record import Provenance

    return Provenance(given_parameters.inputs_of(args), command(args), tuple(warnings))


def played(args: argparse.Namespace, recording: Recording) -> PlayedRecording:
    """The part of a recording to play."""
    from rgbd_glue_ros.experiments.demo.played import PlayedRecording
    from rgbd_glue_ros.recordings.bag.writer import COMPRESSED, RAW

    codec = COMPRESSED if args.compressed else RAW
    return PlayedRecording(recording, codec, args.start, args.duration)


def command(args: argparse.Namespace) -> str:
    """The command line as typed, for quoting."""
    from rgbd_glue_ros.cli.parser import PROGRAM

    return shlex.join([PROGRAM, *args.words])


def node_command(args: argparse.Namespace) -> str:
    """The command that starts a node for what is played, also without a ROS installation."""
    words = ["odometry", *(["--camera", args.camera] if args.camera else [])]
    ros = list(args.ros)
    if args.compressed:
        ros += ["-p", "image_transport:=compressed", "-p", "depth_transport:=compressedDepth"]
    return shlex.join([*words, *(["--ros-args", *ros] if ros else [])])


def parameter_names(prefix: str = "", **_: object) -> list[str]:
    """The names of all parameters that begin with ``prefix``, for shell completion."""
    return [p.name for p in _parameters() if p.name.startswith(prefix)]


def assignments(prefix: str, **_: object) -> list[str]:
    """``NAME=``, and then the values of a parameter, if they can be listed."""
    given = prefix.partition("=")[0]
    if "=" not in prefix:
        return [f"{name}=" for name in parameter_names(prefix)]
    return [
        f"{p.name}={value}"
        for p in _parameters()
        if p.name == given
        for value in (p.choices or (("true", "false") if p.type is bool else ()))
    ]


def _parameters() -> Iterator[Parameter]:
    from rgbd_glue_ros.parameters import Config, InputConfig, parameters

    for part in (Config(), InputConfig()):
        yield from parameters(part)


def camera_presets(**_: object) -> list[str]:
    """The names of camera presets, for shell completion."""
    from rgbd_glue_ros.live.camera_presets import camera_names

    return camera_names()


def _presets(**_: object) -> list[str]:
    from rgbd_glue_ros.parameters import share_directory

    return sorted(path.stem for path in (share_directory() / "config").glob("*.yaml"))
