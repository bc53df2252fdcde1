"""SuperGlue (Sarlin, DeTone, Malisiewicz and Rabinovich 2020): matching as optimal transport."""

from __future__ import annotations

from rgbd_glue_ros.features.layers import Tensor, Weights, batch_norm
from rgbd_glue_ros.features.learned import LearnedKeypoints
from rgbd_glue_ros.features.torch_library import F, torch

CONFIDENCE = 0.2
"""Matches below this confidence are rejected: the authors' default."""

_HEADS = 4

_SINKHORN_STEPS = 20
"""Steps of the optimal transport, as in the authors' evaluation."""


class SuperGlue:
    """The matcher."""

    def __init__(self, weights: Weights) -> None:
        self._weights = weights

    def __call__(self, source: LearnedKeypoints, target: LearnedKeypoints) -> Tensor:
        """The logarithm of the probability that keypoints match, [N, M]."""
        w = self._weights
        x0, x1 = (_encoded(points, w.below("kenc", "encoder")) for points in (source, target))
        layer = 0
        while w.get(f"gnn.layers.{layer}.attn.merge.weight") is not None:
            # attention alternates between the own and the other set
            seen0, seen1 = (x0, x1) if layer % 2 == 0 else (x1, x0)
            block = w.below("gnn", "layers", layer)
            x0, x1 = x0 + _message(x0, seen0, block), x1 + _message(x1, seen1, block)
            layer += 1
        m0, m1 = (_pointwise(x, w.below("final_proj")) for x in (x0, x1))
        similarity = (m0 @ m1.T).float() / m0.shape[-1] ** 0.5
        return log_transport(similarity, w["bin_score"], _SINKHORN_STEPS)[:-1, :-1]


def _encoded(points: LearnedKeypoints, w: Weights) -> Tensor:
    """Descriptors combined with positions and scores of the keypoints, [N, D]."""
    size = points.uv.new_tensor([points.width, points.height])
    centred = (points.uv - size / 2) / (size.max() * 0.7)
    place = torch.cat([centred, points.scores[:, None]], dim=1)
    return points.descriptors + _perceptron(place, w)


def _perceptron(x: Tensor, w: Weights) -> Tensor:
    """Linear maps with normalisation and a rectifier between them."""
    number = 0
    while w.get(f"{number + 1}.weight") is not None:
        x = F.relu(batch_norm(_pointwise(x, w.below(number)), w.below(number + 1)))
        number += 3
    return _pointwise(x, w.below(number))


def _message(x: Tensor, seen: Tensor, w: Weights) -> Tensor:
    """What a set [N, D] learns from one that it attends to [M, D]."""
    q, k, v = (
        # heads are interleaved in the last dimension
        _pointwise(y, w.below("attn", "proj", number)).unflatten(-1, (-1, _HEADS)).permute(2, 0, 1)
        for number, y in enumerate((x, seen, seen))
    )
    attended = F.scaled_dot_product_attention(q, k, v).permute(1, 2, 0).flatten(-2)
    message = _pointwise(attended, w.below("attn", "merge"))
    return _perceptron(torch.cat([x, message], dim=1), w.below("mlp"))


def _pointwise(x: Tensor, w: Weights) -> Tensor:
    """A linear map of rows, stored as a convolution of size 1."""
    return F.linear(x, w["weight"][..., 0], w["bias"])


def log_transport(similarity: Tensor, bin_score: Tensor, steps: int) -> Tensor:
    """Sinkhorn's algorithm in logarithms: every keypoint is matched once, or goes to the bin.

    Args:
        similarity: [N, M].
        bin_score: similarity of every keypoint to the bin, a scalar.
        steps: number of iterations.

    Returns:
        Logarithms [N + 1, M + 1] of how much of each keypoint is assigned where, the bin last.
        Except for the bin's, each column sums to 1, and so does each row, the better the more
        steps.
    """
    n, m = similarity.shape
    scores = F.pad(similarity, (0, 1, 0, 1))
    scores[n, :] = scores[:, m] = bin_score
    # one of each keypoint, and room for all of the other set in the bin
    rows, columns = similarity.new_zeros(n + 1), similarity.new_zeros(m + 1)
    rows[n], columns[m] = columns.new_tensor(m).log(), rows.new_tensor(n).log()
    u, v = torch.zeros_like(rows), torch.zeros_like(columns)
    for _ in range(steps):
        u = rows - torch.logsumexp(scores + v, dim=1)
        v = columns - torch.logsumexp(scores + u[:, None], dim=0)
    return scores + u[:, None] + v
