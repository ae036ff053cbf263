"""From a scene file to frames, surfaces, pictures, a movie and a report.

    snakemake -j2 all                                       the scenes of config/config.yaml
    snakemake -j2 outputs/<scene>/movie.mp4                 any scene of config/scenes
    snakemake -j2 validation                                a study of config/studies: table, figures, page
    snakemake -j2 all --config accuracy=standard            finer; also 'scenes=[still_eye]'
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


flow = Workflow(config)
SCENE = ancient("outputs/{scene}/scene.json")
FRAMES = "outputs/{scene}/frames/segment_{segment}"
IMAGES = "outputs/{scene}/images/segment_{segment}"


wildcard_constraints:
    scene=r"[A-Za-z0-9_-]+",
    segment=r"\d\d\d+",


onstart:
    flow.prepare_outputs()


onerror:
    flow.repeat_errors()


rule all:
    input:
        expand("outputs/{scene}/movie.mp4", scene=flow.names),
        expand("outputs/{scene}/metrics.csv", scene=flow.names),
        expand("outputs/{scene}/advice.html", scene=flow.names),
        expand("outputs/{scene}/effects.html", scene=flow.names),
        expand("outputs/{scene}/cost.html", scene=flow.names),
        expand("outputs/{scene}/frames/frames.pvd", scene=flow.names),
    message: "all done: {input}"


rule scene:
    output:
        report("outputs/{scene}/scene.json", category="{scene}", caption="docs/report/scene.rst",
               labels={"what": "6 scene in SI units"}),
    log: "outputs/{scene}/logs/scene.log",
    message: "{wildcards.scene}: check the scene",
    shell:
        "python -m pipeline.scene config/scenes/{wildcards.scene}.yaml --accuracy {flow.accuracy} --output {output}"
        " 2>&1 | tee {log}"


rule eye:
    input:
        mesh=lambda w: flow.mesh(w.scene),
        scene=SCENE,
    output:
        mesh="outputs/{scene}/eye.vtp",
        report="outputs/{scene}/eye.json",
    params:
        depends=flow.depends("eye"),
    log: "outputs/{scene}/logs/eye.log",
    message: "{wildcards.scene}: make the surface of the cavity",
    shell:
        "STAGE_USAGE={log}.json "
        "python -m pipeline.eye {input.scene} --output {output.mesh} --report {output.report} 2>&1 | tee {log}"


rule voxelize:
    input:
        scene=SCENE,
        eye="outputs/{scene}/eye.vtp",
    output:
        initial="outputs/{scene}/initial.npz",
        report="outputs/{scene}/voxelize.json",
    params:
        depends=flow.depends("voxelize"),
    log: "outputs/{scene}/logs/voxelize.log",
    message: "{wildcards.scene}: fill the cavity with particles",
    shell:
        "STAGE_USAGE={log}.json "
        "python -m pipeline.voxelize {input.scene} {input.eye} --output {output.initial} --report {output.report}"
        " 2>&1 | tee {log}"


rule advise:
    input:
        scene=SCENE,
        initial="outputs/{scene}/initial.npz",
    output:
        report("outputs/{scene}/advice.html", category="{scene}", caption="docs/report/advice.rst",
               labels={"what": "7 advice: numbers, time scales, time step"}),
    params:
        depends=flow.depends("advise"),
    log: "outputs/{scene}/logs/advise.log",
    message: "{wildcards.scene}: advise on the effects"
    shell:
        "python -m pipeline.advise {input.scene} --initial {input.initial} --format html --output {output}"
        " 2>&1 | tee {log}"


rule estimate:
    input:
        scene=SCENE,
        initial="outputs/{scene}/initial.npz",
        eye="outputs/{scene}/eye.vtp",
    output:
        page=report("outputs/{scene}/estimate.html", category="{scene}", caption="docs/report/estimate.rst",
                    labels={"what": "9 estimate: time, memory, disk, error"}),
        levels="outputs/{scene}/estimate.json",
    params:
        depends=flow.depends("estimate"),
        errors=flow.expected_errors(),
    log: "outputs/{scene}/logs/estimate.log",
    message: "{wildcards.scene}: estimate time, memory and disk"
    threads: 1000  # as many as there are: nothing else runs while times are measured
    priority: 20  # before the simulation, which finds its kernels compiled
    shell:
        "python -m pipeline.estimate {input.scene} --made {input.eye} {input.initial} --output {output.page}"
        " --output {output.levels} 2>&1 | tee {log}"


rule cost:
    input:
        scene=SCENE,
        estimate="outputs/{scene}/estimate.json",
        metrics="outputs/{scene}/metrics.csv",
        images=lambda w: expand(IMAGES, scene=w.scene, segment=flow.segments(w.scene)),
    output:
        report("outputs/{scene}/cost.html", category="{scene}", caption="docs/report/cost.rst",
               labels={"what": "9 cost: predicted and real"}),
    params:
        depends=flow.depends("cost"),
    log: "outputs/{scene}/logs/cost.log",
    message: "{wildcards.scene}: compare what was predicted with what it has cost"
    shell:
        "python -m pipeline.cost {input.scene} {input.estimate} {input.metrics}"
        " --logs outputs/{wildcards.scene}/logs --output {output} 2>&1 | tee {log}"


rule simulate:
    input:
        scene=SCENE,
        initial="outputs/{scene}/initial.npz",
        restart=lambda w: flow.start(w.scene, w.segment),
    output:
        frames=directory(FRAMES),
        checkpoint="outputs/{scene}/checkpoints/segment_{segment}.npz",
        costs="outputs/{scene}/costs/segment_{segment}.json",
    params:
        depends=flow.depends("simulate"),
        restart=lambda w, input: f"--restart {input.restart}" if input.restart else "",
        segment=lambda w: int(w.segment),
    log: "outputs/{scene}/logs/simulate_{segment}.log",
    message: "{wildcards.scene}: simulate segment {wildcards.segment}",
    threads: 1  # the other core reconstructs and draws the segment before
    priority: 10  # everything waits for the simulation
    shell:
        "STAGE_USAGE={log}.json "
        "python -m pipeline.simulate {input.scene} {input.initial} --segment {params.segment} {params.restart}"
        " --frames {output.frames} --checkpoint {output.checkpoint} --costs {output.costs} 2>&1 | tee {log}"


rule effects:
    input:
        scene=SCENE,
        costs=lambda w: expand("outputs/{scene}/costs/segment_{segment}.json", scene=w.scene,
                               segment=flow.segments(w.scene)),
    output:
        page=report("outputs/{scene}/effects.html", category="{scene}", caption="docs/report/effects.rst",
                    labels={"what": "8 effects: memory, kernels, time"}),
        table=report("outputs/{scene}/effects.csv", category="{scene}", caption="docs/report/effects.rst",
                     labels={"what": "8 effects (CSV)"}),
    params:
        depends=flow.depends("effects"),
    log: "outputs/{scene}/logs/effects.log",
    message: "{wildcards.scene}: add up what the effects cost"
    shell:
        "python -m pipeline.effects {input.scene} {input.costs} --page {output.page} --table {output.table}"
        " 2>&1 | tee {log}"


rule index_frames:
    input:
        lambda w: expand(FRAMES, scene=w.scene, segment=flow.segments(w.scene)),
    output:
        "outputs/{scene}/frames/frames.pvd",
    params:
        depends=stage_digest("frames"),
    log: "outputs/{scene}/logs/index_frames.log",
    message: "{wildcards.scene}: index the frames for ParaView",
    shell: "python -m pipeline.frames pvd {input} --output {output} 2>&1 | tee {log}"


rule reconstruct:
    input:
        scene=SCENE,
        initial="outputs/{scene}/initial.npz",
        frames=FRAMES,
    output:
        directory("outputs/{scene}/surfaces/segment_{segment}"),
    params:
        depends=flow.depends("reconstruct"),
    log: "outputs/{scene}/logs/reconstruct_{segment}.log",
    message: "{wildcards.scene}: reconstruct the surfaces of segment {wildcards.segment}",
    shell:
        "STAGE_USAGE={log}.json "
        "python -m pipeline.reconstruct {input.scene} {input.initial} {input.frames} --output {output}"
        " 2>&1 | tee {log}"


rule render:
    input:
        scene=SCENE,
        initial="outputs/{scene}/initial.npz",
        eye="outputs/{scene}/eye.vtp",
        frames=FRAMES,
        surfaces="outputs/{scene}/surfaces/segment_{segment}",
    output:
        report(directory(IMAGES), patterns=["frame_{frame}.png"],
               category="{scene}", caption="docs/report/picture.rst", labels={"what": "5 picture of frame {frame}"}),
    params:
        depends=flow.depends("render"),
    log: "outputs/{scene}/logs/render_{segment}.log",
    message: "{wildcards.scene}: draw segment {wildcards.segment}",
    shell:
        "STAGE_USAGE={log}.json "
        "python -m pipeline.render {input.scene} {input.initial} {input.eye} {input.frames} {input.surfaces}"
        " --output {output} 2>&1 | tee {log}"


rule movie:
    input:
        lambda w: expand(IMAGES, scene=w.scene, segment=flow.segments(w.scene)),
    output:
        report("outputs/{scene}/movie.mp4", category="{scene}", caption="docs/report/movie.rst",
               labels={"what": "1 movie"}),
    params:
        depends=stage_digest("movie"),
    log: "outputs/{scene}/logs/movie.log",
    message: "{wildcards.scene}: make the movie",
    shell: "python -m pipeline.movie {input} --output {output} --fps 24 2>&1 | tee {log}"


rule metrics:
    input:
        scene=SCENE,
        initial="outputs/{scene}/initial.npz",
        frames=lambda w: expand(FRAMES, scene=w.scene, segment=flow.segments(w.scene)),
    output:
        table=report("outputs/{scene}/metrics.csv", category="{scene}", caption="docs/report/metrics.rst",
                     labels={"what": "3 metrics of every frame"}),
        summary=report("outputs/{scene}/metrics.html", category="{scene}", caption="docs/report/metrics.rst",
                       labels={"what": "2 metrics in short"}),
        plots=report(directory("outputs/{scene}/plots"), patterns=["{plot}.png"], category="{scene}",
                     caption="docs/report/plot.rst", labels={"what": "4 plot: {plot}"}),
    params:
        depends=flow.depends("metrics"),
    log: "outputs/{scene}/logs/metrics.log",
    message: "{wildcards.scene}: measure and plot all frames",
    shell:
        "STAGE_USAGE={log}.json "
        "python -m pipeline.metrics {input.scene} {input.initial} {input.frames} --output {output.table}"
        " --summary {output.summary} --plots {output.plots} 2>&1 | tee {log}"


rule bodies:
    input:
        scene=SCENE,
        surfaces=lambda w: expand("outputs/{scene}/surfaces/segment_{segment}", scene=w.scene,
                                  segment=flow.segments(w.scene)),
    output:
        table="outputs/{scene}/bodies.csv",
        plot=report("outputs/{scene}/bodies.png", category="{scene}", caption="docs/report/bodies.rst",
                    labels={"what": "4 plot: bodies of the liquids"}),
    params:
        depends=flow.depends("bodies"),
    log: "outputs/{scene}/logs/bodies.log",
    message: "{wildcards.scene}: count and measure the bodies of the liquids",
    shell:
        "python -m pipeline.bodies {input.scene} {input.surfaces} --output {output.table} --plot {output.plot}"
        " 2>&1 | tee {log}"


include: "rules/studies.smk"
