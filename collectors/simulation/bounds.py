"""Bounds of the numbers in a configuration, checked when a configuration is read from a file of unknown origin.

The bounds reach far beyond sensible values, but they are finite, so that no number can make a simulation run for ever
or take all memory.
"""

from typing import Annotated

from msgspec import Meta

Finite = Annotated[float, Meta(ge=-1e6, le=1e6)]
NotNegative = Annotated[float, Meta(ge=0.0, le=1e9)]
Positive = Annotated[float, Meta(ge=1e-9, le=1e9)]
Share = Annotated[float, Meta(ge=0.0, le=1.0)]
Count = Annotated[int, Meta(ge=1, le=1000)]
Pixels = Annotated[int, Meta(ge=1, le=4096)]
Vector3 = tuple[float, float, float]
Nanoseconds = Annotated[int, Meta(ge=1000, le=100_000_000)]
Degrees = Annotated[float, Meta(ge=0.0, le=180.0)]

Point = tuple[Finite, Finite, Finite]
Color = tuple[Share, Share, Share]
Range = tuple[Finite, Finite]
PositiveRange = tuple[Positive, Positive]
