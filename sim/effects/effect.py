"""The contract of an effect."""


class Effect:
    """Base of all effects; a subclass overrides only the hooks it uses."""

    name: str
    Parameters: type
