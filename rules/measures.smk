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
        texts=room_texts("web"),
    message:
        "{wildcards.scene} at {wildcards.level}: measure and plot all frames"
    shell:
        "STAGE_USAGE={log}.json "
        "python -m pipeline.metrics {input.scene} {input.initial} {input.frames} --output {output.table}"
        " --summary {output.summary} --plots {output.plots} --meanings {output.meanings}"
        " --eye {input.eye} 2>&1 | tee {log}"


rule compare:
    input:
        lambda w: flow.compared(w.scene, w.levels),
    output:
        page=report(
            "outputs/{scene}/compare_{levels}.html",
            category="{scene}",
            subcategory="levels",
            caption="../docs/report/compare.rst",
            labels={"what": "1 {levels}"},
        ),
        picture=report(
            "outputs/{scene}/compare_{levels}.png",
            category="{scene}",
            subcategory="levels",
            caption="../docs/report/compare.rst",
            labels={"what": "2 {levels} (picture)"},
        ),
        table=report(
            "outputs/{scene}/compare_{levels}.csv",
            category="{scene}",
            subcategory="levels",
            caption="../docs/report/compare.rst",
            labels={"what": "3 {levels} (CSV)"},
        ),
    log:
        "outputs/{scene}/logs/compare_{levels}.log",
    params:
        depends=stage_digest("compare"),
        texts=room_texts("comparison", "web"),
        folders=lambda w: [f"outputs/{w.scene}/{one}" for one in flow.levels_in(w.levels)],
    message:
        "{wildcards.scene}: compare the levels {wildcards.levels}"
    shell:
        "python -m pipeline.compare {params.folders} --output outputs/{wildcards.scene}/compare_{wildcards.levels}"
        " 2>&1 | tee {log}"
