"""Which liquids of a scene are shown as bodies, and in which one, in every picture, view and file of surfaces."""
from pipeline.scenes.effects import droplets_of
from pipeline.scenes.model import Material, Scene


def liquid_around(scene: Scene) -> Material | None:
    """Return the liquid in which the others are shown: the first clear one, else in an eye the first of several.

    None where there is none: in a container of liquids with colors all of them are to be seen.
    """
    first = scene.liquids[0] if scene.container is None and len(scene.liquids) > 1 else None
    return next((liquid for liquid in scene.liquids if liquid.clear), first)


def shown_liquids(scene: Scene) -> list[Material]:
    """Return the liquids that are shown as bodies: all but the one around them, and what there is in droplets alone.

    Where a clear liquid is alone there is none.
    """
    droplets, around = droplets_of(scene), liquid_around(scene)
    return [liquid for index, liquid in enumerate(scene.liquids) if index != droplets and liquid is not around]
