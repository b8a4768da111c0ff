"""Pixels of the pictures that models wear, as bytes: PNG of any depth, JPEG, WebP and what else Pillow reads."""

from __future__ import annotations

import io
import warnings
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lightwell.io.gltf_check import GltfError

MAX_TEXTURE_PIXELS = 1 << 26


def decoded(body: bytes, name: str) -> NDArray[np.uint8] | None:
    """Return the bytes ``(H, W, 3)`` of a picture, or ``(H, W, 4)`` where it has alpha; None: no type that is read.

    Raises
    ------
    GltfError
        Where it is too large or damaged; begins with its ``name``.
    """
    from PIL import Image, UnidentifiedImageError

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error", Image.DecompressionBombWarning)
            picture = Image.open(io.BytesIO(body))
        return pixels_of(picture, alpha=bool(picture.has_transparency_data))
    except UnidentifiedImageError:
        return None
    except (Image.DecompressionBombError, Image.DecompressionBombWarning):
        raise GltfError(f"{name} is too large; at most {MAX_TEXTURE_PIXELS} pixels are read: shrink it") from None
    except GltfError as error:
        raise GltfError(f"{name} {error}") from None
    except (OSError, ValueError, SyntaxError) as error:
        raise GltfError(f"{name} is damaged ({error}); export it again") from None


def pixels_of(picture: Any, alpha: bool = False) -> NDArray[np.uint8]:  # noqa: ANN401
    """Return the bytes of a picture of Pillow's, ``(H, W, 3)``, or with ``alpha`` ``(H, W, 4)``.

    Raises
    ------
    GltfError
        Where it is too large.
    """
    width, height = picture.size
    if width * height > MAX_TEXTURE_PIXELS:
        raise GltfError(f"has {width}×{height} pixels; at most {MAX_TEXTURE_PIXELS} are read: shrink it")
    if picture.mode.startswith("I;16"):
        # Pillow cuts what is above 255 off, instead of scaling it.
        grey = np.round(np.asarray(picture).astype(np.float32) / 257).astype(np.uint8)
        return np.repeat(grey[:, :, None], 3, axis=2)
    return np.asarray(picture.convert("RGBA" if alpha else "RGB"))
