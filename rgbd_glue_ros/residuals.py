"""Where the planes and pixels of a model meet a frame: the residuals of refinement and timing."""

from __future__ import annotations

from rgbd_glue_ros.camera import depth_sigma, displaced, sample_depth
from rgbd_glue_ros.compiled import compiled
from rgbd_glue_ros.types import Float32, Float64, UInt8

# Farther than this many sigma of depth apart, two depths are not the same surface.
GATE_SIGMAS = 10.0
# Blur of depth edges and lens: a depth belongs to a pixel only to about this accuracy.
_LATERAL_SIGMA_PX = 0.5
# Nearer than this nothing is seen.
NEAREST_M = 0.05
# By this part of its depth a surface may recede, or be off, within what a pose is wrong.
_RECEDING = 0.02


@compiled
def in_camera(
    T: Float64,
    points: Float64,
    i: int,
    K: Float64,
    height: int,
    twist: Float64,
    readout: float,
    delay: float,
) -> tuple[float, float, float, float]:
    """Point i of a model where the camera at T sees it, and when.

    Args:
        T: T_model_camera when the middle row of the colour image is read, float64 [4, 4].
        points: float64 [N, 3] of the model.
        i: which of them.
        K: fx, fy, cx, cy.
        height: of the image, pixels.
        twist: float64 [6], velocity of the camera.
        readout: seconds from the first row to the last.
        delay: seconds from the colour image to this one.

    Returns:
        x, y, z in the optical frame when the shutter is at the point's row, and that row's part
        of the shutter's way; a z that is not positive for a point behind the camera.
    """
    d0, d1, d2 = points[i, 0] - T[0, 3], points[i, 1] - T[1, 3], points[i, 2] - T[2, 3]
    z = T[0, 2] * d0 + T[1, 2] * d1 + T[2, 2] * d2
    if z < NEAREST_M:
        return 0.0, 0.0, -1.0, 0.0
    x = T[0, 0] * d0 + T[1, 0] * d1 + T[2, 0] * d2
    y = T[0, 1] * d0 + T[1, 1] * d1 + T[2, 1] * d2
    sx, sy, sz, part = x, y, z, 0.0
    # the row tells the time and the time the row; a second look is within a hundredth of a pixel
    for _ in range(2):
        part = (K[1] * sy / sz + K[3]) / height - 0.5
        sx, sy, sz = displaced(x, y, z, -(delay + part * readout), twist)
        if sz < NEAREST_M:
            return 0.0, 0.0, -1.0, 0.0
    return sx, sy, sz, part


@compiled
def seen_surface(
    depth: Float32, K: Float64, x: float, y: float, z: float
) -> tuple[float, float, float]:
    """The measured point on the ray through x, y, z; its z is NaN where depth is unknown."""
    rx, ry = x / z, y / z
    measured = sample_depth(depth, K[0] * rx + K[2], K[1] * ry + K[3])
    return rx * measured, ry * measured, measured


@compiled
def plane_variance(
    nx: float, ny: float, nz: float, x: float, y: float, z: float, K: Float64
) -> float:
    """Variance, m², of a measured point x, y, z along a normal, both in the optical frame.

    Depth noise along the ray, and lateral blur.
    """
    along = depth_sigma(z) * (nx * x + ny * y + nz * z) / z
    lateral = _LATERAL_SIGMA_PX * z / K[0]
    return float(along * along + lateral * lateral * (nx * nx + ny * ny))


@compiled
def inside(image: UInt8, u: float, v: float) -> bool:
    """Whether the brightness at pixel (u, v) and its gradient can be read."""
    height, width = image.shape
    return bool(u >= 1.0 and v >= 1.0 and u < width - 2.0 and v < height - 2.0)


@compiled
def brightness_at(image: UInt8, u: float, v: float) -> float:
    """Bilinear brightness at pixel (u, v), which must be ``inside``."""
    u0, v0 = int(u), int(v)
    a, b = u - u0, v - v0
    top = (1 - a) * image[v0, u0] + a * image[v0, u0 + 1]
    bottom = (1 - a) * image[v0 + 1, u0] + a * image[v0 + 1, u0 + 1]
    return float((1 - b) * top + b * bottom)


@compiled
def gradient_at(image: UInt8, u: float, v: float) -> tuple[float, float]:
    """Central differences of the brightness at pixel (u, v), which must be ``inside``."""
    gu = 0.5 * (brightness_at(image, u + 1.0, v) - brightness_at(image, u - 1.0, v))
    gv = 0.5 * (brightness_at(image, u, v + 1.0) - brightness_at(image, u, v - 1.0))
    return gu, gv


@compiled
def apart(z: float) -> float:
    """How far from a depth z another one is surely another surface, m.

    More than noise: images are not taken at quite the same time, and surfaces recede.
    """
    return GATE_SIGMAS * depth_sigma(z) + _RECEDING * z


@compiled
def shows_another(depth: Float32, K: Float64, x: float, y: float, z: float) -> bool:
    """Whether another surface is seen where a point is expected, in the depth image's own frame.

    Where depth is unknown, nothing says so.
    """
    if z < NEAREST_M:
        return False
    row, column = int(K[1] * y / z + K[3] + 0.5), int(K[0] * x / z + K[2] + 0.5)
    if row < 0 or column < 0 or row >= depth.shape[0] or column >= depth.shape[1]:
        return False
    return bool(abs(depth[row, column] - z) > apart(z))
