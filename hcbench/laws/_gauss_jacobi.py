"""Nodes and weights of Gauss-Jacobi quadrature.

Golub and Welsch, Math. Comp. 23 (1969): the nodes are the eigenvalues of the recurrence's matrix.
SciPy's own are ten times less exact, and importing them is a fifth of a `hcbench tune`.
"""

from functools import lru_cache
from math import gamma

import numpy as np

from hcbench.terms.impact import Floats


@lru_cache(maxsize=64)
def gauss_jacobi(count: int, a: float, b: float) -> tuple[Floats, Floats]:
    """Nodes and weights of Gauss quadrature for the weight (1 - x)^a (1 + x)^b on -1 ... 1.

    Both have the shape (count,); the nodes rise. a and b have to be above -1.
    """
    k = np.arange(count, dtype=np.float64)
    total = 2.0 * k + a + b
    # The first row is 0/0 where a + b is 0 or -1; the next lines replace it.
    with np.errstate(divide="ignore", invalid="ignore"):
        middle = (b * b - a * a) / (total * (total + 2.0))
        beside = (
            4.0 * k * (k + a) * (k + b) * (k + a + b) / (total**2 * (total + 1.0) * (total - 1.0))
        )
    middle[0] = (b - a) / (a + b + 2.0)
    beside[0] = 0.0
    beside[1:2] = 4.0 * (1.0 + a) * (1.0 + b) / ((a + b + 2.0) ** 2 * (a + b + 3.0))
    beside = np.sqrt(beside)
    nodes = np.linalg.eigvalsh(np.diag(middle) + np.diag(beside[1:], -1))
    # A weight is one over the sum of the squared polynomials of norm 1 at its node.
    before = np.zeros(count)
    here = np.ones(count)
    squares = here.copy()
    for i in range(count - 1):
        before, here = here, ((nodes - middle[i]) * here - beside[i] * before) / beside[i + 1]
        squares += here**2
    whole = 2.0 ** (a + b + 1.0) * gamma(a + 1.0) * gamma(b + 1.0) / gamma(a + b + 2.0)
    return np.asarray(nodes), np.asarray(whole / squares)
