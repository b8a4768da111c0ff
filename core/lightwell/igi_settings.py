"""What a picture by virtual point lights may be asked for (`lightwell.igi`): typed, bounded, described."""

from __future__ import annotations

import re
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field
from pydantic_core import PydanticCustomError

from lightwell.settings import Settings

IgiFilter = Literal["sh", "irradiance", "irradiance-strict", "none"]
IgiKernel = Literal["nonneg", "none"]
IgiLayer = Literal["normal", "depth", "albedo", "direct", "indirect", "set", "coefficients"]

MAX_SETS_SIDE = 16
MAX_VIRTUAL_LIGHTS = 1 << 18
MAX_BOUNCES = 16
Side = Annotated[int, Field(ge=1, le=MAX_SETS_SIDE)]


def _sets(value: Any) -> Any:  # noqa: ANN401
    """Take ``4x4`` and ``[4, 4]``."""
    if isinstance(value, str):
        found = re.fullmatch(r"(\d{1,4})[x×](\d{1,4})", value)
        if found is None:
            raise PydanticCustomError("sets", "must be written like 4x4")
        return int(found[1]), int(found[2])
    return value


class IgiSettings(Settings):
    """Instant global illumination with filtered incident radiance (paper 004; MATHS §10)."""

    sets: Annotated[
        tuple[Side, Side],
        BeforeValidator(_sets, json_schema_input_type=str | tuple[int, int]),
    ] = Field((4, 4), description="sets of virtual lights, interleaved over so many pixels along x and y, like 4x4")
    vpls: int = Field(
        1024, ge=1, le=MAX_VIRTUAL_LIGHTS, description="virtual lights, all sets together; punctual lights come on top"
    )
    bands: int = Field(3, ge=2, le=5, description="SH bands of the incident radiance; bands² coefficients a pixel")
    bounces: int = Field(6, ge=0, le=MAX_BOUNCES, description="how often light is reflected on its way to a surface")
    clamp: float = Field(
        1.0,
        ge=0,
        le=16,
        description="a virtual light adds no more than if it faced the surface from so many radii of the disc that it"
        " stands for; against bright spots in corners, which it darkens; 0: no bound",
    )
    filter: IgiFilter = Field(
        "sh",
        description="what is averaged over neighbouring pixels: incident radiance (sh), or irradiance, regardless of"
        " shading normals or (irradiance-strict) where they agree, or nothing (none)",
    )
    window: int = Field(1, ge=1, le=4, description="width of the filter, in widths of the pattern of sets")
    passes: int = Field(
        2,
        ge=1,
        le=3,
        description="how often the filter goes over the picture: 1 is the paper's box, which shows as squares near"
        " virtual lights, 2 a tent",
    )
    kernel: IgiKernel = Field(
        "nonneg",
        description="of matte surfaces: for light from above, never negative (nonneg), or the cosine's bands (none)",
    )
    seed: int = Field(0, ge=0, le=2**31 - 1, description="of the random numbers; the same seed gives the same bytes")
    layers: tuple[IgiLayer, ...] = Field(
        ("normal", "depth", "albedo", "direct", "indirect", "set"), description="what is kept besides the colour"
    )

    def samples(self, wanted: int) -> int:
        """Return N where a pixel is to be the mean of N² rays: only incident radiance can be shared by several."""
        return wanted if self.filter == "sh" else 1
