"""Nearest neighbours in feature space, for float and binary descriptors."""

from __future__ import annotations

from typing import Any

import numpy as np
from numba.extending import intrinsic
from numpy.typing import NDArray

from rgbd_glue_ros.compiled import compiled
from rgbd_glue_ros.types import Float32, Float64, Int64, UInt8

# Rows of the distance matrix computed at once: 512 x 10000 float32 are 20 MB, which stay in the
# cache between the product and the search for the maximum.
_BLOCK = 512
_FARTHEST = np.iinfo(np.int32).max


def nearest_two(query: Float32 | UInt8, reference: Float32 | UInt8) -> tuple[Int64, Float64]:
    """The two nearest reference rows of each query row.

    Args:
        query: descriptors [N, D]; float32 are compared by Euclidean distance (equation 1),
            uint8 are bit strings and compared by Hamming distance.
        reference: descriptors [M, D] of the same type, M >= 2.

    Returns:
        Index int64 [N] of the nearest row, and distances float64 [N, 2] to it and to the second.
    """
    if query.dtype == np.uint8:
        return _nearest_two_binary(np.asarray(query, np.uint8), np.asarray(reference, np.uint8))
    return _nearest_two_float(np.asarray(query, np.float32), np.asarray(reference, np.float32))


def _nearest_two_float(query: Float32, reference: Float32) -> tuple[Int64, Float64]:
    """One matrix product per block: |a - b|² = |a|² - 2 a·b + |b|², where |a|² is constant."""
    index = np.empty(len(query), np.int64)
    distances = np.empty((len(query), 2))
    # a·b - |b|²/2 is one product, of rows with one more column
    half_norm = 0.5 * np.einsum("ij,ij->i", reference, reference)
    extended = np.column_stack([reference, -half_norm]).T
    for start in range(0, len(query), _BLOCK):
        block = query[start : start + _BLOCK]
        rows = np.arange(len(block))
        score = np.column_stack([block, np.ones_like(rows, np.float32)]) @ extended
        nearest = score.argmax(axis=1)
        score[rows, nearest] = -np.inf
        second = score.argmax(axis=1)
        # the product loses digits by cancellation, so the two distances kept are computed directly
        two = np.column_stack([nearest, second])
        exact = np.linalg.norm(block[:, None] - reference[two], axis=2)
        # and may turn out to be the other way about
        index[start : start + len(block)] = two[rows, exact.argmin(axis=1)]
        distances[start : start + len(block)] = np.sort(exact, axis=1)
    return index, distances


def _nearest_two_binary(query: UInt8, reference: UInt8) -> tuple[Int64, Float64]:
    """Hamming distances by population counts of words, several at once in vector registers."""
    columns = np.ascontiguousarray(_words(reference).T)
    return _nearest_two_words(_words(query), columns)


def _words(bits: UInt8) -> NDArray[np.uint64]:
    """Bit strings [N, D] as words [N, ceil(D / 8)], padded with zeros."""
    if padding := -bits.shape[1] % 8:
        bits = np.pad(bits, ((0, 0), (0, padding)))
    return np.ascontiguousarray(bits).view(np.uint64)


@intrinsic  # type: ignore[untyped-decorator]
def _population_count(_context: Any, word: Any) -> Any:
    """The number of ones in a word: one instruction, which numba does not expose otherwise."""

    def generate(_context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        return builder.ctpop(arguments[0])

    return word(word), generate


@compiled
def _least(numbers: NDArray[np.int32]) -> int:
    """``numbers.min()``, which numba does not compile to vector instructions."""
    least = numbers[0]
    for j in range(len(numbers)):
        least = min(least, numbers[j])
    return int(least)


@compiled
def _nearest_two_words(
    query: NDArray[np.uint64], columns: NDArray[np.uint64]
) -> tuple[Int64, Float64]:
    """``nearest_two`` for words [N, W] and, so that loops are contiguous in memory, [W, M]."""
    count = columns.shape[1]
    index = np.empty(len(query), np.int64)
    distances = np.empty((len(query), 2))
    # distance and row as one number, so that only the minimum has to be found
    keys = np.empty(count, np.int32)
    for i in range(len(query)):
        keys[:] = 0
        for k in range(query.shape[1]):
            for j in range(count):
                keys[j] += np.int32(_population_count(query[i, k] ^ columns[k, j]))
        for j in range(count):
            keys[j] = keys[j] * np.int32(count) + np.int32(j)
        nearest = _least(keys)
        index[i] = nearest % count
        keys[index[i]] = _FARTHEST
        distances[i, 0], distances[i, 1] = nearest // count, _least(keys) // count
    return index, distances


def distance_ratio(distances: Float64) -> Float64:
    """Equation 1: r = D(f_p, f_q) / D(f_p, f_q^nn2) from distances [N, 2]; 1 where both are 0."""
    nearest, second = distances[:, 0], distances[:, 1]
    return np.divide(nearest, second, out=np.ones_like(nearest), where=second > 0)


def one_to_one(target: Int64, cost: Float64) -> Int64:
    """Rows, increasing, of the match with the least cost for each target."""
    order = np.lexsort((cost, target))
    first = np.ones(len(order), bool)
    first[1:] = target[order[1:]] != target[order[:-1]]
    return np.sort(order[first]).astype(np.int64)
