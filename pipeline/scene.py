"""Stage: a scene file in YAML becomes a resolved scene in SI units with every default filled in."""
import sys
from pathlib import Path

from pipeline.base.cli import run, stage_parser
from pipeline.base.files import write_text
from pipeline.cavity.surface import cavity_volume
from pipeline.scenes.checks import doubts
from pipeline.scenes.description import postures_in_words
from pipeline.scenes.effects import OFF
from pipeline.scenes.folders import scene_file, scene_paths
from pipeline.scenes.listing import entries_of, markdown_of, text_of
from pipeline.scenes.load import PROJECT_CONFIG, load_accuracy_levels, load_scene
from pipeline.scenes.materials import load_materials
from pipeline.scenes.reader import dotted
from pipeline.scenes.schema import list_text, schema_text
from pipeline.scenes.timeline import timeline_in_words


def _write(text: str, output: Path | None) -> None:
    """Write ``text`` to a file, or to standard output."""
    if output is None:
        sys.stdout.write(text)
    else:
        write_text(output, text)


def main(arguments: list[str] | None = None) -> None:
    """Run the stage; see ``--help``."""
    parser = stage_parser("scene", __doc__, epilog=f"{OFF}.")
    parser.add_argument("scene", type=scene_file, nargs="?", help="scene, by its name or file")
    parser.add_argument("--accuracy", help="accuracy level (default: `accuracy` of config.yaml)")
    parser.add_argument("--config-dir", type=Path, help="folder of materials.yaml and accuracy.yaml (default: config)")
    parser.add_argument("--output", type=Path, help="file to write (default: standard output)")
    action = parser.add_mutually_exclusive_group()
    action.add_argument("--check", action="store_true", help="only check the scene, and tell what is done when")
    action.add_argument("--schema", action="store_true", help="write the JSON schema of scene files, for editors")
    action.add_argument("--list", action="store_true", help="describe effects, liquids and accuracy levels")
    action.add_argument("--scenes", action="store_true",
                        help="list the scenes that there are, a line for each; as a page if --output ends in .md")
    options = parser.parse_args(arguments)
    config_dir = options.config_dir or PROJECT_CONFIG
    if options.schema or options.list:
        materials = load_materials(config_dir / "materials.yaml")
        levels = load_accuracy_levels(config_dir / "accuracy.yaml")
        _write(schema_text(materials) if options.schema else list_text(materials, levels), options.output)
        return
    if options.scenes:
        folder = config_dir / "scenes"
        entries = entries_of(scene_paths(folder), folder)
        page = options.output is not None and options.output.suffix == ".md"
        _write(markdown_of(entries, load_materials(config_dir / "materials.yaml")) if page else text_of(entries),
               options.output)
        return
    if options.scene is None:
        parser.error("name a scene, or use --scenes, --list or --schema")
    scene = load_scene(options.scene, options.accuracy, options.config_dir)
    for key, sentence in doubts(scene):
        print(f"warning: {options.scene}: {dotted(key)} {sentence}", file=sys.stderr)
    if not options.check:
        _write(scene.to_json(), options.output)
    if options.check and (timeline := timeline_in_words(scene, cavity_volume)):
        print(f"{scene.name}: {timeline}")  # a turn may be inherited
    elif options.output is not None and (postures := postures_in_words(scene)):
        print(f"{scene.name}: {postures}")  # a turn may be inherited


if __name__ == "__main__":
    run(main)
