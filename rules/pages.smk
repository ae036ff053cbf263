"""One page of every run."""


rule page:
    input:
        scene=SCENE,
        source=ancient(local(flow.scene_file)),
        initial="outputs/{scene}/{level}/initial.npz",
        eye="outputs/{scene}/{level}/eye.vtp",
        surfaces=all_segments("outputs/{scene}/{level}/surfaces/segment_{segment}"),
        images=all_segments(IMAGES),
        movie="outputs/{scene}/{level}/movie.mp4",
        still=lambda w: flow.still(w.scene, w.level),
        metrics="outputs/{scene}/{level}/metrics.csv",
        meanings="outputs/{scene}/{level}/metrics.json",
        index="outputs/{scene}/{level}/run.pvd",
        costs=all_segments("outputs/{scene}/{level}/costs/segment_{segment}.json"),
        linked=expand("outputs/{{scene}}/{{level}}/{page}.html", page=["advice", "cost", "effects"]),
    output:
        report(
            "outputs/{scene}/{level}/index.html",
            **SHELF,
            caption="../docs/report/page.rst",
            labels={"what": "0 all on one page"},
        ),
    log:
        "outputs/{scene}/{level}/logs/page.log",
    resources:
        mem_mb=flow.memory("page"),
    params:
        depends=flow.depends("page"),
        texts=flow.page_texts,
        errors=flow.expected_errors(),
    message:
        "{wildcards.scene} at {wildcards.level}: make the page"
    shell:
        "python -m pipeline.page $(dirname {output}) --source {input.source}" " --output {output} 2>&1 | tee {log}"
