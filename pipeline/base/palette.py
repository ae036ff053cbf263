"""Colors of curves: those of Okabe and Ito, told apart by people with any of the three kinds of color blindness."""

COLORS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#000000")
DASHES = ("-", "--", "-.", ":")


def curve_style(number: int) -> dict[str, str]:
    """Return color and dashes of a curve, counted from 0: neighbors in a legend differ in both."""
    return {"color": COLORS[number % len(COLORS)], "linestyle": DASHES[number % len(DASHES)]}
