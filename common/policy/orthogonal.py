"""Orthogonal matrices as a function of a key, with the same bits on every machine.

Saxe et al., "Exact solutions to the nonlinear dynamics of learning in deep linear neural networks" (2014,
arXiv:1312.6120). Libraries of linear algebra choose their order of summation by the processor, hence modified
Gram-Schmidt in a fixed order here, done twice, which suffices for full precision (Giraud et al. 2005). As its
diagonal factors are positive, the matrices are uniformly distributed over the orthogonal ones (Mezzadri 2007).
"""

import numpy as np
from numpy.typing import NDArray

from railctl.common.kernel import bare_kernel
from railctl.common.policy.streams import normals


def orthogonal(n_out: int, n_in: int, gain: float, key: int) -> NDArray[np.float32]:
    """[n_out, n_in]: its rows, or if there are more rows than columns its columns, are orthogonal, of length `gain`."""
    vectors = np.empty((min(n_out, n_in), max(n_out, n_in)))
    normals(np.uint64(key), vectors.reshape(-1))
    orthonormalise(vectors)
    matrix = vectors if n_out <= n_in else vectors.T
    return np.ascontiguousarray(gain * matrix, dtype=np.float32)


@bare_kernel
def orthonormalise(vectors: NDArray[np.float64]) -> None:
    """Make the rows of vectors [n, m], n <= m, orthonormal in place, from the first to the last."""
    count, length = vectors.shape
    for i in range(count):
        for _ in range(2):
            for j in range(i):
                product = 0.0
                for k in range(length):
                    product += vectors[i, k] * vectors[j, k]
                for k in range(length):
                    vectors[i, k] -= product * vectors[j, k]
        square = 0.0
        for k in range(length):
            square += vectors[i, k] * vectors[i, k]
        scale = 1.0 / np.sqrt(square)
        for k in range(length):
            vectors[i, k] *= scale
