"""Points that fill the unit cube evenly, however many are taken (Halton 1960; Keller 1997 starts his paths with them).

Any run of consecutive points fills it about as evenly as the first ones do: sets of virtual lights are such runs, and
the paths that go on after a bounce are the first ones (MATHS §10).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

PRIMES = (2, 3, 5, 7, 11, 13, 17, 19, 23, 29, 31, 37, 41, 43, 47, 53, 59, 61, 67, 71, 73, 79, 83, 89, 97, 101, 103)
MOST_DIMENSIONS = len(PRIMES)


def halton(count: int, dimensions: int, seed: int) -> NDArray[np.float64]:
    """Return the first points, ``(count, dimensions)``, 0 ≤ x < 1, with digits permuted at random by the seed.

    Each digit of each dimension has a permutation of its own: the points stay as even as they were, and dimensions of
    large bases are no longer aligned with each other.

    Raises
    ------
    ValueError
        Where there are more dimensions than `MOST_DIMENSIONS`.
    """
    if dimensions > MOST_DIMENSIONS:
        raise ValueError(f"{dimensions} dimensions are more than {MOST_DIMENSIONS}")
    points = np.zeros((count, dimensions))
    for axis, base in enumerate(PRIMES[:dimensions]):
        random = np.random.default_rng([seed, axis])
        rest = np.arange(count)
        scale = 1.0
        largest = count - 1
        # Digits of finer places than a float32 shows are not worth their time.
        while scale > 2.0**-32:
            scale /= base
            digits = random.permutation(base)
            # Beyond the digits of the largest number all are zero.
            points[:, axis] += (digits[rest % base] if largest > 0 else digits[0]) * scale
            rest, largest = rest // base if largest > 0 else rest, largest // base
    # Permuted digits may all be the largest.
    return np.minimum(points, np.nextafter(1.0, 0.0))
