"""Numbers and texts as people read them."""
import difflib
from collections.abc import Iterable, Sequence
from typing import Any

LONGEST = 80  # of a text in a message
# What else names in files and commands are called: in the clinic, in other languages, in other programs.
ALSO = {"upright": "sitting seated standing sit erect aufrecht sitzend debout assis",
        "supine": "face_up on_back on_the_back lying liegend rückenlage decubitus_supino",
        "prone": "face_down facedown on_belly bauchlage ventral", "left_side": "left links gauche linksseitig",
        "right_side": "right rechts droite rechtsseitig", "right": "od r rechts droite", "left": "os l links gauche",
        "pseudophakic": "iol artificial", "cuda": "gpu nvidia", "um": "µm μm micron microns micrometer micrometre",
        "mm": "millimeter millimetre millimeters", "in": "inch inches zoll", "air": "gas luft sf6 c3f8 c2f6",
        "aqueous": "wasser kammerwasser bss saline humor", "silicone_oil_1000": "oil silicone_oil silikonöl öl"}
NO_ADVICE = "This is an illustration of physics, not for decisions on a patient."


def duration(value: float) -> str:
    """Return a time, s, as people read it.

    >>> duration(8.25), duration(5400.0)
    ('8.25 s', '90 min')
    """
    for unit, size, limit in (("s", 1.0, 100.0), ("min", 60.0, 100.0), ("h", 3600.0, 72.0)):
        if value < limit * size:
            return f"{value / size:.3g} {unit}"
    return f"{value / 86400.0:.3g} days"


def memory(value: float) -> str:
    """Return a number of bytes as people read it.

    >>> memory(3 * 2**20)
    '3 MiB'
    """
    return f"{value / 2**20:.0f} MiB" if value < 2**30 else f"{value / 2**30:.3g} GiB"


def printable(text: str, longest: int = LONGEST) -> str:
    """Return a text of a file as a message shows it: in one line, without what steers a terminal, and not endless.

    >>> print(printable("two\\nlines"), printable("x" * 100, 3))
    two\\nlines xxx...
    """
    shown = text if len(text) <= longest else f"{text[:longest]}..."
    return "".join(one if one.isprintable() else one.encode("unicode_escape").decode() for one in shown)


def nearest(word: Any, names: Iterable[str]) -> str:
    """Return the name that is most like ``word`` as a question, or nothing.

    >>> nearest("viscosty", ["gravity", "viscosity"])
    ' (did you mean viscosity?)'
    """
    names = list(names)
    word = printable(str(word)).lower()
    plain = word.replace(" ", "_").replace("-", "_")
    for name in names:
        if plain == name.lower() or plain in ALSO.get(name, "").split():
            return f" (did you mean {name}?)"
    matches = difflib.get_close_matches(word, names, n=5)
    # Names of liquids differ by a digit: among the near ones take that with most letters in the same place.
    best = max(matches, key=lambda name: sum(map(str.__eq__, word, name)), default=None)
    return f" (did you mean {best}?)" if best else ""


def no_formula(text: str) -> str:
    """Return a text that matplotlib draws as it stands, be there dollar signs in it; its lines can be wrapped."""
    return text.replace("$", r"\$")


def in_a_row(words: Sequence[str]) -> str:
    """Return words in a row.

    >>> in_a_row(["draft", "standard", "fine"]), in_a_row(["draft"])
    ('draft, standard and fine', 'draft')
    """
    return " and ".join([*([", ".join(words[:-1])] if words[:-1] else []), *words[-1:]])


def columns(lines: Sequence[Sequence[str]]) -> list[str]:
    """Return the lines of a table as text, every column as wide as its longest cell.

    >>> columns([("oil", "fill"), ("light oil", "85 %")])
    ['oil        fill', 'light oil  85 %']
    """
    widths = [max(map(len, column)) for column in zip(*lines, strict=True)]
    return ["  ".join(cell.ljust(width) for cell, width in zip(line, widths, strict=True)).rstrip() for line in lines]
