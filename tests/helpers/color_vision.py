"""Colors as people with and without color blindness see them."""
import numpy as np
from skimage.color import rgb2lab

# Severity 1 of the three kinds of color blindness, in linear RGB [machado2009].
KINDS = {
    "none": np.eye(3),
    "protanopia": [[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216], [-0.003882, -0.048116, 1.051998]],
    "deuteranopia": [[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413], [-0.011820, 0.042940, 0.968881]],
    "tritanopia": [[1.255528, -0.076749, -0.178779], [-0.078411, 0.930809, 0.147602], [0.004733, 0.691367, 0.303900]],
}


def seen(colors: np.ndarray, kind: str) -> np.ndarray:
    """CIE Lab (n, 3) of colors (n, 3) in sRGB, 0..1."""
    colors = np.asarray(colors, float)
    linear = np.where(colors <= 0.04045, colors / 12.92, ((colors + 0.055) / 1.055) ** 2.4)
    mixed = np.clip(linear @ np.array(KINDS[kind]).T, 0.0, 1.0)
    return rgb2lab(np.where(mixed <= 0.0031308, 12.92 * mixed, 1.055 * mixed ** (1 / 2.4) - 0.055)[None])[0]
