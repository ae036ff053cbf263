"""Surfaces of the liquids, the bodies that they enclose, and the index of all files of a run."""


rule reconstruct:
    input:
        scene=SCENE,
        initial="outputs/{scene}/{level}/initial.npz",
        eye="outputs/{scene}/{level}/eye.vtp",
        frames=FRAMES,
        before=lambda w: expand(FRAMES, segment=flow.segments_before(w.scene, w.level, w.segment), allow_missing=True),
    output:
        directory("outputs/{scene}/{level}/surfaces/segment_{segment}"),
    log:
        "outputs/{scene}/{level}/logs/reconstruct_{segment}.log",
    resources:
        mem_mb=flow.memory("reconstruct"),
        gpu=flow.gpu,
    params:
        depends=flow.depends("reconstruct"),
    message:
        "{wildcards.scene} at {wildcards.level}: reconstruct the surfaces of segment {wildcards.segment}"
    shell:
        "STAGE_USAGE={log}.json "
        "python -m pipeline.reconstruct {input.scene} {input.initial} {input.frames} --output {output}"
        " --before {input.before} --eye {input.eye} --threads {threads} {flow.device} 2>&1 | tee {log}"


rule index_run:
    input:
        scene=SCENE,
        eye="outputs/{scene}/{level}/eye.vtp",
        frames=all_segments(FRAMES),
        surfaces=all_segments("outputs/{scene}/{level}/surfaces/segment_{segment}"),
    output:
        index="outputs/{scene}/{level}/run.pvd",
        parts=directory("outputs/{scene}/{level}/run"),
        view="outputs/{scene}/{level}/view_run.py",
    log:
        "outputs/{scene}/{level}/logs/index_run.log",
    params:
        depends=flow.depends("index_run"),
    message:
        "{wildcards.scene} at {wildcards.level}: index the run for ParaView"
    shell:
        "python -m pipeline.index_run {input.scene} {input.eye} --frames {input.frames} --surfaces {input.surfaces}"
        " --output {output.index} 2>&1 | tee {log}"


rule bodies:
    input:
        scene=SCENE,
        surfaces=all_segments("outputs/{scene}/{level}/surfaces/segment_{segment}"),
    output:
        table="outputs/{scene}/{level}/bodies.csv",
        plot=report(
            "outputs/{scene}/{level}/bodies.png",
            **SHELF,
            caption="../docs/report/bodies.rst",
            labels={"what": "4 plot: bodies of the liquids"},
        ),
    log:
        "outputs/{scene}/{level}/logs/bodies.log",
    params:
        depends=flow.depends("bodies"),
    message:
        "{wildcards.scene} at {wildcards.level}: count and measure the bodies of the liquids"
    shell:
        "python -m pipeline.bodies {input.scene} {input.surfaces} --output {output.table} --plot {output.plot}"
        " 2>&1 | tee {log}"
