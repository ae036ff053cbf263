"""Stage: the closed surface of the cavity: a parametric eye, a user's mesh, or a container."""
import json
from pathlib import Path

from pipeline.base.cli import run, stage_parser
from pipeline.base.errors import UserError
from pipeline.base.files import write_text
from pipeline.cavity.mesh_import import MeshRefused
from pipeline.cavity.surface import cavity_mesh, report_of, volume_in_words, write_container, write_mesh
from pipeline.pictures.defect_picture import picture_of_defect
from pipeline.scenes.load import load_resolved


def main(arguments: list[str] | None = None) -> None:
    """Run the stage; see ``--help``."""
    parser = stage_parser("eye", __doc__)
    parser.add_argument("scene", type=Path, help="resolved scene (scene.json)")
    parser.add_argument("--output", type=Path, required=True, help="surface to write (eye.vtp)")
    parser.add_argument("--report", type=Path, required=True, help="report to write (eye.json)")
    parser.add_argument("--picture", type=Path, help="picture of a defect that cannot be repaired "
                                                     "(default: eye_defects.png beside the report)")
    options = parser.parse_args(arguments)
    picture = options.picture or options.report.with_name("eye_defects.png")
    scene = load_resolved(options.scene)
    if scene.container is not None:
        report = write_container(scene.container, options.output)
        write_text(options.report, json.dumps(report, indent=2) + "\n")
        print(f"container of {' x '.join(f'{side:g}' for side in scene.container.size)} m")
        return
    try:
        mesh, source = cavity_mesh(scene.eye)
    except MeshRefused as refused:
        raise UserError(f"{refused}; {picture_of_defect(refused.mesh, refused.segments, picture)}") from refused
    report = report_of(mesh, source)
    write_mesh(mesh, options.output, scene.eye)
    write_text(options.report, json.dumps(report, indent=2) + "\n")
    picture.unlink(missing_ok=True)
    for sentence in report.get("repairs", ()):
        print(f"repair: {sentence}")
    for sentence in report.get("warnings", ()):
        print(f"warning: {sentence}")
    for sentence in report.get("orientation", ()):
        print(f"orientation: {sentence}")
    print(f"{volume_in_words(report)}; {report['triangles']} triangles")


if __name__ == "__main__":
    run(main)
