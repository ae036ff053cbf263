"""Parameters of effects and numerics: frozen dataclasses whose fields carry unit, range and meaning.

The metadata is the single source for validation (``pipeline.scene``), the JSON schema and the documentation.
"""
import dataclasses
from collections.abc import Iterable
from typing import Any


def parameter(
    default: Any = dataclasses.MISSING,
    *,
    meaning: str,
    unit: str = "",
    minimum: float | None = None,
    maximum: float | None = None,
    exclusive_minimum: float | None = None,
    choices: Iterable[str | int] | None = None,
    longest: int | None = None,
    liquid: bool = False,
    reason: str = "",
    file: str = "",
):
    """Declare one parameter of an effect or of the numerics.

    Parameters
    ----------
    default : value in SI, optional; without one the parameter is required in the scene file.
    meaning : one phrase in physics words, shown by the documentation and by error messages.
    unit : SI unit in pint's spelling ("m", "Pa s", "N/m", "rad"); "" for a pure number.
    minimum, maximum, exclusive_minimum : allowed range in that unit (of every component of a point).
    choices : the allowed words, for a parameter that is a word.
    longest : of a text for people: most characters. Spaces and line breaks in it become one space each.
    liquid : True where the value names one of the scene's liquids.
    file : kind of file that may be named in place of its values (``pipeline.scenes.value_files``).
    reason : why it cannot be left out, where its meaning does not say so.
    """
    metadata = {
        "meaning": meaning, "unit": unit, "minimum": minimum, "maximum": maximum,
        "exclusive_minimum": exclusive_minimum, "choices": tuple(choices) if choices else None, "longest": longest,
        "liquid": liquid, "reason": reason, "file": file,
    }
    if isinstance(default, (list, dict)):
        raise TypeError("a parameter's default must be immutable")
    return dataclasses.field(default=default, metadata=metadata)
