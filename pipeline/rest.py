"""Stage: whether a scene is at rest after a segment, so that one that ends at rest needs no more of them.

The covered share of the retina is measured in the frames of the last seconds, and must hardly change; an injection, a
turn or a saccade that is to come, or was not long ago, keeps the scene going.
"""
import json
from collections.abc import Sequence
from pathlib import Path

from pipeline.base.cli import run, stage_parser
from pipeline.base.files import write_text
from pipeline.base.frame_files import frames_of
from pipeline.base.sequences import FRAMES_AGAIN
from pipeline.cavity.initial_state import load_initial
from pipeline.measures.events import events_of
from pipeline.measures.rest import at_rest, course_of_coverage, rest_in_words
from pipeline.runs.segments import check_segments
from pipeline.scenes.load import load_resolved


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the stage; see ``--help``."""
    parser = stage_parser("rest", __doc__)
    parser.add_argument("scene", type=Path, help="resolved scene (scene.json)")
    parser.add_argument("initial", type=Path, help="particles and signed distance of the voxelize stage (initial.npz)")
    parser.add_argument("folders", type=Path, nargs="+", metavar="frames", help="folders of frames, from the start on")
    parser.add_argument("--output", type=Path, required=True, metavar="FILE.json", help="file to write")
    options = parser.parse_args(arguments)
    scene, initial = load_resolved(options.scene), load_initial(options.initial)
    paths = frames_of(options.folders)
    check_segments(scene, paths, FRAMES_AGAIN)
    table = course_of_coverage(scene, initial, paths)
    events = events_of(scene, table, float(initial["cavity_volume"]))
    said = rest_in_words(table, events, ended=False) or "not known yet whether it is at rest"
    record = {"at_rest": at_rest(table, events), "time": float(table["time [s]"][-1]), "said": said}
    write_text(options.output, json.dumps(record, indent=1) + "\n")
    print(f"{scene.name}, after {record['time']:g} s: {said}", flush=True)


if __name__ == "__main__":
    run(main)
