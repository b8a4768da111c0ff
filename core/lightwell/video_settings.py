"""How the signal of a video file stands for light: typed, bounded, described."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from lightwell.settings import Settings

Transfer = Literal["pq", "hlg", "linear"]
Matrix = Literal["rgb", "bt601", "bt709", "bt2020"]
Primaries = Literal["bt709", "bt2020"]
Range = Literal["limited", "full"]

REFERENCE_WHITE = 203.0
"""Luminance of reference white, cd/m² (ITU-R BT.2408)."""


class VideoSettings(Settings):
    """What a file is tagged with need not be said."""

    transfer: Transfer | None = Field(None, description="transfer function: pq, hlg or linear")
    matrix: Literal["bt601", "bt709", "bt2020"] | None = Field(None, description="YCbCr matrix")
    primaries: Primaries | None = Field(None, description="primaries: bt709 or bt2020; the result is Rec. 709")
    range: Range | None = Field(None, description="range of the codes: limited or full")
    white: float = Field(REFERENCE_WHITE, gt=0, description="pq: luminance that becomes 1.0, cd/m²")
