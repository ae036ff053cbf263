"""The solver, segment by segment, and what it leaves behind."""

# Everything waits for the simulation. Where all results are asked for, scenes have rules of their own, by which cheap ones come
# first.
for name, scene, level, priority in [*results.rules("scene"), ("simulate", "[A-Za-z0-9_-]+", flow.any_level, 10)]:
    if name != "simulate":
        workflow.ruleorder(name, "simulate")

    rule:
        name:
            name
        input:
            scene=SCENE,
            initial="outputs/{scene}/{level}/initial.npz",
            restart=lambda w: flow.start(w.scene, w.level, w.segment),
        output:
            frames=directory(FRAMES),
            checkpoint="outputs/{scene}/{level}/checkpoints/segment_{segment}.npz",
            costs="outputs/{scene}/{level}/costs/segment_{segment}.json",
        log:
            "outputs/{scene}/{level}/logs/simulate_{segment}.log",
        wildcard_constraints:
            scene=scene,
            level=level,
        priority: priority
        threads: lambda w: flow.threads(w.scene, w.level, cores())
        resources:
            mem_mb=flow.memory("simulate"),
            gpu=flow.gpu,
        params:
            depends=flow.depends("simulate"),
            restart=lambda w, input: f"--restart {input.restart}" if input.restart else "",
            segment=lambda w: int(w.segment),
        message:
            "{wildcards.scene} at {wildcards.level}: simulate segment {wildcards.segment}"
        shell:
            "STAGE_USAGE={log}.json "
            "python -m pipeline.simulate {input.scene} {input.initial} --segment {params.segment} {params.restart}"
            " --frames {output.frames} --checkpoint {output.checkpoint} --costs {output.costs} --threads {threads}"
            " {flow.device} 2>&1 | tee {log}"


# Of scenes that end at rest: whether another segment follows.
checkpoint rest:
    input:
        scene=SCENE,
        initial="outputs/{scene}/{level}/initial.npz",
        frames=lambda w: expand(FRAMES, segment=flow.segments_up_to(w.scene, w.level, w.segment), allow_missing=True),
    output:
        "outputs/{scene}/{level}/rest/segment_{segment}.json",
    log:
        "outputs/{scene}/{level}/logs/rest_{segment}.log",
    params:
        depends=flow.depends("rest"),
    message:
        "{wildcards.scene} at {wildcards.level}: see whether it is at rest after segment {wildcards.segment}"
    shell:
        "python -m pipeline.rest {input.scene} {input.initial} {input.frames} --output {output} 2>&1 | tee {log}"


rule effect_costs:
    input:
        scene=SCENE,
        costs=all_segments("outputs/{scene}/{level}/costs/segment_{segment}.json"),
    output:
        page=report(
            "outputs/{scene}/{level}/effects.html",
            **SHELF,
            caption="../docs/report/effects.rst",
            labels={"what": "8 effects: memory, kernels, time"},
        ),
        table=report(
            "outputs/{scene}/{level}/effects.csv",
            **SHELF,
            caption="../docs/report/effects.rst",
            labels={"what": "8 effects (CSV)"},
        ),
    log:
        "outputs/{scene}/{level}/logs/effect_costs.log",
    params:
        depends=flow.depends("effect_costs"),
    message:
        "{wildcards.scene} at {wildcards.level}: add up what the effects cost"
    shell:
        "python -m pipeline.effect_costs {input.scene} {input.costs} --page {output.page} --table {output.table}"
        " 2>&1 | tee {log}"


rule index_frames:
    input:
        all_segments(FRAMES),
    output:
        "outputs/{scene}/{level}/frames/frames.pvd",
    log:
        "outputs/{scene}/{level}/logs/index_frames.log",
    params:
        depends=stage_digest("frames"),
    message:
        "{wildcards.scene} at {wildcards.level}: index the frames for ParaView"
    shell:
        "python -m pipeline.frames pvd {input} --output {output} 2>&1 | tee {log}"
