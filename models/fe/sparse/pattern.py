"""Block sparsity pattern of a tangent matrix."""

from dataclasses import dataclass

import numpy as np
from scipy.sparse import bsr_array, csr_array


@dataclass(frozen=True)
class Pattern:
    """Block rows and columns of the nodes that elements couple.

    indptr (N+1,), indices (B,)  as in a BSR matrix of 3 by 3 blocks, columns sorted
    """

    indptr: np.ndarray
    indices: np.ndarray

    def where(self, elements: np.ndarray) -> np.ndarray:
        """Index of the block of each pair of nodes of each element (E,k,k); arbitrary if a node is -1. ValueError: a
        pair that the pattern does not couple."""
        count = len(self.indptr) - 1
        keys = np.repeat(np.arange(count), np.diff(self.indptr)) * count + self.indices
        a, b = elements[:, :, None], elements[:, None, :]
        wanted = np.where((a >= 0) & (b >= 0), a * count + b, keys[0])
        places = np.searchsorted(keys, wanted)
        if (keys[np.minimum(places, len(keys) - 1)] != wanted).any():
            raise ValueError("nodes that the pattern does not couple")
        return places

    def matrix(self, data: np.ndarray) -> bsr_array:
        """The sparse matrix with these blocks (B,3,3)."""
        size = 3 * (len(self.indptr) - 1)
        return bsr_array((data, self.indices, self.indptr), shape=(size, size))


def pattern(count: int, elements: np.ndarray) -> Pattern:
    """Pattern of `count` nodes coupled by elements (E,k), padded with -1."""
    clique, place = np.nonzero(elements >= 0)
    node = elements[clique, place]
    ones = np.ones(len(node) + count, dtype=np.int32)
    single = len(elements) + np.arange(count)  # each node is coupled to itself, also without elements
    members = (np.concatenate([clique, single]), np.concatenate([node, np.arange(count)]))
    incidence = csr_array((ones, members), shape=(len(elements) + count, count))
    coupled = csr_array(incidence.T @ incidence)
    coupled.sort_indices()
    return Pattern(coupled.indptr.astype(np.int32), coupled.indices.astype(np.int32))
