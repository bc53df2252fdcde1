"""Rigid motions: closed forms, the group's laws, and covariances against sampling."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from rigs.geometry import SEEDS, random_transform, transforms, twists
from scipy.linalg import expm
from scipy.spatial.transform import Rotation

from rgbd_glue_ros.geometry import se3
from rgbd_glue_ros.types import Float64


def generator(twist: Float64) -> Float64:
    """The twist as an element of the Lie algebra, [4, 4]."""
    G = np.zeros((4, 4))
    G[:3, :3] = se3.skew(twist[3:])
    G[:3, 3] = twist[:3]
    return G


def test_a_quarter_turn_about_a_point_is_a_twist_around_it() -> None:
    # the origin goes round the point (1, 0, 0), a quarter of a circle of radius 1, to (1, -1, 0)
    speed = np.pi / 2
    T = se3.exp(np.array([0, -speed, 0, 0, 0, speed]))
    np.testing.assert_allclose(T[:3, 3], [1, -1, 0], atol=1e-15)
    np.testing.assert_allclose(T[:3, :3], [[0, -1, 0], [1, 0, 0], [0, 0, 1]], atol=1e-15)


@pytest.mark.slow
@given(twists())
@example(np.array([1.0, 2, 3, 0, 0, 0]))
@example(np.array([1, 2, 3, 0.99e-5, 0, 0]))  # either side of where the series takes over
@example(np.array([1, 2, 3, 1.01e-5, 0, 0]))
def test_exp_is_the_matrix_exponential(twist: Float64) -> None:
    np.testing.assert_allclose(se3.exp(twist), expm(generator(twist)), atol=1e-10)


@given(twists())
@example(np.array([1.0, 2, 3, 0, 0, 0]))
@example(np.array([1, 2, 3, 0.99e-5, 0, 0]))
@example(np.array([1, 2, 3, 0, 0, 1.01e-5]))
def test_log_undoes_exp(twist: Float64) -> None:
    np.testing.assert_allclose(se3.log(se3.exp(twist)), twist, atol=1e-9)


@given(st.tuples(*[st.floats(-1, 1)] * 3), twists())
def test_exp_undoes_log_at_half_a_turn_too(
    axis: tuple[float, float, float], twist: Float64
) -> None:
    length = np.linalg.norm(axis)
    direction = np.array(axis) / length if length > 0.1 else np.array([0.0, 0.6, 0.8])
    R = Rotation.from_rotvec(np.pi * direction).as_matrix()
    T = se3.from_rotation_translation(R, twist[:3])
    np.testing.assert_allclose(se3.exp(se3.log(T)), T, atol=1e-7)


@given(transforms())
def test_the_inverse_undoes_and_undoes_itself(T: Float64) -> None:
    np.testing.assert_allclose(se3.inverse(T) @ T, np.eye(4), atol=1e-14)
    np.testing.assert_allclose(se3.inverse(se3.inverse(T)), T, atol=1e-14)


@given(SEEDS)
def test_many_transforms_are_inverted_as_each_of_them(seed: int) -> None:
    rng = np.random.default_rng(seed)
    stack = np.stack([random_transform(rng) for _ in range(6)]).reshape(2, 3, 4, 4)
    np.testing.assert_allclose(se3.inverse(stack), np.linalg.inv(stack), atol=1e-12)


@given(transforms(), transforms(), SEEDS)
def test_transforming_twice_is_transforming_by_the_product(
    A: Float64, B: Float64, seed: int
) -> None:
    points = np.random.default_rng(seed).normal(size=(5, 3))
    np.testing.assert_allclose(
        se3.transform(A, se3.transform(B, points)), se3.transform(A @ B, points), atol=1e-12
    )


@given(transforms(), twists(max_length=1.0, max_angle=1.0))
def test_the_adjoint_carries_a_twist_to_the_other_side(T: Float64, twist: Float64) -> None:
    """T exp(xi) = exp(Ad_T xi) T."""
    carried = se3.exp(se3.adjoint(T) @ twist) @ T
    np.testing.assert_allclose(T @ se3.exp(twist), carried, atol=1e-9)


def test_a_transported_covariance_is_that_of_the_same_poses_seen_from_another_frame() -> None:
    rng = np.random.default_rng(0)
    T_b_camera, T_a_b = (se3.exp(rng.normal(0, 1, 6)) for _ in range(2))
    A = rng.normal(0, 1, (6, 6))
    covariance = 1e-6 * A @ A.T
    xis = rng.multivariate_normal(np.zeros(6), covariance, 4000)
    in_b = [se3.exp(xi) @ T_b_camera for xi in xis]
    T_a_camera = T_a_b @ T_b_camera
    in_a = np.array([se3.log(T_a_b @ T @ se3.inverse(T_a_camera)) for T in in_b])
    expected = se3.transported_covariance(T_a_b, covariance)
    sigmas = np.sqrt(np.diag(expected))
    np.testing.assert_allclose(
        np.cov(in_a.T) / np.outer(sigmas, sigmas), expected / np.outer(sigmas, sigmas), atol=0.08
    )


@given(transforms(), transforms())
def test_adjoints_multiply_as_their_transforms_do(A: Float64, B: Float64) -> None:
    np.testing.assert_allclose(se3.adjoint(A) @ se3.adjoint(B), se3.adjoint(A @ B), atol=1e-11)


@given(st.tuples(*[st.floats(-9, 9)] * 3), st.tuples(*[st.floats(-9, 9)] * 3))
def test_skew_makes_the_cross_product(
    a: tuple[float, float, float], b: tuple[float, float, float]
) -> None:
    np.testing.assert_allclose(se3.skew(np.array(a)) @ b, np.cross(a, b), atol=1e-12)


@given(transforms())
def test_a_pose_survives_its_quaternion_whose_w_is_never_negative(T: Float64) -> None:
    q = se3.quaternion(T)
    assert q[3] >= 0
    assert np.linalg.norm(q) == pytest.approx(1)
    np.testing.assert_allclose(se3.from_translation_quaternion(T[:3, 3], q), T, atol=1e-12)


def test_quaternions_are_in_the_order_of_ros() -> None:
    # half a turn about z is 0 0 1 0 in the order x y z w
    half_turn = se3.from_translation_quaternion(np.zeros(3), np.array([0.0, 0, 1, 0]))
    np.testing.assert_allclose(half_turn[:3, :3], np.diag([-1, -1, 1]), atol=1e-15)


@given(st.floats(0, np.pi))
def test_the_rotation_angle_is_the_length_of_the_turn(angle: float) -> None:
    T = se3.exp(np.concatenate([[1, 2, 3], angle * np.array([0.6, 0, 0.8])]))
    assert se3.rotation_angle(T) == pytest.approx(angle, abs=1e-7)


@given(T=transforms(), seed=SEEDS)
def test_many_poses_differ_from_one_as_each_of_them_does(T: Float64, seed: int) -> None:
    rng = np.random.default_rng(seed)
    poses = np.array([T, *(random_transform(rng) for _ in range(4))])
    each = [se3.difference(pose, T) for pose in poses]
    np.testing.assert_allclose(se3.differences(poses, T), each, atol=1e-7)
    assert se3.differences(poses[:0], T).shape == (0,)


def test_the_pose_covariance_is_that_of_sampled_positions_and_rotations() -> None:
    rng = np.random.default_rng(0)
    T = se3.exp(np.array([2.0, -1.0, 0.5, 0.3, 0.2, -0.4]))
    root = rng.normal(0, 1e-3, (6, 6))
    covariance = root @ root.T
    samples = [se3.exp(xi) @ T for xi in rng.multivariate_normal(np.zeros(6), covariance, 10_000)]
    positions = np.array([S[:3, 3] for S in samples])
    rotations = Rotation.from_matrix([S[:3, :3] @ T[:3, :3].T for S in samples]).as_rotvec()
    sampled = np.cov(np.hstack([positions, rotations]).T)
    # an entry of a covariance of n samples has this standard error (Wishart distribution)
    expected = se3.pose_covariance(T, covariance)
    variances = np.diag(expected)
    error = np.sqrt((expected**2 + np.outer(variances, variances)) / 10_000)
    assert (np.abs(sampled - expected) < 5 * error).all()


def test_a_perturbation_s_covariance_comes_back_from_that_of_the_pose() -> None:
    rng = np.random.default_rng(1)
    T = se3.exp(np.array([2.0, -1.0, 0.5, 0.3, 0.2, -0.4]))
    root = rng.normal(0, 1e-3, (6, 6))
    covariance = root @ root.T
    back = se3.perturbation_covariance(T, se3.pose_covariance(T, covariance))
    np.testing.assert_allclose(back, covariance, atol=1e-18)


@pytest.mark.parametrize("turn", [np.zeros(3), np.array([0.3, -1.2, 2.0])])
def test_the_largest_sigmas_do_not_depend_on_the_axes(turn: Float64) -> None:
    R = se3.exp(np.concatenate([np.zeros(3), turn]))[:3, :3]
    both = np.kron(np.eye(2), R)
    covariance = both @ np.diag([0.01, 0.02, 0.03, 0.001, 0.005, 0.002]) ** 2 @ both.T
    np.testing.assert_allclose(se3.largest_sigmas(covariance), (0.03, 0.005), rtol=1e-9)
