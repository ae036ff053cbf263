"""What a stage depends on: a digest of the code it uses and of the part of the scene it reads.

Snakemake keeps the digest of every finished job as a parameter, and runs the job again when it changes. Comments,
docstrings and layout do not count (``pipeline.base.digest``).
"""
import dataclasses
import json
from collections.abc import Iterable

from pipeline.base.digest import code_used, shortened
from pipeline.scenes.model import Scene

ASKED = ("allowed_time", "output.allowed_frames")  # answers to questions, read by no results
WORDS = ("title", "description", "label")
PLACES = ("breaks", "regions")  # of the wall: measured and drawn
ENDS = ("output.duration", "output.until_rest")  # frames that are there already stay as they are
PICTURE = ("output.cell_ratio", "output.contour", "output.kernel", "output.smoothing_length", "output.image_size",
           "output.formats", "output.second_means")
COLORS = ("liquids.color", "liquids.source")
LOOKS = (*COLORS, "liquids.clear", "eye.side")  # what is clear tells which liquid is the oil
ILLUSTRATED = ("description", "accuracy", "start_from", "initial", "blocks", "schemes", "numerics", *ENDS,
               *(key for key in PICTURE if key != "output.second_means"), "liquids.source", *PLACES)
# What a stage does not read of the scene, so that a new color or a longer duration does not cost a simulation.
UNREAD = {
    "advise": ("description", "label", *PICTURE, *COLORS, "eye.side", "breaks"),
    "estimate": ("description", "label", *LOOKS, *PLACES),
    "cost": ("description", "label", *LOOKS, *PLACES),
    "eye": (*WORDS, "accuracy", "start_from", "initial", "blocks", "effects", "schemes", "numerics", "output",
            "liquids", "eye.side", *PLACES),
    "voxelize": (*WORDS, "accuracy", "start_from", "schemes", "output", *LOOKS, *PLACES),
    "simulate": (*WORDS, "accuracy", *ENDS, *PICTURE, *LOOKS, *PLACES),
    "reconstruct": (*WORDS, "accuracy", "start_from", "initial", "schemes", *ENDS, "output.image_size",
                    "output.second_means", *COLORS, *PLACES),
    "bodies": ("description", "label", "accuracy", "start_from", "initial", "blocks", "effects", "schemes", "output",
               *LOOKS, *PLACES),
    "index_run": ("description", "label", "start_from", "initial", "blocks", "effects", "schemes", "liquids.source",
                  "output"),
    "effect_costs": ("description", "label", "start_from", "initial", "blocks", "eye", "container", "schemes",
                     "liquids", "output", *PLACES),
    "render": ("accuracy", "start_from", "initial", "blocks", "schemes", *ENDS),
    "still": ILLUSTRATED,
    "illustrate": (*ILLUSTRATED, "liquids.color"),  # in an eye they are always the same
    "turntable": (*ILLUSTRATED, "liquids.color"),
    "movie": (*WORDS, "accuracy", "start_from", "initial", "blocks", "effects", "schemes", "eye", "container",
              "liquids", "numerics", "dimension", *ENDS, *PLACES,
              *(key for key in PICTURE if key != "output.second_means")),
    "rest": (*WORDS, "accuracy", "start_from", "initial", "blocks", "schemes", *PICTURE, *COLORS, *PLACES),
    "metrics": ("label", "accuracy", "start_from", "initial", "blocks", "schemes", *ENDS,
                *(key for key in PICTURE if key != "output.second_means"), *COLORS),
}


def stage_digest(stage: str, scene: Scene | None = None) -> str:
    """Return the digest of ``python -m pipeline.<stage>`` for a scene: a new one means that its results may differ.

    Parameters
    ----------
    stage : name of the module in ``pipeline``.
    scene : the scene it works on; ``None`` for a stage that reads no scene.
    """
    chosen = {*scene.effects, scene.numerics.scheme} if scene else set()
    read = json.dumps(_part_read(scene, UNREAD.get(stage, ())), sort_keys=True) if scene else ""
    return shortened(code_used(f"pipeline.{stage}", chosen), read)


def outdated(made: Iterable[tuple[str, Iterable[str]]], scene: Scene) -> list[str]:
    """Return the stages whose results this code would make otherwise, of this scene.

    Parameters
    ----------
    made : stage and digests of jobs, as they were when these ran; one without digests tells nothing.
    """
    return sorted({stage for stage, digests in made
                   if (then := {*digests}) and not {stage_digest(stage, scene), stage_digest(stage)} & then})


def _part_read(scene: Scene, unread: Iterable[str]) -> dict:
    """The values of a scene without the keys in ``unread``; ``liquids.color`` means the color of every liquid.

    Parameters of schemes that are not chosen are not read by any stage. Landmarks turn a mesh as its side says, and an
    image may tell another side.
    """
    values = json.loads(json.dumps(dataclasses.asdict(scene)))
    if scene.eye is not None and (scene.eye.landmarks is not None or scene.eye.label is not None):
        unread = [key for key in unread if key != "eye.side"]
    values["schemes"] = values["schemes"].get(scene.numerics.scheme)
    for key in (*ASKED, *unread):
        first, _, second = key.partition(".")
        if not second:
            values.pop(first)
        else:
            for record in values[first] if isinstance(values[first], list) else [values[first] or {second: None}]:
                record.pop(second)
    return values
