"""From a scene file to frames, surfaces, pictures, a movie and a report.

    snakemake -j2 all                                       the scenes of config/config.yaml at its accuracy level
    snakemake -j2 <scene>                                   one scene (docs/scenes.md) at that level
    snakemake -j2 outputs/<scene>/<level>/index.html        any scene at any level, on one page
    snakemake -j2 explorer                                  what oil touches by fill and posture, on one page
    snakemake -j2 validation                                a study of config/studies: table, figures, page
    snakemake -j2 results                                   every number of docs/results; results_small: without long runs
    snakemake -j2 all --config accuracy=standard            finer; also 'scenes=[still_eye]', device=cuda
    snakemake -j2 outputs/<scene>/compare_draft_standard.html   what the finer level changes
    snakemake -j2 -R render                                 a stage once more
    snakemake --report report.html                          one page to read and to pass on

The rules are in rules/. Every rule calls one stage, `python -m pipeline.<stage>`. A stage runs again when `depends` changes: a digest of the code
and of the part of the scene that it uses. Therefore the date of `scene.json` does not matter (`ancient`).
A stage writes what it took where STAGE_USAGE says, for the page of costs.
"""

import os
import sys

sys.path.insert(0, workflow.basedir)
os.environ["PATH"] = os.path.dirname(sys.executable) + os.pathsep + os.environ["PATH"]

from pipeline.workflow.digest import stage_digest
from pipeline.workflow.interrupt import Interrupt
from pipeline.workflow.scenes import Workflow, room_texts, scene_names
from pipeline.workflow.shell import PREFIX
from pipeline.workflow.studies import Studies
from pipeline.workflow.targets import refuse_impossible
from studies.results.workflow import Results


configfile: "config/config.yaml"


report: "docs/report/workflow.rst"


shell.prefix(PREFIX)


def rested(scene, level, segment):
    """Return the file that says whether a scene is at rest after a segment: what follows is planned when it is there."""
    return checkpoints.rest.get(scene=scene, level=level, segment=segment).output[0]


flow = Workflow(config, workflow.resource_settings.max_threads is not None, rested)
studies = Studies(flow)
results = Results(studies)
interrupt = Interrupt(logger)
SCENE = ancient("outputs/{scene}/{level}/scene.json")
FRAMES = "outputs/{scene}/{level}/frames/segment_{segment}"
IMAGES = "outputs/{scene}/{level}/images/segment_{segment}"


SHELF = {"category": "{scene}", "subcategory": "{level}"}  # where the report has a file


wildcard_constraints:
    scene=r"[A-Za-z0-9_-]+",
    level=flow.any_level,
    levels=rf"({flow.any_level})(_({flow.any_level}))+",
    segment=r"\d\d\d+",


def cores():
    """Return the cores that a job may have: --max-threads, which the profiles of clusters give, else all that are here.

    Where nothing is run, as for --report, nobody says how many.
    """
    return workflow.resource_settings.max_threads or workflow.resource_settings.cores or 1


def all_segments(pattern):
    """Return the function of wildcards that names the file of every segment of a scene."""
    return lambda w: expand(pattern, scene=w.scene, level=w.level, segment=flow.segments(w.scene, w.level))


onstart:
    flow.prepare_outputs()


onsuccess:
    flow.tell_pages()


onerror:
    if interrupt.happened:
        print("stopped; the same command goes on from here", flush=True)
    else:
        flow.repeat_errors()
        studies.tell_so_far()


# On a cluster these are not worth a job.
localrules:
    scene,
    index_frames,
    rest,
    effect_costs,
    cost,
    crate,
    software,
    explorer,


rule all:
    input:
        flow.wanted(flow.names),
        "outputs/software.html",
    message:
        "all done: {input}"


include: "rules/cavity.smk"
include: "rules/forecast.smk"
include: "rules/simulation.smk"
include: "rules/surfaces.smk"
include: "rules/pictures.smk"
include: "rules/measures.smk"
include: "rules/pages.smk"
include: "rules/explorer.smk"
include: "rules/refusals.smk"
include: "rules/studies.smk"
include: "rules/software.smk"
include: "rules/results.smk"


# `snakemake <scene>` makes all of a scene, but of one that has the name of a rule or a study.
for name in scene_names():
    if not workflow.is_rule(name):

        rule:
            name:
                name
            input:
                flow.wanted([name]),
            message:
                "all done: {input}"


refuse_impossible(flow, workflow.resource_settings.cores, workflow.rules, sys.argv[1:])
