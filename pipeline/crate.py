"""Stage: the RO-Crate of a run, by which `python -m pipeline.verify` checks it elsewhere.

    python -m pipeline.crate outputs/tiny/draft

It names scene, code, computer, the jobs with their times, and the SHA-256 of every result, after the profile Provenance
Run Crate 0.5. Beside it the folder `workflow` gets the rules by which the run was made.
"""
from pathlib import Path

from pipeline.base.cli import run, stage_parser
from pipeline.base.files import replacing_folder, write_text
from pipeline.provenance.crate import WORKFLOW, copied_rules, crate_of
from pipeline.runs.contents import CRATE
from pipeline.runs.run_folder import RunFolder


def main(arguments: list[str] | None = None) -> None:
    """Run the stage; see ``--help``."""
    parser = stage_parser("crate", __doc__)
    parser.add_argument("folder", type=Path, metavar="FOLDER",
                        help="results of a level, outputs/<scene>/<level>; to be called where the scene was run, since "
                             "Snakemake's notes are there")
    parser.add_argument("--threads", type=int, default=1, metavar="N", help="that read files (default: 1)")
    options = parser.parse_args(arguments)
    made = RunFolder(options.folder)
    scene = made.scene
    with replacing_folder(options.folder / str(WORKFLOW)) as partial:
        for path, text in copied_rules().items():
            write_text(partial / path.relative_to(WORKFLOW), text)
    write_text(options.folder / CRATE, crate_of(made, options.threads))
    print(f"{scene.name}: {options.folder / CRATE} tells how the run was made; check it anywhere by python -m "
          f"pipeline.verify {options.folder}")


if __name__ == "__main__":
    run(main)
