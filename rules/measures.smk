"""Numbers of every frame, and two levels side by side."""


rule metrics:
    input:
        scene=SCENE,
        initial="outputs/{scene}/{level}/initial.npz",
        eye="outputs/{scene}/{level}/eye.vtp",
        frames=all_segments(FRAMES),
    output:
        table=report(
            "outputs/{scene}/{level}/metrics.csv",
            **SHELF,
            caption="../docs/report/metrics.rst",
            labels={"what": "3 metrics of every frame"},
        ),
        summary=report(
            "outputs/{scene}/{level}/metrics.html",
            **SHELF,
            caption="../docs/report/metrics.rst",
            labels={"what": "2 metrics in short"},
        ),
        meanings="outputs/{scene}/{level}/metrics.json",
        plots=report(
            directory("outputs/{scene}/{level}/plots"),
            patterns=["{plot}.png"],
            **SHELF,
            caption="../docs/report/plot.rst",
            labels={"what": "4 plot: {plot}"},
        ),
    log:
        "outputs/{scene}/{level}/logs/metrics.log",
    resources:
        mem_mb=flow.memory("metrics"),
    params:
        depends=flow.depends("metrics"),
    message:
        "{wildcards.scene} at {wildcards.level}: measure and plot all frames"
    shell:
        "STAGE_USAGE={log}.json "
        "python -m pipeline.metrics {input.scene} {input.initial} {input.frames} --output {output.table}"
        " --summary {output.summary} --plots {output.plots} --meanings {output.meanings}"
        " --eye {input.eye} 2>&1 | tee {log}"


rule compare:
    input:
        lambda w: flow.compared(w.scene, w.level, w.other),
    output:
        page=report(
            "outputs/{scene}/compare_{level}_{other}.html",
            category="{scene}",
            subcategory="levels",
            caption="../docs/report/compare.rst",
            labels={"what": "1 {level} and {other}"},
        ),
        picture=report(
            "outputs/{scene}/compare_{level}_{other}.png",
            category="{scene}",
            subcategory="levels",
            caption="../docs/report/compare.rst",
            labels={"what": "2 {level} and {other} (picture)"},
        ),
        table=report(
            "outputs/{scene}/compare_{level}_{other}.csv",
            category="{scene}",
            subcategory="levels",
            caption="../docs/report/compare.rst",
            labels={"what": "3 {level} and {other} (CSV)"},
        ),
    log:
        "outputs/{scene}/logs/compare_{level}_{other}.log",
    params:
        depends=stage_digest("compare"),
        texts=room_texts("web"),
    message:
        "{wildcards.scene}: compare {wildcards.level} with {wildcards.other}"
    shell:
        "python -m pipeline.compare outputs/{wildcards.scene}/{wildcards.level} outputs/{wildcards.scene}/"
        "{wildcards.other} --output outputs/{wildcards.scene}/compare_{wildcards.level}_{wildcards.other}"
        " 2>&1 | tee {log}"
