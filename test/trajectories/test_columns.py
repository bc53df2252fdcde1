"""One trajectory, in the forms in which programs write it, is read as one trajectory."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.geometry import se3
from rgbd_glue_ros.trajectories.tum import read_tum
from rgbd_glue_ros.types import NANOSECONDS, Float64

START_S = 1_305_031_453
POSES = np.stack([se3.exp(np.array([0.1 * i, 0.2, -0.3, 0.05 * i, 0.1, -0.2])) for i in range(6)])
STAMPS = [f"{START_S + i}.250000000" for i in range(6)]

Row = tuple[str, list[str], list[str], Float64]


def rows() -> list[Row]:
    """Stamp, position and quaternion x y z w of each pose as text, and the pose."""
    return [
        (stamp, [f"{v:.12f}" for v in T[:3, 3]], [f"{v:.12f}" for v in se3.quaternion(T)], T)
        for stamp, T in zip(STAMPS, POSES, strict=True)
    ]


def times(row: Row, factor: int) -> str:
    seconds, fraction = row[0].split(".")
    return str((int(seconds) * NANOSECONDS + int(fraction)) * factor // NANOSECONDS)


def tum(row: Row) -> list[str]:
    return [row[0], *row[1], *row[2]]


def lines(separator: str, words: list[list[str]]) -> str:
    return "".join(separator.join(line) + "\n" for line in words)


EUROC_NAMES = (
    "#timestamp, p_RS_R_x [m], p_RS_R_y [m], p_RS_R_z [m], q_RS_w [], q_RS_x [], q_RS_y [], "
    "q_RS_z [], v_RS_R_x [m s^-1], v_RS_R_y [m s^-1], v_RS_R_z [m s^-1], b_w_RS_S_x [rad s^-1]\n"
)
W_FIRST = [[times(r, 10**9), *r[1], r[2][3], *r[2][:3], *["0.5"] * 9] for r in rows()]
FORMS = {
    "TUM": lines(" ", [tum(r) for r in rows()]),
    "byte-order mark, and lines of Windows": "\ufeff"
    + lines(" ", [tum(r) for r in rows()]).replace("\n", "\r\n"),
    "bare names": "timestamp tx ty tz qx qy qz qw\n" + lines(" ", [tum(r) for r in rows()]),
    "CSV with names": "timestamp,tx,ty,tz,qx,qy,qz,qw\n" + lines(",", [tum(r) for r in rows()]),
    "commas and blanks": lines(", ", [tum(r) for r in rows()]),
    "semicolons": lines(";", [tum(r) for r in rows()]),
    "tabs": lines("\t", [tum(r) for r in rows()]),
    "decimal commas": lines(" ", [tum(r) for r in rows()]).replace(".", ","),
    "nanoseconds": lines(" ", [[times(r, 10**9), *r[1], *r[2]] for r in rows()]),
    "microseconds": lines(" ", [[times(r, 10**6), *r[1], *r[2]] for r in rows()]),
    "milliseconds": lines(" ", [[times(r, 10**3), *r[1], *r[2]] for r in rows()]),
    "EuRoC with its names": EUROC_NAMES + lines(",", W_FIRST),
    "EuRoC without": lines(",", W_FIRST),
    "scalar first by its names": "# t x y z qw qx qy qz\n"
    + lines(" ", [[r[0], *r[1], r[2][3], *r[2][:3]] for r in rows()]),
    "TUM-VI": EUROC_NAMES[: EUROC_NAMES.index(", v_RS_R_x")]
    + "\n"
    + lines(",", [words[:8] for words in W_FIRST]),
    "two blanks": lines("  ", [tum(r) for r in rows()]),
    "numbered": "num t x y z qx qy qz qw\n"
    + lines(" ", [[str(i), *tum(r)] for i, r in enumerate(rows())]),
    "numbered without names": lines(" ", [[str(i), *tum(r)] for i, r in enumerate(rows())]),
    "Stray Scanner": "timestamp, frame, x, y, z, qx, qy, qz, qw\n"
    + lines(", ", [[r[0], f"{i:06d}", *r[1], *r[2]] for i, r in enumerate(rows())]),
    "a column behind": lines(" ", [[*tum(r), "7"] for r in rows()]),
    "stamp and 3x4": lines(" ", [[r[0], *map(str, r[3][:3].ravel())] for r in rows()]),
    "stamp and 4x4": lines(" ", [[r[0], *map(str, r[3].ravel())] for r in rows()]),
    "other sign": lines(" ", [[r[0], *r[1], *(str(-float(q)) for q in r[2])] for r in rows()]),
    "longer": lines(" ", [[r[0], *r[1], *(str(2 * float(q)) for q in r[2])] for r in rows()]),
}


@pytest.mark.parametrize("form", FORMS)
def test_every_form_gives_the_same_stamps_and_poses(form: str, tmp_path: Path) -> None:
    path = tmp_path / "trajectory.txt"
    path.write_text(FORMS[form], encoding="utf-8")
    trajectory = read_tum(path)
    expected = [(START_S + i) * NANOSECONDS + NANOSECONDS // 4 for i in range(6)]
    assert list(trajectory.stamps_ns) == expected
    np.testing.assert_allclose(trajectory.poses, POSES, atol=1e-9)


WHOLE = FORMS["TUM"].splitlines()
FAULTS = {
    "a NaN": ([*WHOLE[:2], f"{STAMPS[2]} nan nan nan nan nan nan nan", *WHOLE[3:]], ":3"),
    "a last line that is cut": ([*WHOLE[:-1], WHOLE[-1][:25]], ":6"),
    "a stamp twice": ([*WHOLE[:5], WHOLE[4]], "1 line repeats a stamp"),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_a_line_that_cannot_be_used_is_skipped_and_said(
    fault: str, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    text, said = FAULTS[fault]
    path = tmp_path / "trajectory.txt"
    path.write_text("\n".join(text))
    assert len(read_tum(path)) == 5
    assert said in caplog.text


@pytest.mark.parametrize(
    ("columns", "cause"),
    [(4, "positions without orientations"), (12, "without stamps"), (16, "without stamps")],
)
def test_what_is_no_trajectory_in_time_is_refused_with_what_is_missing(
    columns: int, cause: str, tmp_path: Path
) -> None:
    path = tmp_path / "trajectory.txt"
    path.write_text("\n".join([" ".join(["1"] * columns)] * 3))
    with pytest.raises(InputError, match=cause):
        read_tum(path)


def test_stamps_that_lost_their_digits_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "trajectory.txt"
    words = [[f"{float(r[0]) * 1e9:.6e}", *r[1], *r[2]] for r in rows()]
    path.write_text(lines(" ", words))
    with pytest.raises(
        InputError,
        match=r"6 poses have only 1 different stamps; write stamps with all their digits",
    ):
        read_tum(path)


@pytest.mark.parametrize("stamp", ["1e30", "1e999990", "-1e999990", "9223372036854775808", "inf"])
def test_a_stamp_beyond_all_time_is_no_stamp(stamp: str, tmp_path: Path) -> None:
    path = tmp_path / "trajectory.txt"
    path.write_text(f"{stamp} 0 0 0 0 0 0 1\n")
    with pytest.raises(InputError, match="a stamp"):
        read_tum(path)


def test_a_pose_of_absurd_numbers_is_skipped_or_has_a_direction(tmp_path: Path) -> None:
    path = tmp_path / "trajectory.txt"
    path.write_text(
        "1 0 0 1e308 0 0 0 1\n2 0 0 0 0 1e-320 0 0\n3 0 0 0 0 0 1e300 1e300\n4 0 0 0 0 0 0 1\n"
    )
    trajectory = read_tum(path)
    assert trajectory.stamps_ns.tolist() == [2_000_000_000, 3_000_000_000, 4_000_000_000]
    np.testing.assert_allclose(trajectory.poses[0, :3, :3], np.diag([-1.0, 1, -1]), atol=1e-12)
    np.testing.assert_allclose(
        trajectory.poses[1, :3, :3], [[0, -1, 0], [1, 0, 0], [0, 0, 1]], atol=1e-12
    )


def test_one_decimal_comma_among_whole_numbers_is_one(tmp_path: Path) -> None:
    path = tmp_path / "trajectory.txt"
    path.write_text("1305031453,25 0 0 0 0 0 0 1\n1305031454,25 1 0 0 0 0 0 1\n")
    trajectory = read_tum(path)
    assert list(trajectory.stamps_ns) == [1305031453250000000, 1305031454250000000]
    np.testing.assert_array_equal(trajectory.poses[:, 0, 3], [0, 1])


def test_the_first_line_without_a_pose_is_the_place_of_the_error(tmp_path: Path) -> None:
    path = tmp_path / "poses.txt"
    path.write_text("1 0 0 x 0 0 0 1\n")
    with pytest.raises(InputError) as error:
        read_tum(path)
    assert error.value.where == f"{path}:1"
