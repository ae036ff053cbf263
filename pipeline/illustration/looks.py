"""What the parts of an illustration look like: linear shares of light, red green blue, and liquids by scattering.

Colors of the liquids and tissues are chosen. Oil and aqueous differ as in every other picture: ivory and blue.
"""
import dataclasses

Color = tuple[float, float, float]


@dataclasses.dataclass(frozen=True)
class Tissue:
    """An opaque surface; ``gloss`` is the share of a clear coat, ``opacity`` below 1 lets light through."""

    color: Color
    gloss: float = 0.0
    opacity: float = 1.0


@dataclasses.dataclass(frozen=True)
class Medium:
    """A liquid that scatters: ``density`` per mm, ``albedo`` the share that goes on at every scattering."""

    density: float
    albedo: Color


@dataclasses.dataclass(frozen=True)
class Look:
    """How an eye is shown.

    Attributes
    ----------
    media : of "oil", "aqueous" and "lens".
    skin : of the interface.
    sheen : share of light that the faces of liquids on the cut reflect.
    whole : whether the oil is a whole body of glass, uncut, in air.
    noise : how many times as many paths of light it needs. Only where that is 1 the denoiser looks at what is behind
        the liquids.
    oil : its color in a legend, where that is not that of other pictures.
    interface : its color in a legend: what it looks like through the liquids.
    """

    media: dict[str, Medium]
    skin: Tissue
    sheen: float = 0.035
    whole: bool = False
    noise: int = 1
    oil: str | None = None
    interface: str = "#b8aeac"

    @property
    def clear(self) -> bool:
        """Whether what lies behind the liquids is seen."""
        return self.skin.opacity < 0.5


TISSUES = {
    "sclera": Tissue((0.78, 0.74, 0.66), 0.15),
    "choroid": Tissue((0.26, 0.045, 0.035)),
    "retina": Tissue((0.85, 0.46, 0.28)),
    "ciliary": Tissue((0.21, 0.105, 0.07)),
    "ciliary_cut": Tissue((0.38, 0.20, 0.135)),
    "nerve": Tissue((0.68, 0.58, 0.42), 0.1),
    "iris": Tissue((0.3, 0.2, 0.1), 0.1),
    "iris_back": Tissue((0.10, 0.06, 0.04)),
    "iris_cut": Tissue((0.24, 0.15, 0.09)),
    "zonule": Tissue((0.80, 0.78, 0.72)),
    "haptic": Tissue((0.15, 0.30, 0.62), 0.5),
    "cornea_cut": Tissue((0.62, 0.78, 0.90), 0.2, 0.75),
    "lens_cut": Tissue((0.86, 0.84, 0.76), 0.1, 0.35),
    "lens": Tissue((0.86, 0.84, 0.76), 0.4, 0.45),
}
LOOKS = {
    "illustration": Look(
        {"oil": Medium(0.05, (1.0, 0.99, 0.94)), "aqueous": Medium(0.34, (0.20, 0.60, 0.97)),
         "lens": Medium(0.16, (0.995, 0.985, 0.95))},
        Tissue((0.93, 0.87, 0.70), 0.6, 0.28)),
    "paper": Look(
        {"oil": Medium(0.9, (0.999, 0.999, 0.999)), "aqueous": Medium(0.5, (0.12, 0.45, 0.97)),
         "lens": Medium(0.16, (0.995, 0.985, 0.95))},
        Tissue((0.92, 0.92, 0.92), 0.4, 0.9), noise=4, oil="#ffffff", interface="#dcdcde"),
    "glass": Look(
        {"oil": Medium(0.022, (0.55, 0.42, 0.0)), "lens": Medium(0.16, (0.995, 0.985, 0.95))},
        Tissue((0.93, 0.87, 0.70), 0.6, 0.28), whole=True, noise=12),
}
