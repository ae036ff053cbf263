"""From a scene file to frames, surfaces, pictures, a movie and a report.

    snakemake -j2 all                                       the scenes of config/config.yaml at its accuracy level
    snakemake -j2 outputs/<scene>/<level>/movie.mp4         any scene of config/scenes at any level
    snakemake -j2 validation                                a study of config/studies: table, figures, page
    snakemake -j2 all --config accuracy=standard            finer; also 'scenes=[still_eye]', device=cuda
    snakemake -j2 outputs/<scene>/compare_draft_standard.html   what the finer level changes
    snakemake -j2 -R render                                 a stage once more
    snakemake --report report.html                          one page to read and to pass on

Every rule calls one stage, `python -m pipeline.<stage>`. A stage runs again when `depends` changes: a digest of the code
and of the part of the scene that it uses. Therefore the date of `scene.json` does not matter (`ancient`).
A stage writes what it took where STAGE_USAGE says, for the page of costs.
"""
import os
import sys

sys.path.insert(0, workflow.basedir)
os.environ["PATH"] = os.path.dirname(sys.executable) + os.pathsep + os.environ["PATH"]

from pipeline.digest import stage_digest
from pipeline.workflow import Workflow


configfile: "config/config.yaml"
report: "docs/report/workflow.rst"


# Snakemake tells OpenMP and the like how many threads a job has; this tells VTK and the drawing without a GPU.
shell.prefix("set -euo pipefail; export VTK_SMP_MAX_THREADS=$OMP_NUM_THREADS LP_NUM_THREADS=$OMP_NUM_THREADS; ")

flow = Workflow(config)
SCENE = ancient("outputs/{scene}/{level}/scene.json")
FRAMES = "outputs/{scene}/{level}/frames/segment_{segment}"
IMAGES = "outputs/{scene}/{level}/images/segment_{segment}"


SHELF = {"category": "{scene}", "subcategory": "{level}"}  # where the report has a file


wildcard_constraints:
    scene=r"[A-Za-z0-9_-]+",
    level=flow.any_level,
    other=flow.any_level,
    segment=r"\d\d\d+",


def all_segments(pattern):
    """Return the function of wildcards that names the file of every segment of a scene."""
    return lambda w: expand(pattern, scene=w.scene, level=w.level, segment=flow.segments(w.scene, w.level))


onstart:
    flow.prepare_outputs()


onerror:
    flow.repeat_errors()


rule all:
    input:
        expand("outputs/{scene}/{level}/movie.mp4", scene=flow.names, level=flow.accuracy),
        expand("outputs/{scene}/{level}/metrics.csv", scene=flow.names, level=flow.accuracy),
        expand("outputs/{scene}/{level}/advice.html", scene=flow.names, level=flow.accuracy),
        expand("outputs/{scene}/{level}/effects.html", scene=flow.names, level=flow.accuracy),
        expand("outputs/{scene}/{level}/cost.html", scene=flow.names, level=flow.accuracy),
        expand("outputs/{scene}/{level}/frames/frames.pvd", scene=flow.names, level=flow.accuracy),
    message: "all done: {input}"


rule scene:
    output:
        report("outputs/{scene}/{level}/scene.json", **SHELF, caption="docs/report/scene.rst",
               labels={"what": "6 scene in SI units"}),
    log: "outputs/{scene}/{level}/logs/scene.log",
    message: "{wildcards.scene} at {wildcards.level}: check the scene",
    shell:
        "python -m pipeline.scene config/scenes/{wildcards.scene}.yaml --accuracy {wildcards.level} --output {output}"
        " 2>&1 | tee {log}"


rule eye:
    input:
        mesh=lambda w: flow.mesh(w.scene, w.level),
        scene=SCENE,
    output:
        mesh="outputs/{scene}/{level}/eye.vtp",
        report="outputs/{scene}/{level}/eye.json",
    params:
        depends=flow.depends("eye"),
    log: "outputs/{scene}/{level}/logs/eye.log",
    message: "{wildcards.scene} at {wildcards.level}: make the surface of the cavity",
    shell:
        "STAGE_USAGE={log}.json "
        "python -m pipeline.eye {input.scene} --output {output.mesh} --report {output.report} 2>&1 | tee {log}"


rule voxelize:
    input:
        scene=SCENE,
        eye="outputs/{scene}/{level}/eye.vtp",
    output:
        initial="outputs/{scene}/{level}/initial.npz",
        report="outputs/{scene}/{level}/voxelize.json",
    params:
        depends=flow.depends("voxelize"),
    log: "outputs/{scene}/{level}/logs/voxelize.log",
    message: "{wildcards.scene} at {wildcards.level}: fill the cavity with particles",
    threads: lambda w: flow.threads(w.scene, w.level, workflow.cores)
    shell:
        "STAGE_USAGE={log}.json "
        "python -m pipeline.voxelize {input.scene} {input.eye} --output {output.initial} --report {output.report}"
        " --threads {threads} {flow.device} 2>&1 | tee {log}"


rule advise:
    input:
        scene=SCENE,
        initial="outputs/{scene}/{level}/initial.npz",
    output:
        report("outputs/{scene}/{level}/advice.html", **SHELF, caption="docs/report/advice.rst",
               labels={"what": "7 advice: numbers, time scales, time step"}),
    params:
        depends=flow.depends("advise"),
    log: "outputs/{scene}/{level}/logs/advise.log",
    message: "{wildcards.scene} at {wildcards.level}: advise on the effects"
    shell:
        "python -m pipeline.advise {input.scene} --initial {input.initial} --format html --output {output}"
        " 2>&1 | tee {log}"


rule estimate:
    input:
        scene=SCENE,
        initial="outputs/{scene}/{level}/initial.npz",
        eye="outputs/{scene}/{level}/eye.vtp",
    output:
        page=report("outputs/{scene}/{level}/estimate.html", **SHELF, caption="docs/report/estimate.rst",
                    labels={"what": "9 estimate: time, memory, disk, error"}),
        levels="outputs/{scene}/{level}/estimate.json",
    params:
        depends=flow.depends("estimate"),
        start=lambda w: [f"--start {one}" for one in flow.start(w.scene, w.level, "000")],
        errors=flow.expected_errors(),
    log: "outputs/{scene}/{level}/logs/estimate.log",
    message: "{wildcards.scene} at {wildcards.level}: estimate time, memory and disk"
    threads: 1000  # as many as there are: nothing else runs while times are measured
    priority: 20  # before the simulation, which finds its kernels compiled
    shell:
        "python -m pipeline.estimate {input.scene} --made {input.eye} {input.initial} --cores {workflow.cores}"
        " {params.start} {flow.device} --output {output.page} --output {output.levels} 2>&1 | tee {log}"


rule cost:
    input:
        scene=SCENE,
        estimate="outputs/{scene}/{level}/estimate.json",
        metrics="outputs/{scene}/{level}/metrics.csv",
        images=all_segments(IMAGES),
    output:
        report("outputs/{scene}/{level}/cost.html", **SHELF, caption="docs/report/cost.rst",
               labels={"what": "9 cost: predicted and real"}),
    params:
        depends=flow.depends("cost"),
    log: "outputs/{scene}/{level}/logs/cost.log",
    message: "{wildcards.scene} at {wildcards.level}: compare what was predicted with what it has cost"
    shell:
        "python -m pipeline.cost {input.scene} {input.estimate} {input.metrics}"
        " --logs outputs/{wildcards.scene}/{wildcards.level}/logs --output {output} 2>&1 | tee {log}"


rule simulate:
    input:
        scene=SCENE,
        initial="outputs/{scene}/{level}/initial.npz",
        restart=lambda w: flow.start(w.scene, w.level, w.segment),
    output:
        frames=directory(FRAMES),
        checkpoint="outputs/{scene}/{level}/checkpoints/segment_{segment}.npz",
        costs="outputs/{scene}/{level}/costs/segment_{segment}.json",
    params:
        depends=flow.depends("simulate"),
        restart=lambda w, input: f"--restart {input.restart}" if input.restart else "",
        segment=lambda w: int(w.segment),
    log: "outputs/{scene}/{level}/logs/simulate_{segment}.log",
    message: "{wildcards.scene} at {wildcards.level}: simulate segment {wildcards.segment}",
    threads: lambda w: flow.threads(w.scene, w.level, workflow.cores)
    priority: 10  # everything waits for the simulation
    shell:
        "STAGE_USAGE={log}.json "
        "python -m pipeline.simulate {input.scene} {input.initial} --segment {params.segment} {params.restart}"
        " --frames {output.frames} --checkpoint {output.checkpoint} --costs {output.costs} --threads {threads}"
        " {flow.device} 2>&1 | tee {log}"


rule effects:
    input:
        scene=SCENE,
        costs=all_segments("outputs/{scene}/{level}/costs/segment_{segment}.json"),
    output:
        page=report("outputs/{scene}/{level}/effects.html", **SHELF, caption="docs/report/effects.rst",
                    labels={"what": "8 effects: memory, kernels, time"}),
        table=report("outputs/{scene}/{level}/effects.csv", **SHELF, caption="docs/report/effects.rst",
                     labels={"what": "8 effects (CSV)"}),
    params:
        depends=flow.depends("effects"),
    log: "outputs/{scene}/{level}/logs/effects.log",
    message: "{wildcards.scene} at {wildcards.level}: add up what the effects cost"
    shell:
        "python -m pipeline.effects {input.scene} {input.costs} --page {output.page} --table {output.table}"
        " 2>&1 | tee {log}"


rule index_frames:
    input:
        all_segments(FRAMES),
    output:
        "outputs/{scene}/{level}/frames/frames.pvd",
    params:
        depends=stage_digest("frames"),
    log: "outputs/{scene}/{level}/logs/index_frames.log",
    message: "{wildcards.scene} at {wildcards.level}: index the frames for ParaView",
    shell: "python -m pipeline.frames pvd {input} --output {output} 2>&1 | tee {log}"


rule reconstruct:
    input:
        scene=SCENE,
        initial="outputs/{scene}/{level}/initial.npz",
        frames=FRAMES,
    output:
        directory("outputs/{scene}/{level}/surfaces/segment_{segment}"),
    params:
        depends=flow.depends("reconstruct"),
    log: "outputs/{scene}/{level}/logs/reconstruct_{segment}.log",
    message: "{wildcards.scene} at {wildcards.level}: reconstruct the surfaces of segment {wildcards.segment}",
    shell:
        "STAGE_USAGE={log}.json "
        "python -m pipeline.reconstruct {input.scene} {input.initial} {input.frames} --output {output}"
        " --threads {threads} {flow.device} 2>&1 | tee {log}"


rule render:
    input:
        scene=SCENE,
        initial="outputs/{scene}/{level}/initial.npz",
        eye="outputs/{scene}/{level}/eye.vtp",
        frames=FRAMES,
        surfaces="outputs/{scene}/{level}/surfaces/segment_{segment}",
    output:
        report(directory(IMAGES), patterns=["frame_{frame}.png"],
               **SHELF, caption="docs/report/picture.rst", labels={"what": "5 picture of frame {frame}"}),
    params:
        depends=flow.depends("render"),
    log: "outputs/{scene}/{level}/logs/render_{segment}.log",
    message: "{wildcards.scene} at {wildcards.level}: draw segment {wildcards.segment}",
    shell:
        "STAGE_USAGE={log}.json "
        "python -m pipeline.render {input.scene} {input.initial} {input.eye} {input.frames} {input.surfaces}"
        " --output {output} 2>&1 | tee {log}"


rule movie:
    input:
        all_segments(IMAGES),
    output:
        report("outputs/{scene}/{level}/movie.mp4", **SHELF, caption="docs/report/movie.rst",
               labels={"what": "1 movie"}),
    params:
        depends=stage_digest("movie"),
    log: "outputs/{scene}/{level}/logs/movie.log",
    message: "{wildcards.scene} at {wildcards.level}: make the movie",
    shell: "python -m pipeline.movie {input} --output {output} --fps 24 2>&1 | tee {log}"


rule metrics:
    input:
        scene=SCENE,
        initial="outputs/{scene}/{level}/initial.npz",
        frames=all_segments(FRAMES),
    output:
        table=report("outputs/{scene}/{level}/metrics.csv", **SHELF, caption="docs/report/metrics.rst",
                     labels={"what": "3 metrics of every frame"}),
        summary=report("outputs/{scene}/{level}/metrics.html", **SHELF, caption="docs/report/metrics.rst",
                       labels={"what": "2 metrics in short"}),
        plots=report(directory("outputs/{scene}/{level}/plots"), patterns=["{plot}.png"], **SHELF,
                     caption="docs/report/plot.rst", labels={"what": "4 plot: {plot}"}),
    params:
        depends=flow.depends("metrics"),
    log: "outputs/{scene}/{level}/logs/metrics.log",
    message: "{wildcards.scene} at {wildcards.level}: measure and plot all frames",
    shell:
        "STAGE_USAGE={log}.json "
        "python -m pipeline.metrics {input.scene} {input.initial} {input.frames} --output {output.table}"
        " --summary {output.summary} --plots {output.plots} 2>&1 | tee {log}"


rule bodies:
    input:
        scene=SCENE,
        surfaces=all_segments("outputs/{scene}/{level}/surfaces/segment_{segment}"),
    output:
        table="outputs/{scene}/{level}/bodies.csv",
        plot=report("outputs/{scene}/{level}/bodies.png", **SHELF, caption="docs/report/bodies.rst",
                    labels={"what": "4 plot: bodies of the liquids"}),
    params:
        depends=flow.depends("bodies"),
    log: "outputs/{scene}/{level}/logs/bodies.log",
    message: "{wildcards.scene} at {wildcards.level}: count and measure the bodies of the liquids",
    shell:
        "python -m pipeline.bodies {input.scene} {input.surfaces} --output {output.table} --plot {output.plot}"
        " 2>&1 | tee {log}"


rule compare:
    input:
        lambda w: flow.compared(w.scene, w.level, w.other),
    output:
        page=report("outputs/{scene}/compare_{level}_{other}.html", category="{scene}", subcategory="levels",
                    caption="docs/report/compare.rst", labels={"what": "1 {level} and {other}"}),
        picture=report("outputs/{scene}/compare_{level}_{other}.png", category="{scene}", subcategory="levels",
                       caption="docs/report/compare.rst", labels={"what": "2 {level} and {other} (picture)"}),
        table=report("outputs/{scene}/compare_{level}_{other}.csv", category="{scene}", subcategory="levels",
                     caption="docs/report/compare.rst", labels={"what": "3 {level} and {other} (CSV)"}),
    params:
        depends=stage_digest("compare"),
    log: "outputs/{scene}/logs/compare_{level}_{other}.log",
    message: "{wildcards.scene}: compare {wildcards.level} with {wildcards.other}"
    shell:
        "python -m pipeline.compare outputs/{wildcards.scene}/{wildcards.level} outputs/{wildcards.scene}/"
        "{wildcards.other} --output outputs/{wildcards.scene}/compare_{wildcards.level}_{wildcards.other}"
        " 2>&1 | tee {log}"


rule without_level:
    input:
        lambda w: flow.refuse(w.scene, w.rest),
    output:
        "outputs/{scene}/{rest}",
    wildcard_constraints:
        scene=r"(?!studies/)[A-Za-z0-9_-]+|studies/[A-Za-z0-9_]+",
        rest=rf"(?!({flow.any_level})/|compare_({flow.any_level})_({flow.any_level})\.(html|png|csv)$).+",


include: "rules/studies.smk"
