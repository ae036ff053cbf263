"""Compare a run with its crate, here or on another computer: what is missing, changed, added, or of older code.

    python -m pipeline.verify outputs/tiny/draft
    python -m pipeline.verify tiny_draft.zip

Every file is read and its SHA-256 compared with that in ro-crate-metadata.json, which the run has written as its last
file. The folder may have been moved, renamed or packed as ZIP. Each difference is one sentence. The code that made the
run is compared with this code as well; --any-code leaves that out.

Exit codes: 0 nothing differs, 1 something does, 2 there is nothing to compare.
"""
from pathlib import Path

from pipeline.base.cli import run, stage_parser
from pipeline.base.words import memory, printable
from pipeline.provenance.differences import compare, counted
from pipeline.provenance.places import place_of
from sim.cores import available_cores

DIFFERS = 1
LONGEST = 1000  # letters of a line


def main(arguments: list[str] | None = None) -> int:
    """Run the command; see ``--help``."""
    parser = stage_parser("verify", __doc__)
    parser.add_argument("folder", type=Path, metavar="FOLDER",
                        help="a run with its crate: outputs/<scene>/<level>, a copy of it, or a ZIP archive of that")
    parser.add_argument("--any-code", action="store_true",
                        help="do not compare the code that made the run with this one")
    options = parser.parse_args(arguments)
    found = compare(place_of(options.folder), available_cores(), code=not options.any_code)
    for sentence in found.differences:
        print(printable(sentence, LONGEST))
    told, count = found.recorded, len(found.recorded.files)
    run_told = f"{told.scene} at {told.level}, {memory(found.size)}, crate by version {told.version}"
    if found.differences:
        print(f"{options.folder}: {counted(len(found.differences), 'difference')} from the crate; {found.whole:,} of "
              f"{counted(count, 'file')} are as it says ({run_told})")
        return DIFFERS
    print(f"{options.folder}: nothing differs from the crate, {counted(count, 'file')} are as it says ({run_told})")
    return 0


if __name__ == "__main__":
    run(main)
