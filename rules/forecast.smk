"""What to expect of a scene, and what it has cost."""


rule advise:
    input:
        scene=SCENE,
        initial="outputs/{scene}/{level}/initial.npz",
    output:
        report(
            "outputs/{scene}/{level}/advice.html",
            **SHELF,
            caption="../docs/report/advice.rst",
            labels={"what": "7 advice: numbers, time scales, time step"},
        ),
    log:
        "outputs/{scene}/{level}/logs/advise.log",
    params:
        depends=flow.depends("advise"),
    message:
        "{wildcards.scene} at {wildcards.level}: advise on the effects"
    shell:
        "python -m pipeline.advise {input.scene} --initial {input.initial} --format html --output {output}"
        " 2>&1 | tee {log}"


rule estimate:
    input:
        scene=SCENE,
        initial="outputs/{scene}/{level}/initial.npz",
        eye="outputs/{scene}/{level}/eye.vtp",
    output:
        page=report(
            "outputs/{scene}/{level}/estimate.html",
            **SHELF,
            caption="../docs/report/estimate.rst",
            labels={"what": "9 estimate: time, memory, disk, error"},
        ),
        levels="outputs/{scene}/{level}/estimate.json",
    log:
        "outputs/{scene}/{level}/logs/estimate.log",
    priority: 20  # before the simulation, where both are asked for: it finds its kernels compiled
    threads: lambda w: flow.threads(w.scene, w.level, cores())  # what runs beside it runs beside the simulation too
    resources:
        mem_mb=flow.memory("estimate"),
        gpu=flow.gpu,
        foreseen=lambda w: cores(),  # no parameter: another number of cores is no reason to estimate again
        estimates=int(not flow.elsewhere),
    params:
        depends=flow.depends("estimate"),
        start=lambda w: [f"--start {one}" for one in flow.known_start(w.scene, w.level)],
        errors=flow.expected_errors(),
    message:
        "{wildcards.scene} at {wildcards.level}: estimate time, memory and disk"
    shell:
        "python -m pipeline.estimate {input.scene} --made {input.eye} {input.initial} --cores {resources.foreseen}"
        " {params.start} {flow.device} --output {output.page} --output {output.levels} 2>&1 | tee {log}"


rule cost:
    input:
        scene=SCENE,
        estimate=lambda w: flow.estimate_made(w.scene, w.level),
        initial="outputs/{scene}/{level}/initial.npz",
        metrics="outputs/{scene}/{level}/metrics.csv",
        images=all_segments(IMAGES),
    output:
        report(
            "outputs/{scene}/{level}/cost.html",
            **SHELF,
            caption="../docs/report/cost.rst",
            labels={"what": "9 cost"},
        ),
    log:
        "outputs/{scene}/{level}/logs/cost.log",
    params:
        depends=flow.depends("cost"),
        estimate=lambda w, input: [f"--estimate {one}" for one in ([input.estimate] if input.estimate else [])],
        errors=flow.expected_errors(),
    message:
        "{wildcards.scene} at {wildcards.level}: tell what it has cost"
    shell:
        "python -m pipeline.cost {input.scene} {input.initial} {input.metrics} {params.estimate}"
        " --logs $(dirname {log}) --output {output} 2>&1 | tee {log}"
