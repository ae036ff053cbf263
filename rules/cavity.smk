"""The scene in SI units, the surface of its cavity, and the particles that fill it."""


rule scene:
    output:
        report(
            "outputs/{scene}/{level}/scene.json",
            **SHELF,
            caption="../docs/report/scene.rst",
            labels={"what": "6 scene in SI units"},
        ),
    log:
        "outputs/{scene}/{level}/logs/scene.log",
    message:
        "{wildcards.scene} at {wildcards.level}: check the scene"
    shell:
        "python -m pipeline.scene {wildcards.scene} --accuracy {wildcards.level} --output {output}" " 2>&1 | tee {log}"


rule eye:
    input:
        mesh=ancient(lambda w: flow.mesh(w.scene, w.level)),  # counts by its content
        scene=SCENE,
    output:
        mesh="outputs/{scene}/{level}/eye.vtp",
        report="outputs/{scene}/{level}/eye.json",
    log:
        "outputs/{scene}/{level}/logs/eye.log",
    params:
        depends=flow.depends("eye"),
    message:
        "{wildcards.scene} at {wildcards.level}: make the surface of the cavity"
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
    log:
        "outputs/{scene}/{level}/logs/voxelize.log",
    threads: lambda w: flow.threads(w.scene, w.level, cores())
    resources:
        mem_mb=flow.memory("voxelize"),
        gpu=flow.gpu,
    params:
        depends=flow.depends("voxelize"),
    message:
        "{wildcards.scene} at {wildcards.level}: fill the cavity with particles"
    shell:
        "STAGE_USAGE={log}.json "
        "python -m pipeline.voxelize {input.scene} {input.eye} --output {output.initial} --report {output.report}"
        " --threads {threads} {flow.device} 2>&1 | tee {log}"
